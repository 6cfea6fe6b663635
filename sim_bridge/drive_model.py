# SPDX-License-Identifier: Apache-2.0
"""Physics of the motors: the torque-speed curve and the temperature; and the encoders that watch them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.errors import DriverConfigError
from drivers.joints import Joint, column
from runtime.compiled import compiled

FloatArray = npt.NDArray[np.float64]

_NOISE_BLOCK = 128
_HEATING_PERIOD_NS = 10_000_000


@dataclass(frozen=True)
class DriveModel:
    """Physics and firmware of a drive.

    Attributes:
        peak_torque: N.m at the joint, standing still.
        no_load_speed: rad/s at the joint; the torque available in the sense of motion falls linearly to zero there.
        encoder_counts: counts of the drive's encoder in one turn of its output.
        velocity_noise: rad/s at the drive's output, standard deviation of the measured speed.
        command_timeout_ns: ns without a command after which the drive falls back to damping.
        timeout_damping: N.m.s/rad at the drive's output, the damping of that fall-back; 0 lets the motor idle.
        ambient_temperature: degC.
        heating: K/s for each (N.m)^2 at the joint.
        cooling_time: s, time constant of cooling.
        temperature_limit: degC; above it the drive reports a fault and gives no torque until enabled again.
        bus_voltage: V, reported by the dialects that do.
    """

    peak_torque: float
    no_load_speed: float
    encoder_counts: int
    velocity_noise: float
    command_timeout_ns: int
    timeout_damping: float
    ambient_temperature: float
    heating: float
    cooling_time: float
    temperature_limit: float
    bus_voltage: float

    def __post_init__(self) -> None:
        for name in ("peak_torque", "no_load_speed", "encoder_counts", "command_timeout_ns", "cooling_time"):
            if not 0 < getattr(self, name) < math.inf:
                raise DriverConfigError(f"drive model: {name} = {getattr(self, name)} is not a positive number")
        for name in ("velocity_noise", "timeout_damping", "heating"):
            if not 0 <= getattr(self, name) < math.inf:
                raise DriverConfigError(f"drive model: {name} = {getattr(self, name)} is negative or not finite")


def parameter(models: Sequence[DriveModel], name: str) -> FloatArray:
    """One attribute of every drive as an array."""
    return np.array([getattr(model, name) for model in models], np.float64)


@compiled
def available_torque(torque: float, velocity: float, peak: float, slope: float) -> float:
    """A torque within the torque-speed curve; against the motion the full peak torque is available.

    Args:
        torque: wanted, N.m.
        velocity: rad/s, at the joint like the torque.
        peak: N.m, standing still.
        slope: N.m lost for each rad/s in the sense of motion.
    """
    upper = min(peak, max(0.0, peak - slope * velocity))
    lower = max(-peak, min(0.0, -peak - slope * velocity))
    return min(max(torque, lower), upper)


class Windings:
    """Temperatures of n motors: first-order heating by the square of the torque.

    They change over minutes, so they are worked out every 10 ms, with the torque of that moment.

    Attributes:
        excess: (n,) K above ambient.
        ambient: (n,) degC.
        updated_ns: time of the last update.
    """

    def __init__(self, models: Sequence[DriveModel]) -> None:
        self.ambient, self._cooling_rate = (
            parameter(models, "ambient_temperature"),
            1 / parameter(models, "cooling_time"),
        )
        self._heating = parameter(models, "heating")
        self._limit = parameter(models, "temperature_limit") - self.ambient
        self.excess, self.updated_ns = np.zeros(len(models)), 0

    def due(self, now_ns: int) -> bool:
        """Whether it is time for an update."""
        return now_ns - self.updated_ns >= _HEATING_PERIOD_NS

    def update(self, torque: FloatArray, now_ns: int) -> None:
        """Let the torques (n,) N.m act since the last update."""
        elapsed_s, self.updated_ns = (now_ns - self.updated_ns) * 1e-9, now_ns
        self.excess += elapsed_s * (self._heating * torque**2 - self._cooling_rate * self.excess)

    @property
    def hot(self) -> npt.NDArray[np.bool_]:
        """(n,) whether each motor is above its limit."""
        return self.excess > self._limit


class Encoders:
    """What n drives measure of their motion: counts from their zero, and a noisy speed at their output.

    Only drives of joints that turn on and on wrap at the ends of their range; the others never get there.

    Attributes:
        multiplier: (n,) turns of the drive for one turn of the joint, signed.
        radians_per_count: (n,).
    """

    def __init__(self, joints: Sequence[Joint], models: Sequence[DriveModel], seed: int) -> None:
        self.multiplier = column(joints, "multiplier")
        self.radians_per_count = 2 * math.pi / parameter(models, "encoder_counts")
        self._counts_per_radian = self.multiplier / self.radians_per_count
        self._noise = parameter(models, "velocity_noise")
        self._generator = np.random.Generator(np.random.PCG64(seed))
        self._shift = np.zeros((_NOISE_BLOCK, 2, len(joints)))
        self._shift[:, 0] = -self._counts_per_radian * column(joints, "offset")
        self._row = _NOISE_BLOCK
        self.write_to(np.zeros((2, len(joints))))
        first, last = np.array([joint.ranges.position for joint in joints]).T / self.radians_per_count
        continuous = column(joints, "continuous", np.bool_)
        self._middle, self._turn = 0.5 * (first + last), last - first
        self._wrapping_turn = np.where(continuous, self._turn, 0.0)

    def write_to(self, measured: FloatArray) -> None:
        """Put measurements into this array from now on: (2, n), counts and rad/s of the drives."""
        self._measured = measured

    def measure(self, position: FloatArray, velocity: FloatArray) -> None:
        """Measure joint positions (n,) rad and velocities (n,) rad/s."""
        row = self._row
        if row == _NOISE_BLOCK:
            shift = self._shift[:, 1]
            np.multiply(self._generator.standard_normal(shift.shape), self._noise, out=shift)
            row = 0
        self._row = row + 1
        _measure(
            position,
            velocity,
            self._counts_per_radian,
            self.multiplier,
            self._shift[row],
            self._middle,
            self._turn,
            self._wrapping_turn,
            self._measured,
        )

    def set_zero(self, drive: int, counts: float) -> None:
        """Move the zero of a drive to where it now measures `counts`."""
        self._shift[:, 0, drive] -= counts


@compiled
def _measure(
    position: FloatArray,
    velocity: FloatArray,
    counts_per_radian: FloatArray,
    multiplier: FloatArray,
    shift: FloatArray,
    middle: FloatArray,
    turn: FloatArray,
    wrapping_turn: FloatArray,
    measured: FloatArray,
) -> None:
    for drive in range(position.shape[0]):
        counts = np.rint(position[drive] * counts_per_radian[drive] + shift[0, drive])
        counts -= np.rint((counts - middle[drive]) / turn[drive]) * wrapping_turn[drive]
        measured[0, drive] = counts
        measured[1, drive] = velocity[drive] * multiplier[drive] + shift[1, drive]
