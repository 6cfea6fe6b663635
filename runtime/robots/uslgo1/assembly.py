# SPDX-License-Identifier: Apache-2.0
"""USLGO1's tasks in their loops: *wbc* (drives, estimate, gait, whole body, safety) and *mpc* (tracker, MPC)."""

from __future__ import annotations

import msgspec

from drivers.dialects import dialect_named
from drivers.joint_group import JointGroup
from runtime import signals
from runtime.estimation.kalman_task import KalmanTask
from runtime.estimation.truth_task import TruthTask
from runtime.legged.gait_task import GaitTask
from runtime.legged.jacobian_transpose import JacobianTransposeLaw
from runtime.legged.locomotion_task import ControlLaw, LocomotionTask
from runtime.legged.mpc_task import MpcTask
from runtime.legged.posture_task import PostureTask
from runtime.legged.whole_body import WholeBodyLaw
from runtime.models.quadruped import JOINT_NAMES
from runtime.optimization.qp import SOLVERS
from runtime.robots import topics
from runtime.robots.motor_tasks import DecodeTask, EncodeTask, damping_frames
from runtime.robots.robot import Robot
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.safety.authority import AuthorityTask
from runtime.safety.filter_task import SafetyTask
from runtime.tasks import Loop, Scheduled, Task
from runtime.tracking.look_ahead import FixedLookAhead
from runtime.tracking.tracker import PathTracker

PATH_CAPACITY = 1024
FRAME_CAPACITY = 48
FIXED_LOOK_AHEAD = FixedLookAhead(distance_m=2.0)
"""Look-ahead of the variant pMW (paper 000: initially, and here always, 2 m)."""


def sizes(config: Uslgo1Config) -> dict[str, int]:
    """Lengths of the signals' arrays."""
    steps = config.mpc.steps
    return {
        "joint": 12,
        "foot": 4,
        "foot_xyz": 12,
        "bus": config.drives.buses,
        "frame": FRAME_CAPACITY,
        "frame_byte": 16 * FRAME_CAPACITY,
        "path": PATH_CAPACITY,
        "knot": steps + 1,
        "horizon_foot": 4 * steps,
        "horizon_xyz": 12 * steps,
    }


class _Board:
    """The signals of one loop: its own instances of the records, by topic."""

    def __init__(self, lengths: dict[str, int]) -> None:
        self.can_received = signals.CanFrames(topics.CAN_RECEIVED, lengths)
        self.can_sent = signals.CanFrames(topics.CAN_SENT, lengths)
        self.imu = signals.Imu(topics.IMU)
        self.localization = signals.Pose(topics.LOCALIZATION)
        self.battery = signals.Battery(topics.BATTERY)
        self.truth = signals.Truth(topics.TRUTH, lengths)
        self.buses = signals.BusStatus(topics.BUS_STATUS, lengths)
        self.timing = signals.LoopTiming(topics.TIMING)
        self.event = signals.OperatorEvent(topics.OPERATOR_EVENT)
        self.operator = signals.OperatorRequest(topics.OPERATOR)
        self.path = signals.Path(topics.PATH, lengths)
        self.joints = signals.JointState(topics.JOINT_STATE, lengths)
        self.body = signals.BodyState(topics.BODY_STATE, lengths)
        self.command = signals.BodyCommand(topics.BODY_COMMAND)
        self.posture = signals.Posture(topics.POSTURE, lengths)
        self.gait = signals.Gait(topics.GAIT, lengths)
        self.forces = signals.ContactForces(topics.CONTACT_FORCES, lengths)
        self.plan = self.forces.like()
        self.joint_command = signals.JointCommand(topics.JOINT_COMMAND, lengths)
        self.joint_command_safe = signals.JointCommand(topics.JOINT_COMMAND_SAFE, lengths)
        self.safety = signals.SafetyStatus(topics.SAFETY)


def assemble(config: Uslgo1Config) -> Robot:
    """Build every task and put them into loops.

    Args:
        config: checked configuration.
    """
    lengths = sizes(config)
    return Robot("uslgo1", (_wbc_loop(config, _Board(lengths)), _mpc_loop(config, _Board(lengths))), JOINT_NAMES)


