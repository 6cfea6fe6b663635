# SPDX-License-Identifier: Apache-2.0
"""`ugv bench tracker`: one step of the vehicle's tracker, with each of its controllers, on the way through a curve."""

from __future__ import annotations

import math
from time import perf_counter_ns
from typing import TYPE_CHECKING, Any, get_args, get_type_hints

if TYPE_CHECKING:
    from runtime.records import Record
    from runtime.tasks import Task

ROBOT, COURSE = "4ws4wd", "curve-s"
TASK = "tracker"


def controllers() -> tuple[str, ...]:
    """The vehicle's controllers, its own first."""
    from runtime.robots.vehicle_4ws4wd.config import VariantConfig

    return tuple(get_args(get_type_hints(VariantConfig)["controller"]))


def step_times_ms(controller: str, seconds: float = math.inf) -> list[float]:
    """Wall times of the tracker's steps while it drives a kinematic vehicle through the course.

    Args:
        controller: of the vehicle.
        seconds: how much of the way; by default all of it.
    """
    from runtime.cli.bench import no_collection
    from runtime.robots import assembled, load_configuration
    from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
    from sim_bridge.kinematic_vehicle import NS_PER_SECOND, KinematicPlant, KinematicVehicle
    from sim_bridge.vehicle_courses import scenario

    config = load_configuration(ROBOT, {"variant.controller": controller})
    assert isinstance(config, Vehicle4ws4wdConfig)
    (loop,) = assembled(config).loops
    task = next(item.task for item in loop.schedule if item.task.name == TASK)
    course, period_ns = scenario(COURSE), config.loops.tracker_period_ns
    answer = config.tracker.following.answer
    plant = KinematicPlant(answer.wheelbase_m, 0, 0, answer.rate_radps, answer.acceleration_mps2, period_ns)
    vehicle = KinematicVehicle(plant, course.start_pose)
    times: list[float] = []
    records, now_ns = _given(task, course), NS_PER_SECOND
    command = records["TwistCommand"]
    with no_collection():
        while not command.arrived and now_ns < (1.0 + min(seconds, course.time_limit_s)) * NS_PER_SECOND:
            _sense(records, vehicle.motion, now_ns)
            began = perf_counter_ns()
            task.step(now_ns)
            times.append((perf_counter_ns() - began) / 1e6)
            speed = float(command.velocity[0])
            vehicle.command(speed, command.yaw_rate / speed if speed else 0.0)
            vehicle.advance()
            now_ns += period_ns
    return times


def measure() -> None:
    """Measure with every controller, and print."""
    from runtime.cli.bench import percentiles, print_times
    from runtime.cli.console import progress_bar

    rows: list[tuple[Any, ...]] = []
    names = controllers()
    with progress_bar(f"{ROBOT} {COURSE}") as progress:
        for number, name in enumerate(names, start=1):
            times = step_times_ms(name)
            rows.append((name, len(times), *percentiles(times)))
            progress(number, len(names))
    print_times(f"Tracker's step on {COURSE}, ms (claimed: p99 at most 1, aim 0.2)", rows, reference=rows[0])


def _given(task: Task, course: Any) -> dict[str, Any]:
    """The task's records by the name of their kind, with the course to be driven in them."""
    from runtime.signals import Mode, Motion

    records: dict[str, Record] = {type(record).__name__: record for record in (*task.reads, *task.writes)}
    path: Any = records["Path"]
    path.stamp_ns, path.count, path.closed, path.speed = 1, len(course.waypoints), course.closed, course.speed_mps
    path.x[: path.count], path.y[: path.count] = zip(*course.waypoints, strict=True)
    request: Any = records["OperatorRequest"]
    safety: Any = records["SafetyStatus"]
    request.motion, safety.mode = Motion.WALK, Mode.ACTIVE
    return records


def _sense(records: dict[str, Any], motion: Any, now_ns: int) -> None:
    """What the tracker knows of the vehicle."""
    body, wheels = records["VehicleState"], records["WheelState"]
    body.stamp_ns = wheels.stamp_ns = now_ns
    body.position = motion.x, motion.y, 0.0
    body.orientation = 0.0, 0.0, math.sin(0.5 * motion.yaw), math.cos(0.5 * motion.yaw)
    body.velocity, body.angular_velocity = (motion.speed, 0.0), (0.0, 0.0, motion.yaw_rate)
    wheels.steering = motion.angle, motion.angle, -motion.angle, -motion.angle
