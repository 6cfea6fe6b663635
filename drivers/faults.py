# SPDX-License-Identifier: Apache-2.0
"""What a drive's error code means, and whether the robot must stop for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from drivers.dialects import AK_V3, CLASSIC_6, CLASSIC_7, CLASSIC_8, DAMIAO, Dialect


class FaultKind(Enum):
    """Causes, independent of a dialect's numbering."""

    NONE = "none"
    MOTOR_OVER_TEMPERATURE = "motor over-temperature"
    DRIVER_OVER_TEMPERATURE = "driver over-temperature"
    OVER_CURRENT = "over-current"
    OVER_VOLTAGE = "over-voltage"
    UNDER_VOLTAGE = "under-voltage"
    ENCODER = "encoder"
    LOST_COMMUNICATION = "lost communication"
    OVERLOAD = "overload"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class DriveFault:
    """An error code explained.

    Attributes:
        code: as the drive sent it.
        kind: the cause.
        sentence: one sentence for the operator.
        stops: whether the robot must stop; a code that is not known always does.
    """

    code: int
    kind: FaultKind
    sentence: str
    stops: bool


_SENTENCES = {
    FaultKind.NONE: "the drive reports no fault",
    FaultKind.MOTOR_OVER_TEMPERATURE: "the motor winding is too hot; the drive gives no torque until it has cooled",
    FaultKind.DRIVER_OVER_TEMPERATURE: "the drive's power stage is too hot; it gives no torque until it has cooled",
    FaultKind.OVER_CURRENT: "the phase current was above the drive's limit; look for a short or a blocked joint",
    FaultKind.OVER_VOLTAGE: "the supply voltage is above the drive's limit",
    FaultKind.UNDER_VOLTAGE: "the supply voltage is below the drive's limit; charge the battery",
    FaultKind.ENCODER: "the drive cannot read its encoder, so its position must not be trusted",
    FaultKind.LOST_COMMUNICATION: "the drive received no command within its time-out",
    FaultKind.OVERLOAD: "the motor was overloaded for too long",
}

_NUMBERED = {
    0: FaultKind.NONE,
    1: FaultKind.MOTOR_OVER_TEMPERATURE,
    2: FaultKind.OVER_CURRENT,
    3: FaultKind.OVER_VOLTAGE,
    4: FaultKind.UNDER_VOLTAGE,
    5: FaultKind.ENCODER,
    6: FaultKind.DRIVER_OVER_TEMPERATURE,
}
_DAMIAO = {
    0x0: FaultKind.NONE,
    0x1: FaultKind.NONE,
    0x8: FaultKind.OVER_VOLTAGE,
    0x9: FaultKind.UNDER_VOLTAGE,
    0xA: FaultKind.OVER_CURRENT,
    0xB: FaultKind.DRIVER_OVER_TEMPERATURE,
    0xC: FaultKind.MOTOR_OVER_TEMPERATURE,
    0xD: FaultKind.LOST_COMMUNICATION,
    0xE: FaultKind.OVERLOAD,
}
_SILENT = {0: FaultKind.NONE}

_TABLES: Mapping[str, Mapping[int, FaultKind]] = {
    CLASSIC_6.name: _SILENT,
    CLASSIC_7.name: _SILENT,
    CLASSIC_8.name: _NUMBERED,
    AK_V3.name: _NUMBERED,
    DAMIAO.name: _DAMIAO,
}


def explain_fault(dialect: Dialect, code: int, joint: str) -> DriveFault:
    """Explain the error code that a drive of `joint` sent."""
    kind = _TABLES[dialect.name].get(code, FaultKind.UNKNOWN)
    meaning = _SENTENCES.get(kind, f"the code is not in the table of the dialect {dialect.name}")
    return DriveFault(code, kind, f"drive of {joint}: error {code:#x}: {meaning}", kind is not FaultKind.NONE)


def is_healthy(dialect: Dialect, code: int) -> bool:
    """Whether a code means no fault (some dialects report enabled and disabled in the same place)."""
    return _TABLES[dialect.name].get(code) is FaultKind.NONE


def code_of(dialect: Dialect, kind: FaultKind) -> int | None:
    """The code by which drives of a dialect report a cause; None if they cannot."""
    for code, candidate in _TABLES[dialect.name].items():
        if candidate is kind:
            return code
    return None
