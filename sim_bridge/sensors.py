# SPDX-License-Identifier: Apache-2.0
"""Virtual sensors: what the IMU, the localisation and the battery say of the true state. All seeded."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from runtime.models.rotations import quaternion_of_vector, quaternion_product
from runtime.records import Record
from runtime.robots.simulation import WorldConfig
from runtime.signals import Battery, Imu, Pose

Array = npt.NDArray[np.float64]
NS_PER_SECOND = 1_000_000_000
_NOISE_BLOCK = 128


class InertialSensor:
    """An integrating IMU: each sample is the mean over its period, plus bias, bias walk and white noise."""

    def __init__(self, config: WorldConfig, generator: np.random.Generator) -> None:
        self._period_ns = NS_PER_SECOND // config.imu_rate_hz
        root_rate = np.sqrt(config.imu_rate_hz)
        self._noise = np.repeat((config.imu_acceleration_noise, config.imu_rate_noise), 3) * root_rate
        self._walk = np.repeat((config.imu_acceleration_walk, config.imu_rate_walk), 3) / root_rate
        initial = np.repeat((config.imu_acceleration_bias_mps2, config.imu_rate_bias_radps), 3)
        self._generator = generator
        self._bias = initial * generator.standard_normal(6)
        self._errors, self._row = np.zeros((_NOISE_BLOCK, 6)), _NOISE_BLOCK
        self._sum, self._count = np.zeros(6), 0
        self._sequence, self._stamp_ns = 0, 0
        self._sample = np.zeros(6)
        self._acceleration, self._rate = self._sample[:3], self._sample[3:]
        self._fresh = False

    def feel(self, motion: Array, now_ns: int) -> None:
        """Take in the specific force and the angular rate (6,) of one physics step that ended at `now_ns`."""
        if self._count:
            np.add(self._sum, motion, out=self._sum)
        else:
            self._sum[:] = motion
        self._count += 1
        if now_ns % self._period_ns == 0:
            if self._row == _NOISE_BLOCK:
                self._draw()
            np.divide(self._sum, self._count, out=self._sample)
            np.add(self._sample, self._errors[self._row], out=self._sample)
            self._count, self._row = 0, self._row + 1
            self._sequence, self._stamp_ns, self._fresh = self._sequence + 1, now_ns, True

    def _draw(self) -> None:
        """Bias and noise of the next block of samples."""
        white, drift = self._generator.standard_normal((_NOISE_BLOCK, 2, 6)).swapaxes(0, 1)
        bias = self._bias + np.cumsum(self._walk * drift, axis=0)
        self._bias = bias[-1]
        self._errors, self._row = bias + self._noise * white, 0

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the newest sample, as an input port."""
        assert isinstance(record, Imu)
        if not self._fresh:
            return False
        self._fresh = False
        record.stamp_ns, record.sequence = self._stamp_ns, self._sequence
        record.linear_acceleration, record.angular_velocity = self._acceleration, self._rate
        return True


class LocalizationSensor:
    """Stand-in for the lidar's SLAM: white unbiased noise, stamped at acquisition, delivered late."""

    def __init__(self, config: WorldConfig, generator: np.random.Generator) -> None:
        self._config, self._generator = config, generator
        self._period_ns = NS_PER_SECOND // config.localization_rate_hz
        self._pending: deque[tuple[int, int, Array, Array]] = deque()
        self._sequence = 0

    def due(self, now_ns: int) -> bool:
        """Whether a pose is to be acquired at `now_ns`."""
        return now_ns % self._period_ns == 0

    def see(self, position: Array, orientation: Array, now_ns: int) -> None:
        """Acquire a pose."""
        config, noise = self._config, self._generator.standard_normal(6)
        turned = quaternion_product(quaternion_of_vector(config.localization_angle_rad * noise[3:]), orientation)
        self._sequence += 1
        self._pending.append((now_ns, self._sequence, position + config.localization_position_m * noise[:3], turned))

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the newest pose whose latency has passed, as an input port."""
        assert isinstance(record, Pose)
        arrived = False
        while self._pending and self._pending[0][0] + self._config.localization_latency_ns <= now_ns:
            record.stamp_ns, record.sequence, record.position, record.orientation = self._pending.popleft()
            arrived = True
        return arrived


class BatterySensor:
    """A battery with an inner resistance, drained by the motors' mechanical power."""

    IDLE_W = 40.0
    PERIOD_NS = 100_000_000

    def __init__(self, config: WorldConfig) -> None:
        self._config = config
        self._voltage, self._capacity_as = config.battery_v, 3600.0 * config.battery_capacity_ah
        self._charge, self._current, self._next_ns = 1.0, 0.0, 0

    def drain(self, power_w: float, seconds: float) -> None:
        """Take in the power that all motors together drew or gave back for a time."""
        self._current = (self.IDLE_W + max(power_w, 0.0)) / self._voltage
        self._charge -= self._current * seconds / self._capacity_as

    @property
    def state(self) -> tuple[float, float, float]:
        """Voltage (V), current (A) and charge (0 to 1) at present."""
        voltage = self._config.battery_v - self._config.battery_resistance_ohm * self._current
        return voltage, self._current, self._charge

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the state ten times a second, as an input port."""
        assert isinstance(record, Battery)
        if now_ns < self._next_ns:
            return False
        self._next_ns = now_ns + self.PERIOD_NS
        record.stamp_ns = now_ns
        record.voltage, record.current, record.charge = self.state
        return True
