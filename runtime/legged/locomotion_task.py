# SPDX-License-Identifier: Apache-2.0
"""One command for every joint: the control law while balancing, the posture's references otherwise."""

from __future__ import annotations

from typing import Protocol

from runtime.legged.posture import PostureConfig
from runtime.records import Record, uint32
from runtime.signals import ContactForces, Gait, JointCommand, Posture
from runtime.tasks import Task


class ControlLaw(Protocol):
    """Turns planned forces and references into joint commands."""

    def command(self, now_ns: int) -> bool:
        """Write the joint command; false if it had to fall back."""


class LocomotionMemory(Record):
    """What the locomotion must remember."""

    qp_failures = uint32()


class LocomotionTask(Task):
    """Steps the control law or the posture.

    Args:
        config: joint gains of the posture.
        law: the control law; writes `output`.
        posture, gait, forces: records read.
        output: record written.
    """

    name = "locomotion"

    def __init__(
        self,
        config: PostureConfig,
        law: ControlLaw,
        posture: Posture,
        gait: Gait,
        forces: ContactForces,
        output: JointCommand,
    ) -> None:
        self._config, self._law = config, law
        self._posture, self._gait, self._forces, self._output = posture, gait, forces, output
        self.reads, self.writes = (posture, gait, forces), (output,)
        self.state: LocomotionMemory = LocomotionMemory("/ugv/state/locomotion")

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        output, posture = self._output, self._posture
        if self._gait.balancing and self._forces.stamp_ns > 0:
            self.state.qp_failures += not self._law.command(now_ns)
        else:
            output.stamp_ns = now_ns
            output.position, output.velocity, output.effort = posture.position, posture.velocity, 0.0
            output.stiffness = self._config.stiffness_nm_prad
            output.damping = self._config.damping_nms_prad
        output.qp_failures = self.state.qp_failures
