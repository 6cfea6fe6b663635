# SPDX-License-Identifier: Apache-2.0
"""diagnostic_msgs/DiagnosticArray: how each part of the robot is, in words and figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from runtime.messages.cdr import CdrTemplate


class Level(IntEnum):
    """How bad it is."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Status:
    """How one part is.

    Attributes:
        name: of the part.
        level: how bad.
        message: in words.
        values: in figures.
    """

    name: str
    level: Level
    message: str
    values: Mapping[str, object] = field(default_factory=dict)


def encode_diagnostics(stamp_ns: int, statuses: Iterable[Status], hardware: str) -> bytes:
    """The message on some parts of a piece of hardware."""
    template = CdrTemplate()
    stamp = template.header("")
    listed = list(statuses)
    template.count(len(listed))
    for status in listed:
        template.uint8(status.level)
        template.string(status.name)
        template.string(status.message)
        template.string(hardware)
        template.count(len(status.values))
        for key, value in status.values.items():
            template.string(key)
            template.string(str(value))
    template.set_stamp(stamp, stamp_ns)
    return template.to_bytes()
