# SPDX-License-Identifier: Apache-2.0
"""Gait: keeps the schedule, senses early and late contacts, places the feet and moves those in the air."""

from __future__ import annotations

import math

import numpy as np

from runtime.legged.footholds import FootholdConfig, footholds
from runtime.legged.gait import GaitConfig, foot_phases, phase_progress, scheduled_stance
from runtime.legged.swing import SwingConfig, foot_reference
from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import GRAVITY
from runtime.models.rotations import yaw_of_quaternion
from runtime.records import Record, boolean, boolean_array, float64_array, int64, uint32
from runtime.signals import BodyCommand, BodyState, Gait, Mode, Posture, SafetyStatus, Stance
from runtime.tasks import Task

STANDSTILL_MPS = 0.02
"""Commands below this, and turn rates below ten times this, are standing."""


class GaitMemory(Record):
    """What the gait must remember."""

    walking = boolean()
    cycle_start_ns = int64("ns")
    stance = boolean_array("foot", "schedule of the tick before")
    touched = boolean_array("foot", "the foot has met the ground since it lifted off")
    lift_off = float64_array("foot_xyz", "m", "where each foot left the ground")
    stood = float64_array("foot_xyz", "m", "where each foot last stood")
    foothold = float64_array("foot_xyz", "m")
    late_contacts = uint32()
    early_contacts = uint32()


class GaitTask(Task):
    """Steps the gait at the rate of the fast loop.

    Args:
        description: of the robot.
        gait, swing, foothold: parameters.
        body, command, safety, posture: records read; `safety` is that of the tick before.
        output: record written.
    """

    name = "gait"

    def __init__(
        self,
        description: Quadruped,
        gait: GaitConfig,
        swing: SwingConfig,
        foothold: FootholdConfig,
        body: BodyState,
        command: BodyCommand,
        safety: SafetyStatus,
        posture: Posture,
        output: Gait,
    ) -> None:
        self._gait, self._swing, self._foothold = gait, swing, foothold
        self._body, self._command, self._safety = body, command, safety
        self._posture, self._output = posture, output
        self._shoulders = description.shoulder_positions()
        self._foot_radius = description.foot_radius_m
        self.reads, self.writes = (body, command, safety, posture), (output,)
        self.state: GaitMemory = GaitMemory("/ugv/state/gait", output.sizes)

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        memory, body, output = self.state, self._body, self._output
        balancing = self._posture.stance == Stance.STANDING and self._safety.mode in (Mode.STANDING, Mode.ACTIVE)
        self._start_or_stop(now_ns, balancing)
        phases = foot_phases(self._gait, memory.cycle_start_ns, now_ns)
        stance = scheduled_stance(self._gait, phases) if memory.walking else np.ones(4, dtype=bool)
        progress = phase_progress(self._gait, phases) if memory.walking else np.zeros(4)
        feet = body.foot_position.reshape(4, 3)
        self._follow_contacts(stance, progress, feet)
        self._place_feet(stance, progress, feet)
        contact = memory.touched & (stance | (progress > 0.5))
        self._move_feet(contact, stance, progress)
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

    def _follow_contacts(self, stance: np.ndarray, progress: np.ndarray, feet: np.ndarray) -> None:
        """Latch touchdowns; a foot lifts off at the start of its swing, and only contact after mid-swing is a touchdown."""
        memory, loaded = self.state, self._body.contact
        touched = memory.touched
        lift_off = memory.lift_off.reshape(4, 3)
        stood = memory.stood.reshape(4, 3)
        for foot in range(4):
            if not stance[foot] and memory.stance[foot]:
                touched[foot] = False
                lift_off[foot] = feet[foot]
            elif loaded[foot] and not touched[foot] and (stance[foot] or progress[foot] > 0.6):
                touched[foot] = True
                if stance[foot]:
                    memory.late_contacts += 1
                else:
                    memory.early_contacts += 1
            if touched[foot] and loaded[foot]:
                stood[foot] = feet[foot]
        memory.stance = stance

    def _place_feet(self, stance: np.ndarray, progress: np.ndarray, feet: np.ndarray) -> None:
        memory, body, command = self.state, self._body, self._command
        targets = memory.foothold.reshape(4, 3)
        if memory.walking and not memory.touched.all():
            yaw = yaw_of_quaternion(body.orientation)
            cosine, sine = math.cos(yaw), math.sin(yaw)
            forward, lateral = command.velocity.tolist()
            commanded = np.array([cosine * forward - sine * lateral, sine * forward + cosine * lateral])
            center = body.position[:2]
            heading = np.array([[cosine, -sine], [sine, cosine]])
            shoulder = center + self._shoulders[:, :2] @ heading.T
            landing = footholds(
                self._foothold,
                shoulder,
                body.linear_velocity[:2],
                commanded,
                command.yaw_rate,
                center,
                np.where(stance, 0.0, 1.0 - progress) * self._gait.swing_s,
                self._gait.stance_s,
                body.height,
                GRAVITY,
            )
            normal = body.plane_normal
            slope = normal[:2] / normal[2]
            ground = body.position[2] - body.height
            for foot in range(4):
                if not memory.touched[foot] and not stance[foot]:
                    targets[foot, :2] = landing[foot]
                    level = ground - float(slope @ (landing[foot] - center))
                    targets[foot, 2] = level + self._foot_radius / normal[2]
        for foot in range(4):
            if memory.touched[foot]:
                targets[foot] = feet[foot]

    def _move_feet(self, contact: np.ndarray, stance: np.ndarray, progress: np.ndarray) -> None:
        memory, output = self.state, self._output
        position = output.swing_position.reshape(4, 3)
        velocity = output.swing_velocity.reshape(4, 3)
        acceleration = output.swing_acceleration.reshape(4, 3)
        late_s = self._gait.stance_s
        for foot in range(4):
            if contact[foot]:
                position[foot] = memory.foothold[3 * foot : 3 * foot + 3]
                velocity[foot] = 0.0
                acceleration[foot] = 0.0
                continue
            s = float(progress[foot])
            if stance[foot]:
                s = 1.0 + s * late_s / self._gait.swing_s
            reference = foot_reference(
                self._swing,
                memory.lift_off[3 * foot : 3 * foot + 3],
                memory.foothold[3 * foot : 3 * foot + 3],
                self._body.plane_normal,
                s,
                self._gait.swing_s,
            )
            position[foot], velocity[foot], acceleration[foot] = reference
