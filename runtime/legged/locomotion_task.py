# SPDX-License-Identifier: Apache-2.0
"""One command for every joint: the control law while balancing, the posture's references otherwise."""

from __future__ import annotations

from typing import Protocol

from runtime.legged.posture import PostureConfig
from runtime.legged.standing_plan import StandingMemory, stand, take_place
from runtime.records import uint32
from runtime.signals import BodyState, ContactForces, Gait, JointCommand, Posture
from runtime.tasks import Task


class ControlLaw(Protocol):
    """Turns planned forces and references into joint commands."""

    def command(self, now_ns: int) -> bool:
        """Write the joint command; false if it had to fall back."""


class LocomotionMemory(StandingMemory):
    """What the locomotion must remember."""

    qp_failures = uint32()


class LocomotionTask(Task):
    """Steps the control law or the posture.

    Args:
        config: joint gains of the posture.
        law: the control law; reads `plan` and writes `output`.
        mass_kg: of the robot.
        forces_age_max_ns: a robot that stands needs no older plan: it shares its weight among its feet.
        posture, gait, body, forces: records read.
        plan: what the law reads: the forces, or a plan of standing in their place.
        output: record written.
    """

    name = "locomotion"

    def __init__(
        self,
        config: PostureConfig,
        law: ControlLaw,
        mass_kg: float,
        forces_age_max_ns: int,
        posture: Posture,
        gait: Gait,
        body: BodyState,
        forces: ContactForces,
        plan: ContactForces,
        output: JointCommand,
    ) -> None:
        self._config, self._law, self._mass_kg, self._forces_age_max_ns = config, law, mass_kg, forces_age_max_ns
        self._posture, self._gait, self._body, self._forces = posture, gait, body, forces
        self._plan, self._output = plan, output
        self.reads, self.writes = (posture, gait, body, forces), (output,)
        self.state: LocomotionMemory = LocomotionMemory("/ugv/state/locomotion")

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        output, posture = self._output, self._posture
        if self._gait.balancing and self._forces.stamp_ns > 0:
            self._choose_plan(now_ns)
            self.state.qp_failures += not self._law.command(now_ns)
        else:
            output.stamp_ns = now_ns
            output.position, output.velocity, output.effort = posture.position, posture.velocity, 0.0
            output.stiffness = self._config.stiffness_nm_prad
            output.damping = self._config.damping_nms_prad
        output.qp_failures = self.state.qp_failures

    def _choose_plan(self, now_ns: int) -> None:
        memory, plan = self.state, self._plan
        plan.copy_from(self._forces)
        unplanned = not self._gait.walking and now_ns - plan.stamp_ns > self._forces_age_max_ns
        if unplanned and not memory.unplanned:
            take_place(memory.table, self._body.table)
        memory.unplanned = unplanned
        if unplanned:
            stand(memory.table, plan.table, self._mass_kg, now_ns)
