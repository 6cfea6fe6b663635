# SPDX-License-Identifier: Apache-2.0
"""Clocks that loops sleep by, and that logs are dated by."""

from __future__ import annotations

import ctypes
import time
from pathlib import Path

from runtime.cli.fitness.finding import Finding, fail, ok, warn

GOOD_SOURCES = ("tsc", "arch_sys_counter", "kvm-clock")
"""Read without leaving the processor, and never set."""
_SOURCE = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
_TIME_ERROR = 5
_TIMEX_BYTES = 512


def read_source() -> str:
    """Name of the clock that the kernel keeps time by; empty if it does not tell."""
    return _SOURCE.read_text().strip() if _SOURCE.is_file() else ""


def read_resolution_s() -> float:
    """Of the clock that loops sleep by."""
    return time.clock_getres(time.CLOCK_MONOTONIC)


def read_synchronised() -> bool:
    """Whether something keeps the date right, whichever program that is."""
    unchanged = ctypes.create_string_buffer(_TIMEX_BYTES)
    state: int = ctypes.CDLL(None).adjtimex(unchanged)
    return 0 <= state < _TIME_ERROR


def check_source(source: str, resolution_s: float) -> Finding:
    """The clock is fine and fast enough to sleep by."""
    if resolution_s > 1e-6:
        sentence = f"timers have a resolution of {resolution_s * 1e3:g} ms"
        return fail("clock", sentence, "use a kernel with CONFIG_HIGH_RES_TIMERS")
    if source not in GOOD_SOURCES:
        sentence = f"the kernel keeps time by {source or 'an unknown source'}, which is slow to read"
        return warn("clock", sentence, f"boot with a clocksource of {', '.join(GOOD_SOURCES)}")
    return ok("clock", f"{source}, to the nanosecond")


def check_date(synchronised: bool) -> Finding:
    """Messages of other computers can be dated against ours."""
    if synchronised:
        return ok("date", "is kept synchronised")
    return warn(
        "date",
        "nothing keeps the date synchronised, so the age of messages from other computers is not known",
        "start systemd-timesyncd, chrony or ptp4l",
    )
