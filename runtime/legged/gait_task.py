# SPDX-License-Identifier: Apache-2.0
"""Gait: keeps the schedule, senses early and late contacts, places the feet and moves those in the air."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from runtime.legged.footholds import FootholdConfig, TrunkMotion, foothold
from runtime.legged.gait import GaitConfig, foot_phases, phase_progress, scheduled_stance
from runtime.legged.swing import SwingConfig, foot_reference
from runtime.models.quadruped import Quadruped
from runtime.models.rotations import yaw_of_quaternion
from runtime.records import Record, boolean, boolean_array, float64_array, int64, int64_array, uint32
from runtime.signals import BodyCommand, BodyState, Gait, Mode, Posture, SafetyStatus, Stance
from runtime.tasks import Task

Array = npt.NDArray[np.float64]

LOST_AFTER_NS = 20_000_000
"""A standing foot that has not carried load for so long searches for the ground again."""
EARLIEST_TOUCHDOWN = 0.6
"""Part of a swing before which contact is the foot scraping or lifting off, not landing."""
STANDSTILL_MPS = 0.02
"""Commands below this, and turn rates below ten times this, are standing."""


class GaitMemory(Record):
    """What the gait must remember."""

    walking = boolean()
    cycle_start_ns = int64("ns")
    stance = boolean_array("foot", "schedule of the tick before")
    touched = boolean_array("foot", "the foot has met the ground since it lifted off")
    lift_off = float64_array("foot_xyz", "m", "where each foot left the ground")
    foothold = float64_array("foot_xyz", "m")
    loaded_ns = int64_array("foot", "ns", "when each foot last carried load")
    search_ns = int64_array("foot", "ns", "when each foot began to search for late or lost ground")
    late_contacts = uint32()
    lost_contacts = uint32()
    early_contacts = uint32()


class GaitTask(Task):
    """Steps the gait at the rate of the fast loop.

    Args:
        description: of the robot.
        gait, swing, footholds: parameters.
        body, command, safety, posture: records read; `safety` is that of the tick before.
        output: record written.
    """

    name = "gait"

    def __init__(
        self,
        description: Quadruped,
        gait: GaitConfig,
        swing: SwingConfig,
        footholds: FootholdConfig,
        body: BodyState,
        command: BodyCommand,
        safety: SafetyStatus,
        posture: Posture,
        output: Gait,
    ) -> None:
        self._gait, self._swing, self._foothold = gait, swing, footholds
        self._body, self._command, self._safety = body, command, safety
        self._posture, self._output = posture, output
        self._shoulders = [(x, y) for x, y, _ in description.shoulder_positions().tolist()]
        self._foot_radius = description.foot_radius_m
        self.reads, self.writes = (body, command, safety, posture), (output,)
        self.state: GaitMemory = GaitMemory("/ugv/state/gait", output.sizes)

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        memory, body, output = self.state, self._body, self._output
        balancing = self._posture.stance == Stance.STANDING and self._safety.mode in (Mode.STANDING, Mode.ACTIVE)
        self._start_or_stop(now_ns, balancing)
        stance, progress = [True] * 4, [0.0] * 4
        if memory.walking:
            phases = foot_phases(self._gait, memory.cycle_start_ns, now_ns)
            stance, progress = scheduled_stance(self._gait, phases), phase_progress(self._gait, phases)
        self._follow_contacts(now_ns, stance, progress, body.foot_position.reshape(4, 3))
        touched = memory.touched.tolist()
        self._place_feet(touched, stance, progress)
        contact = [
            down and (stands or late > 0.5) for down, stands, late in zip(touched, stance, progress, strict=True)
        ]
        self._move_feet(now_ns, contact, stance, progress)
        output.stamp_ns = now_ns
        output.balancing = balancing
        output.walking = memory.walking
        output.cycle_start_ns = memory.cycle_start_ns
        output.stance = stance
        output.contact = contact
        output.foot_phase = progress
        output.foothold = memory.foothold
        output.late_contacts = memory.late_contacts
        output.early_contacts = memory.early_contacts
        output.lost_contacts = memory.lost_contacts

    def _start_or_stop(self, now_ns: int, balancing: bool) -> None:
        memory, command = self.state, self._command
        active = balancing and self._safety.mode == Mode.ACTIVE
        speed = math.hypot(float(command.velocity[0]), float(command.velocity[1]))
        wanted = active and (speed > STANDSTILL_MPS or abs(command.yaw_rate) > 10 * STANDSTILL_MPS)
        elapsed = now_ns - memory.cycle_start_ns
        if not balancing:
            memory.walking, memory.touched = False, True
        elif not memory.walking:
            if wanted:
                memory.walking, memory.cycle_start_ns = True, now_ns
                memory.touched = True
        elif elapsed >= self._gait.period_ns:
            memory.cycle_start_ns += self._gait.period_ns
            if not wanted:
                memory.walking = False
                memory.touched = True

    def _follow_contacts(self, now_ns: int, stance: list[bool], progress: list[float], feet: Array) -> None:
        """Latch touchdowns; a foot lifts off at the start of its swing and touches down only late in it."""
        memory = self.state
        touched, lift_off, targets = memory.touched, memory.lift_off.reshape(4, 3), memory.foothold.reshape(4, 3)
        loaded, stood = self._body.contact.tolist(), memory.stance.tolist()
        for foot in range(4):
            if not stance[foot] and stood[foot]:
                touched[foot] = False
                lift_off[foot] = feet[foot]
            elif stance[foot] and not stood[foot]:
                memory.search_ns[foot] = now_ns
            if loaded[foot]:
                memory.loaded_ns[foot] = now_ns
            unloaded_ns = now_ns - memory.loaded_ns[foot]
            if memory.walking and touched[foot] and stance[foot] and unloaded_ns > LOST_AFTER_NS:
                touched[foot] = False
                memory.search_ns[foot] = now_ns
                memory.lost_contacts += 1
            elif loaded[foot] and not touched[foot] and (stance[foot] or progress[foot] > EARLIEST_TOUCHDOWN):
                touched[foot] = True
                if stance[foot]:
                    memory.late_contacts += 1
                else:
                    memory.early_contacts += 1
            if touched[foot]:
                targets[foot] = feet[foot]
        memory.stance = stance

    def _place_feet(self, touched: list[bool], stance: list[bool], progress: list[float]) -> None:
        """Choose the footholds of the feet in the air, on the stance plane."""
        searching = [foot for foot in range(4) if not touched[foot] and not stance[foot]]
        if not searching:
            return
        body, swing_s = self._body, self._gait.swing_s
        trunk = self._trunk_motion()
        normal_x, normal_y, normal_z = body.plane_normal.tolist()
        ground = float(body.position[2]) - trunk.height + self._foot_radius / normal_z
        targets = self.state.foothold.reshape(4, 3)
        for foot in searching:
            remaining_s = (1.0 - progress[foot]) * swing_s
            x, y = foothold(self._foothold, trunk, self._shoulders[foot], remaining_s, self._gait.stance_s)
            drop = (normal_x * (x - trunk.x) + normal_y * (y - trunk.y)) / normal_z
            targets[foot] = x, y, ground - drop

    def _trunk_motion(self) -> TrunkMotion:
        body, command = self._body, self._command
        heading = yaw_of_quaternion(body.orientation)
        cosine, sine = math.cos(heading), math.sin(heading)
        forward, lateral = command.velocity.tolist()
        x, y, _ = body.position.tolist()
        velocity_x, velocity_y, _ = body.linear_velocity.tolist()
        return TrunkMotion(
            x,
            y,
            heading,
            velocity_x,
            velocity_y,
            cosine * forward - sine * lateral,
            sine * forward + cosine * lateral,
            command.yaw_rate,
            body.height,
        )

    def _move_feet(self, now_ns: int, contact: list[bool], stance: list[bool], progress: list[float]) -> None:
        """References of the feet in the air; a standing foot's is where it stands."""
        memory, output = self.state, self._output
        position, lift_off = memory.foothold.tolist(), memory.lift_off.tolist()
        normal = self._body.plane_normal.tolist()
        velocity, acceleration = [0.0] * 12, [0.0] * 12
        swing_s, search_ns = self._gait.swing_s, memory.search_ns.tolist()
        for foot in range(4):
            if contact[foot]:
                continue
            s = 1.0 + (now_ns - search_ns[foot]) * 1e-9 / swing_s if stance[foot] else progress[foot]
            xyz = slice(3 * foot, 3 * foot + 3)
            position[xyz], velocity[xyz], acceleration[xyz] = foot_reference(
                self._swing, lift_off[xyz], position[xyz], normal, s, swing_s
            )
        output.swing_position, output.swing_velocity, output.swing_acceleration = position, velocity, acceleration
