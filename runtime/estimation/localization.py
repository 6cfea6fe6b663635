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
from runtime.estimation.kalman_config import KalmanConfig
from runtime.models.rotations import quaternion_of_yaw, quaternion_product, rotation_z, wrapped, yaw_of_quaternion
from runtime.models.vectors import turned
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
def fuse_pose(config: KalmanConfig, memory: LocalizationMemory, pose: Pose, believed: bool) -> bool:
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
    ages = np.abs(memory.history_ns - pose.stamp_ns)
    slot = np.argmin(ages)
    finite = np.isfinite(pose.position).all() and np.isfinite(pose.orientation).all()
    if not finite or ages[slot] > config.longest_step_s * 1e9:
        memory.poses_rejected += 1
        return False
    error = np.empty(4)
    error[:3] = pose.position - past[slot, :3]
    error[3] = wrapped(yaw_of_quaternion(pose.orientation) - past[slot, 3])
    if not _agrees(config, memory, error):
        memory.poses_rejected += 1
        _dispute(config, memory, error)
        if believed:
            _move(memory, past, error)
            memory.pose_stamp_ns = pose.stamp_ns
        return believed
    memory.poses_disputed = 0
    change = kalman.update(memory, kalman.pose_measurement(config, error[:3], error[3]))
    for row in range(HISTORY):
        past[row, :3] += change[0:3]
        past[row, 3] += change[8]
    memory.pose_stamp_ns = pose.stamp_ns
    return False


@compiled
def _agrees(config: KalmanConfig, memory: LocalizationMemory, error: Array) -> bool:
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
def _dispute(config: KalmanConfig, memory: LocalizationMemory, error: Array) -> None:
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
