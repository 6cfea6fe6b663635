# SPDX-License-Identifier: Apache-2.0
"""The 4WS4WD vehicle's tasks in their loop, *drive*: control unit, estimate, tracker, steering, safety."""

from __future__ import annotations

from functools import partial

from drivers.vcu import STATE_FRAMES, TEMPERATURES, UnitCommandMode, UnitMode
from runtime import signals, vehicle_signals
from runtime.estimation.vehicle_filter_task import VehicleFilterTask
from runtime.estimation.vehicle_truth_task import VehicleTruthTask
from runtime.models.vehicle import WHEELS
from runtime.robots import topics
from runtime.robots.predictive_policy import PredictivePolicy
from runtime.robots.robot import Robot
from runtime.robots.unit_tasks import DecodeUnitTask, EncodeUnitTask, braking_frames
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.safety.authority import AuthorityTask
from runtime.safety.vehicle_task import VehicleSafetyTask
from runtime.tasks import Loop, Scheduled, Task
from runtime.tracking.delay_task import DelayTask
from runtime.tracking.drive_tracker import DriveTracker
from runtime.tracking.drive_tracker_config import SolveMemory
from runtime.tracking.vehicle_tracker import SteeringPolicy
from runtime.wheeled.steering_task import SteeringTask

PATH_CAPACITY = 1024
FRAME_CAPACITY = 64
"""A tick of a loop that was held up may find those of several periods."""
JOINT_NAMES = tuple(f"{wheel}_{axis}" for axis in ("steering", "wheel") for wheel in WHEELS)


def sizes(config: Vehicle4ws4wdConfig) -> dict[str, int]:
    """Lengths of the signals' arrays."""
    return {
        "wheel": len(WHEELS),
        "axle_drive": 2 * len(WHEELS),
        "unit_frame": STATE_FRAMES,
        "bus": config.drives.buses,
        "frame": FRAME_CAPACITY,
        "frame_byte": 16 * FRAME_CAPACITY,
        "path": PATH_CAPACITY,
    }


class _Board:
    """The signals of the loop, by topic."""

    def __init__(self, lengths: dict[str, int]) -> None:
        self.can_received = signals.CanFrames(topics.CAN_RECEIVED, lengths)
        self.can_sent = signals.CanFrames(topics.CAN_SENT, lengths)
        self.imu = signals.Imu(topics.IMU)
        self.localization = signals.Pose(topics.LOCALIZATION)
        self.battery = signals.Battery(topics.BATTERY)
        self.truth = vehicle_signals.VehicleTruth(topics.TRUTH, lengths)
        self.buses = signals.BusStatus(topics.BUS_STATUS, lengths)
        self.timing = signals.LoopTiming(topics.TIMING)
        self.event = signals.OperatorEvent(topics.OPERATOR_EVENT)
        self.operator = signals.OperatorRequest(topics.OPERATOR)
        self.path = signals.Path(topics.PATH, lengths)
        self.wheels = vehicle_signals.WheelState(topics.WHEEL_STATE, lengths)
        self.body = vehicle_signals.VehicleState(topics.BODY_STATE, lengths)
        self.delay = vehicle_signals.CommandDelay(topics.COMMAND_DELAY)
        self.twist = vehicle_signals.TwistCommand(topics.BODY_COMMAND)
        self.command = vehicle_signals.WheelCommand(topics.WHEEL_COMMAND, lengths)
        self.command_safe = vehicle_signals.WheelCommand(topics.WHEEL_COMMAND_SAFE, lengths)
        self.safety = signals.SafetyStatus(topics.SAFETY)
        self.wheel_status = vehicle_signals.WheelStatus(topics.WHEEL_STATUS, lengths)


def assemble(config: Vehicle4ws4wdConfig) -> Robot:
    """Build every task and put them into the loop.

    Args:
        config: checked configuration.
    """
    return Robot("4ws4wd", (_drive_loop(config, _Board(sizes(config))),), JOINT_NAMES)


def _drive_loop(config: Vehicle4ws4wdConfig, board: _Board) -> Loop:
    loops = config.loops
    period_ns = loops.drive_period_ns
    decode = DecodeUnitTask(config.drives.unit(), board.can_received, board.wheels, board.battery)
    authority = AuthorityTask(config.authority, board.event, board.operator)
    tracker = DriveTracker(
        config.tracker,
        config.vehicle,
        partial(_policy, config),
        config.speed_policy,
        board.path,
        board.body,
        board.wheels,
        board.delay,
        board.operator,
        board.safety,
        board.twist,
        config.link.path_age_max_ns,
    )
    steering = SteeringTask(
        config.vehicle, config.steering, UnitCommandMode.DRIVE, period_ns, board.twist, board.wheels, board.command
    )
    safety = VehicleSafetyTask(
        config.safety,
        config.inertial,
        config.vehicle.wheel_radius_m,
        [frame == TEMPERATURES for frame in range(STATE_FRAMES)],
        UnitCommandMode.DRIVE,
        UnitCommandMode.BRAKE,
        UnitMode.DRIVE,
        period_ns,
        board.imu,
        board.wheels,
        board.body,
        board.battery,
        board.buses,
        board.timing,
        board.operator,
        board.twist,
        board.command,
        board.command_safe,
        board.safety,
        board.wheel_status,
    )
    sending, every = config.drives.unit(), loops.drive_hz // loops.tracker_hz
    last = braking_frames(sending, board.can_sent.like())
    encode = EncodeUnitTask(sending, board.command_safe, board.can_sent)
    schedule = (
        Scheduled(decode),
        Scheduled(authority),
        Scheduled(_estimator(config, board)),
        *(Scheduled(task, every) for task in _learning(config, board)),
        Scheduled(tracker, every),
        Scheduled(steering),
        Scheduled(safety),
        Scheduled(encode),
    )
    inputs = (
        board.can_received,
        board.buses,
        board.timing,
        board.imu,
        board.localization,
        board.event,
        board.path,
        board.truth,
    )
    return Loop(
        name="drive",
        period_ns=period_ns,
        budget_ns=loops.drive_budget_ns,
        priority=loops.drive_priority,
        port_inputs=inputs,
        receives=(),
        schedule=schedule,
        port_outputs=(board.can_sent,),
        last_outputs=(last,),
    )


def _learning(config: Vehicle4ws4wdConfig, board: _Board) -> tuple[Task, ...]:
    if not config.reckons_with_delay:
        return ()
    answer, geometry = config.tracker.following.answer, config.vehicle
    return (DelayTask(config.delay, answer, geometry, board.wheels, board.command_safe, board.delay),)


def _policy(config: Vehicle4ws4wdConfig, memory: SolveMemory) -> SteeringPolicy:
    if config.variant.controller == "mpc":
        return PredictivePolicy(config.controllers.mpc, memory)
    return config.policy


def _estimator(config: Vehicle4ws4wdConfig, board: _Board) -> Task:
    if config.variant.estimator == "truth":
        return VehicleTruthTask(board.truth, board.body)
    vehicle = config.vehicle
    return VehicleFilterTask(
        vehicle.wheel_positions(),
        vehicle.wheel_radius_m,
        range(len(WHEELS)),
        config.kalman,
        config.inertial,
        config.loops.drive_period_ns,
        board.imu,
        board.wheels,
        board.localization,
        board.operator,
        board.body,
    )
