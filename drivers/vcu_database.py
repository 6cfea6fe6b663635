# SPDX-License-Identifier: Apache-2.0
"""The frames of a vehicle's control unit, as a DBC lays them out.

Messages and signals are known by their names; identifiers, lengths, places, byte orders and scales are the DBC's. Every
message carries an alive counter and a checksum over its identifier and all of its other bytes.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import cantools
from cantools.database.can import Database, Message, Signal
from cantools.database.errors import Error as DatabaseError

from drivers.can_frame import CAN_EFF_FLAG, MAX_DATA_LENGTH
from drivers.checksum import crc8
from drivers.errors import DriverConfigError

OWN_DBC = Path(__file__).with_name("vcu.dbc")
WHEEL_NAMES = ("FL", "FR", "RL", "RR")

Units = Mapping[str, str]
"""Signals of a message, and the unit of each."""

CODE = "code"
"""In the place of a unit: a whole number of at most 8 bits that stands for itself."""

COMMANDS: Mapping[str, Units] = {
    "UnitCommand": {"ModeCommand": CODE, "EnableCommand": CODE},
    **{f"WheelCommand_{wheel}": {"SteeringCommand": "rad", "SpeedCommand": "rad/s"} for wheel in WHEEL_NAMES},
}
"""What the controller sends: one message for the unit, then one a wheel."""

STATES: Mapping[str, Units] = {
    **{
        f"WheelState_{wheel}": {
            "SteeringAngle": "rad",
            "WheelSpeed": "rad/s",
            "MotorCurrent": "A",
            "SteeringFault": CODE,
            "DriveFault": CODE,
        }
        for wheel in WHEEL_NAMES
    },
    "UnitState": {
        "UnitMode": CODE,
        "UnitEnabled": CODE,
        "BatteryVoltage": "V",
        "BatteryCurrent": "A",
        "BatteryCharge": "",
    },
    "MotorTemperatures": {f"MotorTemperature_{wheel}": "degC" for wheel in WHEEL_NAMES},
}
"""What the unit sends: one message a wheel, one for the unit, and one of temperatures."""

COUNTER, CHECKSUM = "AliveCounter", "Checksum"
_PARSER_ERRORS = (DatabaseError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)
"""What cantools raises for text that is no DBC."""
_COUNTER_BITS, _CHECKSUM_BITS, _LARGEST_CODE = (2, 8), 8, 255


class Range(NamedTuple):
    """What a signal may be, both ends included, and the step of its values."""

    low: float
    high: float
    resolution: float


class GuardedMessage:
    """One message with its counter and checksum.

    Args:
        message: of cantools, checked.
        signals: those with a meaning, and their units; what else the message holds is sent as zero.

    Attributes:
        name: in the DBC.
        can_id: with the flag of an extended identifier.
        length: data bytes.
        counts: how many values the alive counter takes.
        ranges: of each signal.
    """

    def __init__(self, message: Message, signals: Units) -> None:
        self._message = message
        self.name, self.length = message.name, message.length
        self.can_id = message.frame_id | (CAN_EFF_FLAG if message.is_extended_frame else 0)
        self._identifier = message.frame_id.to_bytes(4 if message.is_extended_frame else 2, "big")
        self.counts = 1 << message.get_signal_by_name(COUNTER).length
        self._checksum_byte = message.get_signal_by_name(CHECKSUM).start // 8
        self.ranges = {name: _range(message.get_signal_by_name(name)) for name in signals}
        # half a step beyond either end, since decimal fractions are rounded
        self._accepted = [
            (name, found.low - 0.5 * found.resolution, found.high + 0.5 * found.resolution)
            for name, found in self.ranges.items()
        ]
        self._blank = {signal.name: 0.0 for signal in message.signals}

    def encode(self, values: Mapping[str, float], alive: int) -> bytes:
        """Data bytes with the nearest values that the signals can hold.

        Args:
            values: of all signals with a meaning, finite.
            alive: of the counter; its lowest bits are sent.
        """
        sent = dict(self._blank)
        for name, (low, high, _) in self.ranges.items():
            sent[name] = min(max(values[name], low), high)
        sent[COUNTER] = alive % self.counts
        data = bytearray(self._message.encode(sent, strict=False))
        data[self._checksum_byte] = self._checksum(data)
        return bytes(data)

    def intact(self, data: bytes) -> bool:
        """Whether the checksum is right; the length has to be."""
        return data[self._checksum_byte] == self._checksum(data)

    def decode(self, data: bytes) -> dict[str, float]:
        """Values of all signals, the counter's among them; the length has to be right."""
        return self._message.decode(data, decode_choices=False)  # type: ignore[return-value]

    def plausible(self, values: Mapping[str, float]) -> bool:
        """Whether each signal with a meaning is within its range."""
        return all(low <= values[name] <= high for name, low, high in self._accepted)

    def _checksum(self, data: bytes | bytearray) -> int:
        place = self._checksum_byte
        return crc8(self._identifier + data[:place] + data[place + 1 :])


