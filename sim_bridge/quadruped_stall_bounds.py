# SPDX-License-Identifier: Apache-2.0
"""Beyond which stalls of the machine a robot on legs may have its faults in real time."""

from __future__ import annotations

from runtime.recording.stalls import StallBound
from runtime.robots.uslgo1.assembly import FRAME_CAPACITY
from runtime.robots.uslgo1.config import NS_PER_SECOND, Uslgo1Config
from runtime.signals import Fault
from sim_bridge.stall_bounds import WORLD, common_bounds, waited_for

MPC = ("mpc",)


def quadruped_bounds(config: Uslgo1Config) -> tuple[StallBound, ...]:
    """The table, by the configuration.

    The drives answer each tick of the fast loop, so that a tick passes until the next answer; with the tick after
    those that are bridged the fault is there. Answers to more ticks than one read takes are a flood; commands leave
    within the loop's budget, now sooner and now later, and wait for the next step of the physics. The slow loop stamps
    a plan with the time from which it holds, so that it is a period old when the next is there; the tracker's command,
    which is not, is the loop's budget older than its own period.
    """
    loops, safety, drives = config.loops, config.safety, config.drives
    tick_ns, plan_ns = loops.wbc_period_ns, loops.mpc_period_ns
    bridged_ns = (safety.missing_replies_max + 1) * tick_ns
    answers_of_a_tick = max(drives.bus.count(bus) for bus in range(drives.buses))
    flood_ns = FRAME_CAPACITY // drives.buses // answers_of_a_tick * tick_ns
    on_its_way_ns = loops.wbc_budget_ns + config.simulation.time_step_ns
    planless_ns = safety.forces_age_max_ns + safety.forces_stand_max_ns
    command_ns = NS_PER_SECOND // loops.tracker_hz + loops.mpc_budget_ns
    return (
        *common_bounds(config, safety, config.simulation, "wbc", tick_ns, loops.wbc_budget_ns),
        waited_for(Fault.STALE_MOTOR, WORLD, bridged_ns, tick_ns, tick_ns),
        waited_for(Fault.BUS, WORLD, flood_ns, on_its_way_ns, 2 * tick_ns),
        waited_for(Fault.STALE_FORCES, MPC, safety.forces_age_max_ns, plan_ns),
        waited_for(Fault.NO_FORCES, MPC, planless_ns, plan_ns),
        waited_for(Fault.STALE_BODY_COMMAND, MPC, safety.command_age_max_ns, command_ns),
    )
