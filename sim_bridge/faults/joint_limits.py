# SPDX-License-Identifier: Apache-2.0
"""Whether the joints are within what safety promises of them, as the far end of the wires knows them: truly."""

from __future__ import annotations

import numpy as np

from runtime.safety.config import SafetyConfig
from runtime.safety.limits import joint_bounds
from sim_bridge.quadruped_world import QuadrupedWorld

ASKED_MARGIN_NM = 3.0
"""Safety bounds the torque that a command asks for where the joint was measured; by the next one it has moved on."""


class JointLimits:
    """Angles, speeds, and the torques that the drives are asked for: what they give is within their own limits always.

    Args:
        config: of the robot's safety.
    """

    def __init__(self, config: SafetyConfig) -> None:
        low, high = joint_bounds(config)
        self._low, self._high = low - config.position_margin_rad, high + config.position_margin_rad
        self._fastest, self._strongest = config.velocity_max_radps, config.effort_max_nm + ASKED_MARGIN_NM

    def kept(self, world: QuadrupedWorld) -> bool:
        """Whether all joints are within them."""
        angles = world.joint_angles
        return bool(
            (angles >= self._low).all()
            and (angles <= self._high).all()
            and (np.abs(world.joint_velocities) <= self._fastest).all()
            and (np.abs(world.drives.asked) <= self._strongest).all()
        )
