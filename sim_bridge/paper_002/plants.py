# SPDX-License-Identifier: Apache-2.0
"""The plants that the methods are compared on: an ideal one, one that steers at a finite rate, and some with delay."""

from __future__ import annotations

import math

from sim_bridge.kinematic_vehicle import KinematicPlant

STEERING_RATE_RADPS = math.radians(20.0)
"""Of the centre angle; the paper's figures are met at this rate."""
DELAYS_NS = (300_000_000, 600_000_000)
IDEAL, PROMPT = "ideal", "no delay"


def late_pose(delay_ns: int) -> str:
    """Name of the plant whose pose is seen so late."""
    return f"pose {delay_ns * 1e-9:g} s late"


def late_command(delay_ns: int) -> str:
    """Name of the plant whose commands take effect so late; `PROMPT` for no delay."""
    return f"command {delay_ns * 1e-9:g} s late" if delay_ns else PROMPT


PLANTS = {
    IDEAL: KinematicPlant(steering_rate_radps=math.inf),
    PROMPT: KinematicPlant(steering_rate_radps=STEERING_RATE_RADPS),
    **{late_pose(delay): KinematicPlant(pose_delay_ns=delay) for delay in DELAYS_NS},
    **{late_command(delay): KinematicPlant(command_delay_ns=delay) for delay in DELAYS_NS},
}
"""By name. The ideal one steers at once; all others at the rate above."""
WORST = late_command(DELAYS_NS[-1])
"""The plant of the straight experiment's claims."""
