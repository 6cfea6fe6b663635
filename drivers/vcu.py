# SPDX-License-Identifier: Apache-2.0
"""The control unit of a vehicle with four steered and driven wheels, as the controller sees it.

Everything that must survive from one call to the next is in two places that the caller may own: `counters`, and the
`UnitReadings` given to `decode`. Wheels are ordered front left, front right, rear left, rear right.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
import numpy.typing as npt

from drivers.bus_load import MAX_BUS_LOAD, bearable
from drivers.can_frame import CAN_EFF_FLAG, CAN_FRAME, Frames, max_frame_bits
from drivers.guarded_frames import Flaw, GuardedReceiver
from drivers.vcu_database import COMMANDS, OWN_DBC, STATES, WHEEL_NAMES, GuardedMessage, UnitDatabase

FloatArray = npt.NDArray[np.float64]

WHEELS = len(WHEEL_NAMES)
COMMAND_FRAMES, STATE_FRAMES = len(COMMANDS), len(STATES)
UNIT_STATE, TEMPERATURES = WHEELS, WHEELS + 1
"""State frames by index; those before are the wheels'."""


class UnitCommandMode(IntEnum):
    """What the unit is to do."""

    BRAKE = 0
    DRIVE = 1


class UnitMode(IntEnum):
    """What the unit says that it does."""

    OFF = 0
    BRAKED = 1
    DRIVE = 2
    TIMED_OUT = 3


class WheelFault(IntEnum):
    """Fault codes of a steering or a driving motor."""

    NONE = 0
    OVER_TEMPERATURE = 1
    OVER_CURRENT = 2
    STUCK = 3
    ENCODER = 4
    NO_ANSWER = 5
    UNDER_VOLTAGE = 6


class Counter(IntEnum):
    """Meaning of each element of `VehicleUnit.counters`; from `CHECKSUM` on in the order of `Flaw`."""

    SENT = 0
    LIMITED_STEERING = 1
    LIMITED_SPEED = 2
    STALE_COMMAND = 3
    NON_FINITE_COMMAND = 4
    CHECKSUM = 5
    STALLED = 6
    MISSED = 7
    WRONG_LENGTH = 8
    UNKNOWN_ID = 9
    ERROR_FRAME = 10
    REMOTE_FRAME = 11
    OUT_OF_RANGE = 12


FLAWS = slice(Counter.CHECKSUM, Counter.CHECKSUM + len(Flaw))
"""The counters of what was wrong with received frames."""
REJECTED = slice(Counter.WRONG_LENGTH, Counter.OUT_OF_RANGE + 1)
"""The counters of rejected frames, but for those that their guards betray."""


@dataclass(frozen=True)
class UnitReadings:
    """What the unit last said; `decode` writes into these arrays.

    Attributes:
        steering: (4,) rad, positive to the left.
        speed: (4,) rad/s, positive forward.
        current: (4,) A, of the driving motors.
        temperature: (4,) degC, of the driving motors.
        fault: (8,) `WheelFault`, the steering motors' before the driving motors'.
        reply_ns: (6,) arrival of the last valid state frame of each kind, 0 if there was none yet.
        alive: (6,) one more than the counter of each kind's last frame, 0 if there was none.
        status: (2,) `UnitMode`, and whether the unit is enabled.
        battery: (3,) V, A, and the charge from 0 to 1.
    """

    steering: FloatArray
    speed: FloatArray
    current: FloatArray
    temperature: FloatArray
    fault: npt.NDArray[np.uint8]
    reply_ns: npt.NDArray[np.int64]
    alive: npt.NDArray[np.uint32]
    status: npt.NDArray[np.uint8]
    battery: FloatArray

    @classmethod
    def empty(cls) -> UnitReadings:
        """Readings before any frame."""
        steering, speed, current = np.zeros((3, WHEELS))
        temperature = np.full(WHEELS, np.nan)
        fault, status = np.zeros(2 * WHEELS, np.uint8), np.zeros(2, np.uint8)
        reply_ns, alive = np.zeros(STATE_FRAMES, np.int64), np.zeros(STATE_FRAMES, np.uint32)
        return cls(steering, speed, current, temperature, fault, reply_ns, alive, status, np.zeros(3))

    @property
    def mode(self) -> int:
        """`UnitMode`."""
        return int(self.status[0])

    @property
    def enabled(self) -> bool:
        """Whether the motors have power."""
        return bool(self.status[1])


