# SPDX-License-Identifier: Apache-2.0
"""Faults of the sensors and of the battery, as they arrive."""

from __future__ import annotations

from typing import Any

import numpy as np

from runtime.robots import topics
from sim_bridge.faults.wires import AnyWires, Inject


def silent(topic: str) -> Inject:
    """Nothing arrives on a topic."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        wires.filter(topic, lambda record, now_ns: not begin_ns <= now_ns < end_ns)

    return inject


def frozen_imu(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """The IMU repeats its last sample with new stamps."""
    held: dict[str, Any] = {}

    def change(imu: Any, now_ns: int) -> bool:
        if not begin_ns <= now_ns < end_ns:
            held.update(force=imu.linear_acceleration.copy(), rate=imu.angular_velocity.copy())
        elif held:
            imu.linear_acceleration, imu.angular_velocity = held["force"], held["rate"]
        return True

    wires.filter(topics.IMU, change)


def nan_imu(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """A number of the IMU's samples is none."""

    def change(imu: Any, now_ns: int) -> bool:
        if begin_ns <= now_ns < end_ns:
            imu.angular_velocity[wires.rng.integers(3)] = wires.rng.choice((np.nan, np.inf, -np.inf))
        return True

    wires.filter(topics.IMU, change)


def spiking_imu(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """The IMU's samples are far off."""

    def change(imu: Any, now_ns: int) -> bool:
        if begin_ns <= now_ns < end_ns:
            away = wires.rng.choice((-1.0, 1.0), 2)
            imu.linear_acceleration[wires.rng.integers(3)] += away[0] * wires.rng.uniform(200.0, 900.0)
            imu.angular_velocity[wires.rng.integers(3)] += away[1] * wires.rng.uniform(20.0, 60.0)
        return True

    wires.filter(topics.IMU, change)


def backward_imu(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """The IMU's stamps run backwards."""

    def change(imu: Any, now_ns: int) -> bool:
        if begin_ns <= now_ns < end_ns:
            imu.stamp_ns = 2 * begin_ns - now_ns
        return True

    wires.filter(topics.IMU, change)


def jumping_pose(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """The localisation is somewhere else."""
    direction = wires.rng.uniform(0.0, 2.0 * np.pi)
    jump = 3.0 * np.array([np.cos(direction), np.sin(direction), 0.0])

    def change(pose: Any, now_ns: int) -> bool:
        if begin_ns <= now_ns < end_ns:
            pose.position += jump
        return True

    wires.filter(topics.LOCALIZATION, change)


def low_battery(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """The battery's voltage is too low."""

    def change(battery: Any, now_ns: int) -> bool:
        if begin_ns <= now_ns < end_ns:
            battery.voltage = wires.config.safety.voltage_min_v - 0.5
        return True

    wires.filter(topics.BATTERY, change)
