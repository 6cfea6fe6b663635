# SPDX-License-Identifier: Apache-2.0
"""Beyond which stalls of the machine a vehicle may have its faults in real time."""

from __future__ import annotations

from drivers.vcu import STATE_FRAMES
from runtime.recording.stalls import StallBound
from runtime.robots.vehicle_4ws4wd.assembly import FRAME_CAPACITY
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.signals import Fault
from sim_bridge.stall_bounds import WORLD, common_bounds, waited_for

DRIVE = ("drive",)
OFTEN = STATE_FRAMES - 1
"""State frames of a period; the temperatures come seldom."""


def vehicle_bounds(config: Vehicle4ws4wdConfig) -> tuple[StallBound, ...]:
    """The table, by the configuration.

    The control unit reports by itself. A loop that was kept finds more frames than one read takes, which are a flood,
    and the newest of the read is old. Meanwhile the unit has given up waiting for commands, and does not drive from
    then on: the one MOTOR_FAULT that a stall makes, as long after it as safety bears the refusal. The tracker is a task
    of the same loop, but not of each tick.
    """
    loops, safety, unit = config.loops, config.safety, config.simulation
    tick_ns, state_ns = loops.drive_period_ns, unit.state_period_ns
    flood_ns = FRAME_CAPACITY // OFTEN * state_ns
    borne_ns = safety.refusal_ns + 2 * state_ns + tick_ns
    return (
        *common_bounds(config, safety, unit, "drive", tick_ns, loops.drive_budget_ns),
        waited_for(Fault.STALE_MOTOR, WORLD, safety.state_age_max_ns, state_ns, tick_ns),
        waited_for(Fault.STALE_MOTOR, DRIVE, flood_ns + safety.state_age_max_ns, state_ns, tick_ns),
        waited_for(Fault.BUS, DRIVE, flood_ns, 0, 2 * tick_ns),
        waited_for(Fault.MOTOR_FAULT, DRIVE, unit.command_timeout_ns, tick_ns, borne_ns),
        waited_for(Fault.STUCK_STEERING, DRIVE, safety.steering_stuck_ns, tick_ns, tick_ns),
        waited_for(Fault.STALE_BODY_COMMAND, DRIVE, safety.command_age_max_ns, loops.tracker_period_ns, tick_ns),
    )
