# SPDX-License-Identifier: Apache-2.0
"""The dialects of MIT mode, as tables: which bits mean what, and on which identifiers.

All dialects carry a command in 8 bytes and answer each command with one frame; they differ in the order of the fields,
in the identifiers, and in what follows the torque in a reply. A new dialect is a new row here, not a branch in the
codec.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.can_frame import CAN_EFF_FLAG
from drivers.errors import DriverConfigError

COMMAND_FIELDS = ("position", "velocity", "effort", "stiffness", "damping")
"""Quantities of a command, in the order in which the codec takes them."""

REPLY_FIELDS = ("position", "velocity", "effort", "temperature", "driver_temperature", "voltage", "error", "id")
"""Quantities that a reply may carry, in the order in which the codec gives them."""


@dataclass(frozen=True)
class BitField:
    """A run of bits with a meaning.

    Attributes:
        name: one of `COMMAND_FIELDS` or `REPLY_FIELDS`.
        bits: width.
    """

    name: str
    bits: int


@dataclass(frozen=True)
class Ranges:
    """What the ends of each field mean, as set in the drive: (smallest code, largest code), at the drive's output.

    Attributes:
        position: rad; measured positions wrap from one end to the other.
        velocity: rad/s.
        effort: N.m.
        stiffness: N.m/rad.
        damping: N.m.s/rad.
        temperature: degC.
        voltage: V.
    """

    position: tuple[float, float]
    velocity: tuple[float, float]
    effort: tuple[float, float]
    stiffness: tuple[float, float]
    damping: tuple[float, float]
    temperature: tuple[float, float] = (0.0, 255.0)
    voltage: tuple[float, float] = (0.0, 255.0)

    def __post_init__(self) -> None:
        for name, (low, high) in vars(self).items():
            if not -float("inf") < low < high < float("inf"):
                raise DriverConfigError(f"range of {name}: {low} to {high} is not an increasing pair of finite numbers")

    def of(self, field: str, bits: int) -> tuple[float, float]:
        """Ends of a field; whole numbers (`error`, `id`) stand for themselves."""
        if field in ("error", "id"):
            return 0.0, float((1 << bits) - 1)
        ends: tuple[float, float] = getattr(self, {"driver_temperature": "temperature"}.get(field, field))
        return ends


@dataclass(frozen=True)
class Dialect:
    """One row of the table.

    Attributes:
        name: as in configurations.
        command: fields of a command, most significant bit first.
        reply: fields of a reply, most significant bit first.
        extended: 29-bit identifiers.
        command_base: combined with the drive's id to give the identifier of its commands.
        reply_base: combined with the drive's id to give the identifier of its replies; None if they go to a master id.
        enabled_code: error code by which a healthy enabled drive reports itself.
    """

    name: str
    command: tuple[BitField, ...]
    reply: tuple[BitField, ...]
    extended: bool = False
    command_base: int = 0
    reply_base: int | None = None
    enabled_code: int = 0

    @property
    def command_length(self) -> int:
        """Data bytes of a command."""
        return sum(field.bits for field in self.command) // 8

    @property
    def reply_length(self) -> int:
        """Data bytes of a reply; any other length is rejected."""
        return sum(field.bits for field in self.reply) // 8

    def command_id(self, drive_id: int) -> int:
        """`can_id` of the commands to a drive, flags included."""
        return drive_id | self.command_base | self._flags

    def reply_id(self, drive_id: int, master_id: int) -> int:
        """`can_id` of the replies of a drive, flags included."""
        return (master_id if self.reply_base is None else drive_id | self.reply_base) | self._flags

    @property
    def _flags(self) -> int:
        return CAN_EFF_FLAG if self.extended else 0


_POSITION = BitField("position", 16)
_VELOCITY = BitField("velocity", 12)
_STIFFNESS = BitField("stiffness", 12)
_DAMPING = BitField("damping", 12)
_EFFORT = BitField("effort", 12)
_MIT_COMMAND = (_POSITION, _VELOCITY, _STIFFNESS, _DAMPING, _EFFORT)
_MIT_REPLY = (BitField("id", 8), _POSITION, _VELOCITY, _EFFORT)
_TEMPERATURE_AND_ERROR = (BitField("temperature", 8), BitField("error", 8))

CLASSIC_6 = Dialect("classic-6", _MIT_COMMAND, _MIT_REPLY)
CLASSIC_7 = Dialect("classic-7", _MIT_COMMAND, (*_MIT_REPLY, BitField("voltage", 8)))
CLASSIC_8 = Dialect("classic-8", _MIT_COMMAND, _MIT_REPLY + _TEMPERATURE_AND_ERROR)
DAMIAO = Dialect(
    "damiao",
    _MIT_COMMAND,
    (
        BitField("error", 4),
        BitField("id", 4),
        _POSITION,
        _VELOCITY,
        _EFFORT,
        BitField("driver_temperature", 8),
        BitField("temperature", 8),
    ),
    enabled_code=1,
)
AK_V3 = Dialect(
    "ak-v3",
    (_STIFFNESS, _DAMPING, _POSITION, _VELOCITY, _EFFORT),
    _MIT_REPLY + _TEMPERATURE_AND_ERROR,
    extended=True,
    command_base=0x800,
    reply_base=0x2900,
)

DIALECTS = {dialect.name: dialect for dialect in (CLASSIC_6, CLASSIC_7, CLASSIC_8, DAMIAO, AK_V3)}


def dialect_named(name: str) -> Dialect:
    """Look a dialect up.

    Raises:
        DriverConfigError: if there is none of that name.
    """
    try:
        return DIALECTS[name]
    except KeyError:
        raise DriverConfigError(f"motor dialect '{name}' is unknown; there are {', '.join(sorted(DIALECTS))}") from None
