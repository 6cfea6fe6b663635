# SPDX-License-Identifier: Apache-2.0
"""How full a CAN bus is when every drive on it is commanded and answers in every period."""

from __future__ import annotations

from collections.abc import Callable

from drivers.can_frame import max_frame_bits, min_frame_bits
from drivers.dialects import Dialect
from drivers.errors import DriverConfigError

MAX_BUS_LOAD = 0.85
"""Above this an error frame or a repetition no longer fits into the period."""


def worst_bus_load(dialect: Dialect, drives: int, rate_hz: float, bit_rate: float) -> float:
    """Share of the bus's time (1 is full) when every frame has the most stuff bits.

    Args:
        dialect: gives length and kind of the frames.
        drives: on this one bus.
        rate_hz: commands to each drive in a second; each is answered.
        bit_rate: bit/s.
    """
    return _load(max_frame_bits, dialect, drives, rate_hz, bit_rate)


def least_bus_load(dialect: Dialect, drives: int, rate_hz: float, bit_rate: float) -> float:
    """The same when no frame has a stuff bit."""
    return _load(min_frame_bits, dialect, drives, rate_hz, bit_rate)


def check_bus_load(
    dialect: Dialect, drives: int, rate_hz: float, bit_rate: float, bus: str = "bus", bound: float = MAX_BUS_LOAD
) -> float:
    """Worst-case load of a bus that can carry it.

    Raises:
        DriverConfigError: if it is above the bound; the sentence names rate, load, bound and the highest possible rate.
    """
    load = worst_bus_load(dialect, drives, rate_hz, bit_rate)
    return bearable(load, f"{drives} {dialect.name} drives", rate_hz, bit_rate, bus, bound)


def bearable(
    load: float, talkers: str, rate_hz: float, bit_rate: float, bus: str = "bus", bound: float = MAX_BUS_LOAD
) -> float:
    """A load that is known, if a bus can carry it.

    Raises:
        DriverConfigError: if it is above the bound; the sentence names who talks, rate, load, bound and the highest
            possible rate.
    """
    if load > bound:
        highest = rate_hz * bound / load
        raise DriverConfigError(
            f"{bus}: {rate_hz:g} Hz with {talkers} loads {bit_rate / 1e6:g} Mbit/s by {load:.1%}, "
            f"above the bound of {bound:.0%}; at most {highest:.0f} Hz fit"
        )
    return load


def _load(bits: Callable[[int, bool], int], dialect: Dialect, drives: int, rate_hz: float, bit_rate: float) -> float:
    pair = bits(dialect.command_length, dialect.extended) + bits(dialect.reply_length, dialect.extended)
    return drives * rate_hz * pair / bit_rate
