# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/BatteryState: what a battery reports, and what is reported of it.

The message's current is negative while the battery discharges; ours, drawn from the battery, is positive then.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from runtime.messages.cdr import CdrTemplate
from runtime.messages.cdr_reader import CdrReader
from runtime.signals import Battery

_SUPPLY_UNKNOWN, _HEALTH_UNKNOWN, _TECHNOLOGY_UNKNOWN = 0, 0, 0


class BatteryReport(NamedTuple):
    """What is used of a battery's state; NaN for what it does not measure.

    Attributes:
        stamp_ns: of the header.
        voltage: V.
        current: drawn, A.
        charge: 0 to 1.
    """

    stamp_ns: int
    voltage: float
    current: float
    charge: float


def decode_battery_state(payload: bytes) -> BatteryReport:
    """A sensor_msgs/BatteryState; MessageError if it is none."""
    reader = CdrReader(payload)
    stamp_ns, _ = reader.header()
    voltage, _, current, _, _, _, percentage = reader.numbers("f", 7)
    reader.numbers("B", 3)
    reader.boolean()
    for _ in ("voltages", "temperatures"):
        reader.array("f", reader.count())
    reader.string()
    reader.string()
    reader.finish()
    return BatteryReport(stamp_ns, voltage, -current, percentage)


class BatteryMessage:
    """Encodes /battery_state."""

    def __init__(self, frame: str = "base_link") -> None:
        self._template = template = CdrTemplate()
        self._stamp = template.header(frame)
        floats = template.float32(7)
        template.uint8(_SUPPLY_UNKNOWN, _HEALTH_UNKNOWN, _TECHNOLOGY_UNKNOWN, True)
        template.count(0)
        template.count(0)
        template.string("")
        template.string("")
        self._floats = template.float32_view(floats, 7)

    def encode(self, battery: Battery) -> bytes:
        """The message of one measurement; temperature, charge and capacities in Ah are not known."""
        self._template.set_stamp(self._stamp, battery.stamp_ns)
        self._floats[:] = (battery.voltage, math.nan, -battery.current, math.nan, math.nan, math.nan, battery.charge)
        return self._template.to_bytes()
