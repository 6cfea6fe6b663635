# SPDX-License-Identifier: Apache-2.0
"""How late a vehicle answers, learnt from what it was asked and what it did.

A bank of models answers the same commands, each after another delay. The steering and the speed of the vehicle are
compared with each of them; the delay of the model that has matched best lately is the estimate. Where nothing changes
all models match alike, and the estimate stays as it was.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt
from msgspec import Meta

from runtime.tracking.vehicle_answer import VehicleAnswer

Array = npt.NDArray[np.float64]

CANDIDATES = 26
COMMANDS = 128
"""Commands that are remembered: 2.5 s at 50 Hz."""
FIELDS = 3
TIE = 1e-12


class DelayConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the estimate.

    Attributes:
        initial_s: delay before anything has been learnt.
        maximum_s: greatest delay; with 0 none is reckoned with, nor learnt.
        memory_s: time constant over which mismatches are forgotten, counted while something changes.
        angle_scale_rad: mismatch of the centre angle that counts as much as that of the speed below.
        speed_scale_mps: see there.
        evidence: how far apart, in squared scales times seconds, the best and the worst model have to be before the
            estimate follows.
        rate_per_s: greatest change of the estimate.
    """

    initial_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.2
    maximum_s: Annotated[float, Meta(ge=0.0, le=2.0)] = 1.0
    memory_s: Annotated[float, Meta(gt=0.0, le=60.0)] = 5.0
    angle_scale_rad: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.02
    speed_scale_mps: Annotated[float, Meta(gt=0.0, le=1.0)] = 0.05
    evidence: Annotated[float, Meta(gt=0.0, le=100.0)] = 1.0
    rate_per_s: Annotated[float, Meta(gt=0.0, le=10.0)] = 0.5

    def __post_init__(self) -> None:
        """Check the bounds against each other.

        Raises:
            ValueError: if they cross.
        """
        if self.initial_s > self.maximum_s:
            raise ValueError(f"initial_s = {self.initial_s} is above maximum_s = {self.maximum_s}")


class DelayEstimator:
    """The delay from a command to the wheels, within bounds.

    Args:
        config: parameters.
        answer: of the vehicle, the delay apart.
        memory: all that is remembered from step to step, `DelayEstimator.SIZE` numbers; `forget` before the first.

    Attributes:
        memory: as above.
    """

    SIZE = 2 + 3 * CANDIDATES + FIELDS * COMMANDS

    def __init__(self, config: DelayConfig, answer: VehicleAnswer, memory: Array | None = None) -> None:
        self._config, self._answer = config, answer
        self.memory = np.zeros(self.SIZE) if memory is None else memory
        self._scalars, rest = self.memory[:2], self.memory[2:]
        self._angle, self._speed, self._mismatch = rest[: 3 * CANDIDATES].reshape(3, CANDIDATES)
        self._commands = rest[3 * CANDIDATES :].reshape(COMMANDS, FIELDS)
        self._delays = np.linspace(0.0, config.maximum_s, CANDIDATES)
        if memory is None:
            self.forget()

    def forget(self) -> None:
        """Forget what has been learnt."""
        self.memory[:] = 0.0
        self._scalars[1] = self._config.initial_s

    def pause(self) -> None:
        """Forget the commands, but not what has been learnt: the vehicle does not obey at present."""
        self._scalars[0], self._commands[:] = 0.0, 0.0

    @property
    def delay_s(self) -> float:
        """The estimate."""
        return float(self._scalars[1])

    def step(self, now_s: float, angle: float, speed: float) -> None:
        """Compare what the vehicle does now with what each model does.

        Args:
            now_s: time, positive.
            angle: measured centre angle, rad.
            speed: measured, m/s.
        """
        last = float(self._scalars[0])
        self._scalars[0] = now_s
        dt = now_s - last
        if last <= 0.0 or not 0.0 < dt <= self._config.maximum_s:
            self._angle[:], self._speed[:] = angle, speed
            return
        asked = self._commands[np.searchsorted(self._commands[:, 0], now_s - dt - self._delays, side="right") - 1]
        known = asked[:, 0] > 0.0
        self._angle += np.where(known, self._turned(asked[:, 2] - self._angle, dt), angle - self._angle)
        most = self._answer.acceleration_mps2 * dt
        self._speed += np.where(known, np.clip(asked[:, 1] - self._speed, -most, most), speed - self._speed)
        config = self._config
        squares = ((self._angle - angle) / config.angle_scale_rad) ** 2
        squares += ((self._speed - speed) / config.speed_scale_mps) ** 2
        spread = float(np.ptp(squares))
        # what does not tell the models apart is no reason to forget what did
        self._mismatch *= 1.0 - min(dt / config.memory_s, 1.0) * min(spread, 1.0)
        self._mismatch += dt * squares
        self._follow(dt)

    def add(self, now_s: float, speed: float, angle: float) -> None:
        """Remember a command (m/s and centre angle in rad) that is given now."""
        self._commands[:-1] = self._commands[1:]
        self._commands[-1] = now_s, speed, angle

    def _turned(self, change: Array, dt: float) -> Array:
        if self._answer.lag_s > 0.0:
            change = change * -np.expm1(-dt / self._answer.lag_s)
        most = self._answer.rate_radps * dt
        return np.clip(change, -most, most)

    def _follow(self, dt: float) -> None:
        """Move the estimate towards the best model's delay."""
        mismatch = self._mismatch
        best = int(mismatch.argmin())
        if float(np.ptp(mismatch)) < self._config.evidence:
            return
        wanted = float(self._delays[best])
        if 0 < best < CANDIDATES - 1:
            below, at, above = mismatch[best - 1 : best + 2].tolist()
            bend = below - 2.0 * at + above
            if bend > TIE:
                wanted += 0.5 * (below - above) / bend * float(self._delays[1])
        most = self._config.rate_per_s * dt
        present = self.delay_s
        self._scalars[1] = present + min(max(wanted - present, -most), most)