class UnitDatabase:
    """All messages of a control unit.

    Args:
        path: of the DBC.

    Attributes:
        commands: in the order of `COMMANDS`.
        states: in the order of `STATES`.

    Raises:
        DriverConfigError: if the file cannot be read, lacks a message or a signal, or lays one out unusably.
    """

    def __init__(self, path: Path = OWN_DBC) -> None:
        database = _loaded(path)
        self.commands = tuple(_guarded(database, path.name, name, units) for name, units in COMMANDS.items())
        self.states = tuple(_guarded(database, path.name, name, units) for name, units in STATES.items())
        if len({message.counts for message in self.commands}) > 1:
            raise DriverConfigError(f"{path.name}: the signals {COUNTER} of the commands differ in length")
        names: dict[int, str] = {}
        for message in (*self.commands, *self.states):
            other = names.setdefault(message.can_id, message.name)
            if other != message.name:
                raise DriverConfigError(f"{path.name}: messages {other} and {message.name} share an identifier")


def _loaded(path: Path) -> Database:
    try:
        text = path.read_text(encoding="cp1252", errors="replace")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise DriverConfigError(f"{path.name}: cannot be read: {reason}") from None
    try:
        database = cantools.database.load_string(text, database_format="dbc")
    except _PARSER_ERRORS as error:
        raise DriverConfigError(f"{path.name}: not a valid DBC: {' '.join(str(error).split())}") from None
    assert isinstance(database, Database)
    return database


def _guarded(database: Database, file: str, name: str, units: Units) -> GuardedMessage:
    message = next((message for message in database.messages if message.name == name), None)
    if message is None:
        raise DriverConfigError(f"{file}: the message {name} is missing")
    place = f"{file}: message {name}"
    if message.length > MAX_DATA_LENGTH or message.is_fd:
        raise DriverConfigError(f"{place}: {message.length} bytes do not fit a classic CAN frame of {MAX_DATA_LENGTH}")
    if message.is_multiplexed():
        raise DriverConfigError(f"{place}: is multiplexed, which is not supported")
    signals = {signal.name: signal for signal in message.signals}
    for needed in (*units, COUNTER, CHECKSUM):
        if needed not in signals:
            raise DriverConfigError(f"{place}: the signal {needed} is missing")
    for needed, unit in units.items():
        _check_signal(signals[needed], unit, place)
    _check_guards(signals[COUNTER], signals[CHECKSUM], place)
    return GuardedMessage(message, units)


def _check_signal(signal: Signal, unit: str, place: str) -> None:
    found, declared, wanted = _range(signal), signal.unit or "", "" if unit == CODE else unit
    if declared != wanted:
        raise DriverConfigError(f"{place}: signal {signal.name}: the unit is '{declared}', not '{wanted}'")
    if unit == CODE and not (_is_plain(signal) and found.low >= 0 and found.high <= _LARGEST_CODE):
        raise DriverConfigError(f"{place}: signal {signal.name}: must be a plain number within 0 to {_LARGEST_CODE}")
    if not -math.inf < found.low < found.high < math.inf or not found.resolution > 0.0:
        raise DriverConfigError(f"{place}: signal {signal.name}: {found.low} to {found.high} is not a range")


def _check_guards(counter: Signal, checksum: Signal, place: str) -> None:
    least, most = _COUNTER_BITS
    if not least <= counter.length <= most or counter.is_signed or not _is_plain(counter):
        raise DriverConfigError(f"{place}: signal {COUNTER}: must be a plain number of {least} to {most} bits")
    edge = 7 if checksum.byte_order == "big_endian" else 0
    if checksum.length != _CHECKSUM_BITS or checksum.start % 8 != edge or not _is_plain(checksum):
        raise DriverConfigError(f"{place}: signal {CHECKSUM}: must be one whole byte")


def _is_plain(signal: Signal) -> bool:
    return bool(signal.scale == 1 and signal.offset == 0 and not signal.is_float)


def _range(signal: Signal) -> Range:
    """The range that the DBC declares, cut to what the bits can hold."""
    if signal.is_float:
        ends, step = (-sys.float_info.max, sys.float_info.max), sys.float_info.min
    else:
        first = -(1 << signal.length - 1) if signal.is_signed else 0
        last = first + (1 << signal.length) - 1
        ends = first * signal.scale + signal.offset, last * signal.scale + signal.offset
        step = abs(signal.scale)
    low = min(ends) if signal.minimum is None else max(min(ends), signal.minimum)
    high = max(ends) if signal.maximum is None else min(max(ends), signal.maximum)
    return Range(float(low), float(high), float(step))