def _wbc_loop(config: Uslgo1Config, board: _Board) -> Loop:
    period_ns = config.loops.wbc_period_ns
    dialect = dialect_named(config.drives.dialect)
    receiving, sending = (
        JointGroup(config.drives.joints(config.safety), dialect, config.drives.command_age_max_ns) for _ in range(2)
    )
    tasks: tuple[Task, ...] = (
        DecodeTask(receiving, board.can_received, board.joints),
        AuthorityTask(config.authority, board.event, board.operator),
        _estimator(config, board),
        PostureTask(config.quadruped, config.posture, board.joints, board.operator, board.safety, board.posture),
        GaitTask(
            config.quadruped,
            config.gait,
            config.swing,
            config.foothold,
            board.body,
            board.command,
            board.safety,
            board.posture,
            board.gait,
        ),
        LocomotionTask(
            config.posture,
            _control_law(config, board),
            config.quadruped.mass_kg,
            config.safety.forces_age_max_ns,
            board.posture,
            board.gait,
            board.body,
            board.forces,
            board.plan,
            board.joint_command,
        ),
        SafetyTask(
            config.safety,
            config.inertial,
            period_ns,
            board.imu,
            board.joints,
            board.body,
            board.battery,
            board.buses,
            board.timing,
            board.operator,
            board.posture,
            board.gait,
            board.command,
            board.forces,
            board.joint_command,
            board.joint_command_safe,
            board.safety,
        ),
        EncodeTask(sending, board.joint_command_safe, board.safety, board.operator, board.can_sent),
    )
    inputs = (
        board.can_received,
        board.buses,
        board.timing,
        board.imu,
        board.localization,
        board.battery,
        board.event,
        board.truth,
    )
    return Loop(
        name="wbc",
        period_ns=period_ns,
        budget_ns=config.loops.wbc_budget_ns,
        priority=config.loops.wbc_priority,
        port_inputs=inputs,
        receives=(board.command, board.forces),
        schedule=tuple(Scheduled(task) for task in tasks),
        port_outputs=(board.can_sent,),
        last_outputs=(damping_frames(sending, board.can_sent.like()),),
    )


def _mpc_loop(config: Uslgo1Config, board: _Board) -> Loop:
    loops = config.loops
    tracking = config.tracker
    if config.variant.controller == "pMW":
        tracking = msgspec.structs.replace(tracking, look_ahead=FIXED_LOOK_AHEAD)
    tracker = PathTracker(
        board.path,
        board.body,
        board.operator,
        board.safety,
        board.command,
        config.link.path_age_max_ns,
        tracking,
    )
    mpc = MpcTask(
        config.quadruped,
        config.mpc,
        config.gait,
        config.posture,
        SOLVERS[config.variant.solver](),
        loops.mpc_budget_ns,
        loops.mpc_period_ns,
        board.body,
        board.joints,
        board.command,
        board.gait,
        board.forces,
    )
    return Loop(
        name="mpc",
        period_ns=loops.mpc_period_ns,
        budget_ns=loops.mpc_budget_ns,
        priority=loops.mpc_priority,
        port_inputs=(board.path,),
        receives=(board.body, board.joints, board.gait, board.operator, board.safety),
        schedule=(Scheduled(tracker, loops.mpc_hz // loops.tracker_hz), Scheduled(mpc)),
        port_outputs=(),
    )


def _estimator(config: Uslgo1Config, board: _Board) -> Task:
    period_ns = config.loops.wbc_period_ns
    if config.variant.estimator == "truth":
        return TruthTask(config.quadruped, config.kalman, period_ns, board.truth, board.joints, board.body)
    return KalmanTask(
        config.quadruped,
        config.kalman,
        config.inertial,
        period_ns,
        board.imu,
        board.joints,
        board.localization,
        board.gait,
        board.operator,
        board.body,
    )


def _control_law(config: Uslgo1Config, board: _Board) -> ControlLaw:
    records = (board.body, board.joints, board.gait, board.plan, board.joint_command)
    if config.variant.controller == "FpM":
        return JacobianTransposeLaw(config.quadruped, config.jacobian_transpose, *records)
    return WholeBodyLaw(config.quadruped, config.whole_body, SOLVERS[config.variant.solver](), *records)
