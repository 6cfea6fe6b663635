# SPDX-License-Identifier: Apache-2.0
"""Late poses of the localisation sensor: each is compared with the estimate of its own time, and fused or rejected.

Poses that are rejected in a row and agree with each other say that the localisation has moved, or that the estimate
has. Which of them is wrong cannot be told from here, so the estimate stays where it is until the operator decides.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled
from runtime.estimation import kalman
from runtime.estimation.kalman_config import InertialFilterConfig
from runtime.models.rotations import quaternion_of_yaw, quaternion_product, rotation_z, wrapped, yaw_of_quaternion
from runtime.models.vectors import cross, turned
from runtime.records import float64_array, int64, int64_array, uint32
from runtime.signals import Pose

Array = npt.NDArray[np.float64]
HISTORY = 128
"""Ticks of past poses kept for late measurements (256 ms at 500 Hz)."""
POSE_STATES = (0, 1, 2, 8)
"""Position and yaw within the error state."""


class LocalizationMemory(kalman.KalmanMemory):
    """The filter's state and the past that late poses are compared with."""

    pose_sequence = int64()
    pose_stamp_ns = int64("ns", "of the last pose that was fused")
    poses_rejected = uint32()
    poses_disputed = uint32("", "rejected poses in a row that agree with each other")
    dispute = float64_array(4, "m, m, m, rad", "by which the last of them differs from the estimate")
    history_count = int64()
    history_ns = int64_array(HISTORY, "ns")
    history = float64_array(4 * HISTORY, "", "x y z yaw of each")


@compiled
def remember(memory: LocalizationMemory, now_ns: int) -> None:
    """Put the present pose into the ring of past ones."""
    slot = memory.history_count % HISTORY
    memory.history_count += 1
    memory.history_ns[slot] = now_ns
    memory.history[4 * slot : 4 * slot + 3] = memory.position
    memory.history[4 * slot + 3] = yaw_of_quaternion(memory.orientation)


@compiled
def fuse_pose(config: InertialFilterConfig, memory: LocalizationMemory, pose: Pose, believed: bool) -> bool:
    """Correct by a new pose, compared with the estimate at the time it was acquired.

    Args:
        config: bounds.
        memory: corrected.
        pose: the newest.
        believed: whether the estimate is moved to a pose that is in dispute.

    Returns:
        Whether it was moved.
    """
    if pose.sequence == memory.pose_sequence:
        return False
    memory.pose_sequence = pose.sequence
    past = memory.history.reshape(HISTORY, 4)
    then, beside_ns = _pose_at(memory, pose.stamp_ns)
    finite = np.isfinite(pose.position).all() and np.isfinite(pose.orientation).all()
    if not finite or beside_ns > config.longest_step_s * 1e9:
        memory.poses_rejected += 1
        return False
    error = np.empty(4)
    error[:3] = pose.position - then[:3]
    error[3] = wrapped(yaw_of_quaternion(pose.orientation) - then[3])
    if not _agrees(config, memory, error):
        memory.poses_rejected += 1
        _dispute(config, memory, error)
        if believed:
            _move(memory, past, error)
            memory.pose_stamp_ns = pose.stamp_ns
        return believed
    memory.poses_disputed = 0
    present = memory.position.copy()
    change = kalman.update(memory, kalman.pose_measurement(config, error[:3], error[3], present - then[:3]))
    for row in range(HISTORY):
        past[row, :3] += change[0:3] + cross(present - past[row, :3], change[6:9])
        past[row, 3] += change[8]
    memory.pose_stamp_ns = pose.stamp_ns
    return False


@compiled
def _pose_at(memory: LocalizationMemory, stamp_ns: int) -> tuple[Array, int]:
    """The estimate of a past time, between the ticks around it (4,); and how far the nearest tick is from it, ns."""
    past, count = memory.history.reshape(HISTORY, 4), memory.history_count
    slot = np.argmin(np.abs(memory.history_ns - stamp_ns))
    then, ahead_ns = past[slot].copy(), stamp_ns - memory.history_ns[slot]
    newest, oldest = (count - 1) % HISTORY, count % HISTORY if count > HISTORY else 0
    if (ahead_ns > 0 and slot != newest) or (ahead_ns < 0 and slot != oldest):
        other = (slot + (1 if ahead_ns > 0 else -1)) % HISTORY
        share = ahead_ns / (memory.history_ns[other] - memory.history_ns[slot])
        then[:3] += share * (past[other, :3] - then[:3])
        then[3] += share * wrapped(past[other, 3] - then[3])
    return then, abs(ahead_ns)


@compiled
def _agrees(config: InertialFilterConfig, memory: LocalizationMemory, error: Array) -> bool:
    """Whether a difference is as small as the uncertainties, and no jump."""
    covariance = memory.covariance.reshape(kalman.SIZE, kalman.SIZE)
    for row, state in enumerate(POSE_STATES):
        deviation, jump = config.localization_position_m, config.localization_jump_m
        if row == 3:
            deviation, jump = config.localization_yaw_rad, config.localization_jump_rad
        spread = covariance[state, state] + deviation**2
        if not (error[row] ** 2 <= config.localization_gate**2 * spread and abs(error[row]) <= jump):
            return False
    return True


@compiled
def _dispute(config: InertialFilterConfig, memory: LocalizationMemory, error: Array) -> None:
    """Count a rejected pose that differs as the last one did."""
    alike = True
    for row in range(4):
        deviation = config.localization_position_m if row < 3 else config.localization_yaw_rad
        difference = error[row] - memory.dispute[row]
        alike = alike and abs(difference if row < 3 else wrapped(difference)) <= config.localization_gate * deviation
    memory.poses_disputed = memory.poses_disputed + 1 if alike else 1
    memory.dispute[:] = error


@compiled
def _move(memory: LocalizationMemory, past: Array, error: Array) -> None:
    """Move the estimate of a resting robot to the pose that disputes it."""
    memory.position += error[:3]
    memory.velocity[:] = turned(rotation_z(error[3]), memory.velocity)
    memory.orientation[:] = quaternion_product(quaternion_of_yaw(error[3]), memory.orientation)
    memory.poses_disputed = 0
    for row in range(HISTORY):
        past[row] += error