class VehicleUnit:
    """Encodes commands to the unit and decodes its states.

    Args:
        max_command_age_ns: ns; an older command is replaced by braking.
        dbc: describes the frames.
        bus: index of the bus that the unit is on.
        counters: (len(Counter),) uint32 array to count in; None for one of its own.

    Attributes:
        database: made of the DBC.
        counters: as given.
        bus: (5,) bus index of each command frame.
        frames: (5,) command frames of the last `encode`.
        data: (80,) their bytes.

    Raises:
        DriverConfigError: if the DBC cannot be used.
    """

    def __init__(
        self,
        max_command_age_ns: int,
        dbc: Path = OWN_DBC,
        bus: int = 0,
        counters: npt.NDArray[np.uint32] | None = None,
    ) -> None:
        self.database, self.max_command_age_ns = UnitDatabase(dbc), max_command_age_ns
        self.counters = np.zeros(len(Counter), np.uint32) if counters is None else counters
        self._receiver = GuardedReceiver(self.database.states, bus)
        commands = self.database.commands
        self.bus = np.full(len(commands), bus, np.uint8)
        self.frames = np.zeros(len(commands), CAN_FRAME)
        self.frames["can_id"] = [message.can_id for message in commands]
        self.frames["length"] = [message.length for message in commands]
        self.data = self.frames.view(np.uint8)
        self._steering_range, self._speed_range = (
            np.array([message.ranges[name][:2] for message in commands[1:]]).T
            for name in ("SteeringCommand", "SpeedCommand")
        )
        self._rest = tuple(np.clip(0.0, *bounds).tolist() for bounds in (self._steering_range, self._speed_range))

    # -- commands -------------------------------------------------------------------------------------------------

    def encode(
        self, mode: int, enable: bool, steering: FloatArray, speed: FloatArray, stamp_ns: int, now_ns: int
    ) -> Frames:
        """Encode one set of commands into `frames`.

        Values beyond what the frames can hold are clipped and counted. A command older than the bound (or stamped
        after `now_ns`), or with any value that is not finite, is replaced by braking; that is counted too.

        Args:
            mode: `UnitCommandMode`; any other number is taken for BRAKE.
            enable: whether the motors are to have power.
            steering: (4,) rad, positive to the left.
            speed: (4,) rad/s, positive forward.
            stamp_ns: when the command was made.
            now_ns: the present.

        Returns:
            `frames`, overwritten by the next call.
        """
        if not 0 <= now_ns - stamp_ns <= self.max_command_age_ns:
            self.counters[Counter.STALE_COMMAND] += 1
            return self.encode_braking(enable)
        if not (np.isfinite(steering).all() and np.isfinite(speed).all()):
            self.counters[Counter.NON_FINITE_COMMAND] += 1
            return self.encode_braking(enable)
        angles = self._limited(steering, self._steering_range, Counter.LIMITED_STEERING)
        speeds = self._limited(speed, self._speed_range, Counter.LIMITED_SPEED)
        chosen = UnitCommandMode.DRIVE if mode == UnitCommandMode.DRIVE else UnitCommandMode.BRAKE
        return self._encode(chosen, enable, angles, speeds)

    def encode_braking(self, enable: bool) -> Frames:
        """Encode a set that brakes the vehicle to a stand into `frames`."""
        return self._encode(UnitCommandMode.BRAKE, enable, *self._rest)

    def _encode(self, mode: UnitCommandMode, enable: bool, steering: list[float], speed: list[float]) -> Frames:
        alive = int(self.counters[Counter.SENT])
        self.counters[Counter.SENT] += 1
        unit, *wheels = self.database.commands
        _put(self.frames, 0, unit.encode({"ModeCommand": mode, "EnableCommand": enable}, alive))
        for row, (message, angle, rate) in enumerate(zip(wheels, steering, speed, strict=True), start=1):
            _put(self.frames, row, message.encode({"SteeringCommand": angle, "SpeedCommand": rate}, alive))
        return self.frames

    def _limited(self, values: FloatArray, bounds: FloatArray, counter: Counter) -> list[float]:
        limited = np.clip(values, *bounds)
        altered = np.count_nonzero(limited != values)
        if altered:
            self.counters[counter] += altered
        return limited.tolist()

    # -- states ---------------------------------------------------------------------------------------------------

    def decode(
        self,
        frames: Frames,
        bus: npt.NDArray[np.uint8],
        arrival_ns: npt.NDArray[np.int64],
        count: int,
        readings: UnitReadings,
    ) -> int:
        """Take up state frames; of several of one kind the last counts.

        Frames of wrong length, checksum or unknown id, error frames, remote frames, frames whose alive counter did not
        go on, and values that are not plausible are rejected and counted; so are frames that never came.

        Args:
            frames: of which the first `count` are looked at.
            bus: bus index of each.
            arrival_ns: ns, of each.
            count: how many.
            readings: updated.

        Returns:
            How many frames were accepted.
        """
        flaws, accepted = self.counters[FLAWS], 0
        for kind, values, at_ns in self._receiver.accepted(
            frames[:count], bus[:count], arrival_ns[:count], readings.alive, flaws
        ):
            if kind < WHEELS:
                readings.steering[kind] = values["SteeringAngle"]
                readings.speed[kind] = values["WheelSpeed"]
                readings.current[kind] = values["MotorCurrent"]
                readings.fault[kind] = values["SteeringFault"]
                readings.fault[WHEELS + kind] = values["DriveFault"]
            elif kind == UNIT_STATE:
                readings.status[:] = values["UnitMode"], values["UnitEnabled"]
                readings.battery[:] = values["BatteryVoltage"], values["BatteryCurrent"], values["BatteryCharge"]
            else:
                readings.temperature[:] = [values[f"MotorTemperature_{wheel}"] for wheel in WHEEL_NAMES]
            readings.reply_ns[kind] = at_ns
            accepted += 1
        return accepted

    # -- the bus --------------------------------------------------------------------------------------------------

    def check_bus_load(self, rate_hz: float, bit_rate: float, bus: str = "bus", bound: float = MAX_BUS_LOAD) -> float:
        """Share of the bus's time (1 is full) when all frames come at a rate and have the most stuff bits.

        Raises:
            DriverConfigError: if it is above the bound; the sentence names rate, load, bound and the highest possible
                rate.
        """
        bits = sum(_longest_bits(message) for message in (*self.database.commands, *self.database.states))
        return bearable(bits * rate_hz / bit_rate, "the control unit", rate_hz, bit_rate, bus, bound)


def _longest_bits(message: GuardedMessage) -> int:
    return max_frame_bits(message.length, bool(message.can_id & CAN_EFF_FLAG))


def _put(frames: Frames, row: int, data: bytes) -> None:
    frames["data"][row, : len(data)] = np.frombuffer(data, np.uint8)
