# SPDX-License-Identifier: Apache-2.0
"""Gait: keeps the schedule, senses early and late contacts, places the feet and moves those in the air."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled, table_of
from runtime.legged.footholds import FootholdConfig, TrunkMotion, foothold
from runtime.legged.gait import GaitConfig, foot_phases, phase_progress, scheduled_stance
from runtime.legged.reference import Demand
from runtime.legged.swing import SwingConfig, foot_reference
from runtime.models.quadruped import FORWARD, LEFT, Quadruped
from runtime.models.rotations import yaw_of_quaternion
from runtime.records import Record, boolean, boolean_array, float64_array, int64, int64_array, uint32
from runtime.signals import BodyCommand, BodyState, Fault, Gait, Mode, Posture, SafetyStatus, Stance
from runtime.tasks import Task

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

LOST_AFTER_NS = 20_000_000
"""A standing foot that has not carried load for so long searches for the ground again."""
EARLIEST_TOUCHDOWN = 0.6
"""Part of a swing before which contact is the foot scraping or lifting off, not landing."""
UNLED = (Fault.STALE_FORCES | Fault.STALE_BODY_COMMAND).value
"""Reasons to stand for which nobody slows the robot down, so that the gait itself must stop."""
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
        self._safety, self._posture = safety, posture
        self.reads, self.writes = (body, command, safety, posture), (output,)
        self.state: GaitMemory = GaitMemory("/ugv/state/gait", output.sizes)
        self._move = partial(
            _move,
            table_of(description),
            table_of(gait),
            table_of(swing),
            table_of(footholds),
            body.table,
            command.table,
            self.state.table,
            output.table,
        )

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        mode = self._safety.mode
        balancing = self._posture.stance == Stance.STANDING and mode in (Mode.STANDING, Mode.ACTIVE)
        self._move(now_ns, balancing, balancing and mode == Mode.ACTIVE, bool(self._safety.halt & UNLED))


@compiled
def _move(
    robots: Sequence[Quadruped],
    gaits: Sequence[GaitConfig],
    swings: Sequence[SwingConfig],
    rules: Sequence[FootholdConfig],
    bodies: Sequence[BodyState],
    commands: Sequence[BodyCommand],
    memories: Sequence[GaitMemory],
    outputs: Sequence[Gait],
    now_ns: int,
    balancing: bool,
    active: bool,
    unled: bool,
) -> None:
    """One tick: `balancing` if the legs carry the trunk, `active` if the robot may walk, `unled` if it must stop."""
    gait, body, memory, output = gaits[0], bodies[0], memories[0], outputs[0]
    demand = Demand(0.0, 0.0, 0.0)
    if not unled:
        demand = Demand(commands[0].velocity[0], commands[0].velocity[1], commands[0].yaw_rate)
    _start_or_stop(gait, memory, demand, now_ns, balancing, active, unled)
    stance, progress = np.ones(4, dtype=np.bool_), np.zeros(4)
    if memory.walking:
        phases = foot_phases(gait, memory.cycle_start_ns, now_ns)
        stance, progress = scheduled_stance(gait, phases), phase_progress(gait, phases)
    _follow_contacts(memory, body, now_ns, stance, progress)
    _place_feet(robots[0], gait, rules[0], memory, body, demand, stance, progress)
    for foot in range(4):
        output.contact[foot] = memory.touched[foot] and (stance[foot] or progress[foot] > 0.5)
    _move_feet(gait, swings[0], memory, body, now_ns, stance, progress, output)
    output.stamp_ns = now_ns
    output.balancing = balancing
    output.walking = memory.walking
    output.cycle_start_ns = memory.cycle_start_ns
    output.stance[:] = stance
    output.foot_phase[:] = progress
    output.foothold[:] = memory.foothold
    output.late_contacts = memory.late_contacts
    output.early_contacts = memory.early_contacts
    output.lost_contacts = memory.lost_contacts


@compiled
def _start_or_stop(
    gait: GaitConfig, memory: GaitMemory, demand: Demand, now_ns: int, balancing: bool, active: bool, unled: bool
) -> None:
    """All feet stand at the end of a cycle and, which matters only where time is short, in its middle."""
    speed = math.hypot(demand.forward, demand.lateral)
    wanted = active and (speed > STANDSTILL_MPS or abs(demand.yaw_rate) > 10 * STANDSTILL_MPS)
    if not balancing:
        memory.walking = False
        memory.touched[:] = True
    elif not memory.walking:
        if wanted:
            memory.walking, memory.cycle_start_ns = True, now_ns
            memory.touched[:] = True
    elif unled and _changes_feet(gait, memory, now_ns):
        memory.walking = False
        memory.touched[:] = True
    elif now_ns - memory.cycle_start_ns >= gait.period_ns:
        memory.cycle_start_ns += gait.period_ns
        if not wanted:
            memory.walking = False
            memory.touched[:] = True


@compiled
def _changes_feet(gait: GaitConfig, memory: GaitMemory, now_ns: int) -> bool:
    """Whether feet land and others are about to lift off."""
    stance = scheduled_stance(gait, foot_phases(gait, memory.cycle_start_ns, now_ns))
    return bool(stance.all() or (stance != memory.stance).any())


@compiled
def _follow_contacts(memory: GaitMemory, body: BodyState, now_ns: int, stance: Mask, progress: Array) -> None:
    """Latch touchdowns; a foot lifts off at the start of its swing and touches down only late in it."""
    for foot in range(4):
        xyz = slice(3 * foot, 3 * foot + 3)
        if not stance[foot] and memory.stance[foot]:
            memory.touched[foot] = False
            memory.lift_off[xyz] = body.foot_position[xyz]
        elif stance[foot] and not memory.stance[foot]:
            memory.search_ns[foot] = now_ns
        if body.contact[foot]:
            memory.loaded_ns[foot] = now_ns
        unloaded_ns = now_ns - memory.loaded_ns[foot]
        if memory.walking and memory.touched[foot] and stance[foot] and unloaded_ns > LOST_AFTER_NS:
            memory.touched[foot] = False
            memory.search_ns[foot] = now_ns
            memory.lost_contacts += 1
        elif body.contact[foot] and not memory.touched[foot] and (stance[foot] or progress[foot] > EARLIEST_TOUCHDOWN):
            memory.touched[foot] = True
            if stance[foot]:
                memory.late_contacts += 1
            else:
                memory.early_contacts += 1
        if memory.touched[foot]:
            memory.foothold[xyz] = body.foot_position[xyz]
        memory.stance[foot] = stance[foot]


@compiled
def _place_feet(
    robot: Quadruped,
    gait: GaitConfig,
    rule: FootholdConfig,
    memory: GaitMemory,
    body: BodyState,
    demand: Demand,
    stance: Mask,
    progress: Array,
) -> None:
    """Choose the footholds of the feet in the air, on the stance plane."""
    trunk, normal = _trunk_motion(body, demand), body.plane_normal
    ground = body.position[2] - trunk.height + robot.foot_radius_m / normal[2]
    for foot in range(4):
        if memory.touched[foot] or stance[foot]:
            continue
        shoulder = FORWARD[foot] * robot.hip_x_m, LEFT[foot] * (robot.hip_y_m + robot.abad_length_m)
        x, y = foothold(rule, trunk, shoulder, (1.0 - progress[foot]) * gait.swing_s, gait.stance_s)
        drop = (normal[0] * (x - trunk.x) + normal[1] * (y - trunk.y)) / normal[2]
        memory.foothold[3 * foot], memory.foothold[3 * foot + 1] = x, y
        memory.foothold[3 * foot + 2] = ground - drop


@compiled
def _trunk_motion(body: BodyState, demand: Demand) -> TrunkMotion:
    heading = yaw_of_quaternion(body.orientation)
    cosine, sine = math.cos(heading), math.sin(heading)
    forward, lateral = demand.forward, demand.lateral
    return TrunkMotion(
        body.position[0],
        body.position[1],
        heading,
        body.linear_velocity[0],
        body.linear_velocity[1],
        cosine * forward - sine * lateral,
        sine * forward + cosine * lateral,
        demand.yaw_rate,
        body.height,
    )


@compiled
def _move_feet(
    gait: GaitConfig,
    swing: SwingConfig,
    memory: GaitMemory,
    body: BodyState,
    now_ns: int,
    stance: Mask,
    progress: Array,
    output: Gait,
) -> None:
    """References of the feet in the air; a standing foot's is where it stands."""
    for foot in range(4):
        xyz = slice(3 * foot, 3 * foot + 3)
        position, velocity, acceleration = memory.foothold[xyz].copy(), np.zeros(3), np.zeros(3)
        if not output.contact[foot]:
            s = progress[foot]
            if stance[foot]:
                s = 1.0 + (now_ns - memory.search_ns[foot]) * 1e-9 / gait.swing_s
            position, velocity, acceleration = foot_reference(
                swing, memory.lift_off[xyz], position, body.plane_normal, s, gait.swing_s
            )
        output.swing_position[xyz] = position
        output.swing_velocity[xyz] = velocity
        output.swing_acceleration[xyz] = acceleration
