# SPDX-License-Identifier: Apache-2.0
"""What a log says of its own beginning, and of the clocks while it was written."""

from __future__ import annotations

import time

from runtime.recording.bags import CLOCK_PREFIX, FIRST_TICK_PREFIX
from runtime.recording.log import Log
from runtime.recording.setup import BEGINNING


def beginning(log: Log) -> str:
    """When, why and where the log begins, in a sentence; empty if it does not say."""
    entries = log.metadata.get(BEGINNING)
    if entries is None:
        return ""
    firsts = {
        name[len(FIRST_TICK_PREFIX) :]: content.get("index", "0")
        for name, content in log.metadata.items()
        if name.startswith(FIRST_TICK_PREFIX)
    }
    late = [f"tick {index} of {loop}" for loop, index in firsts.items() if index != "0"]
    sentence = f"begins {_utc(entries.get('utc_ns', ''))}"
    sentence += f" with {' and '.join(late)}, what was before is not in it" if late else " with the first ticks"
    if entries.get("previous"):
        sentence += f"; the log before it is {entries['previous']}"
    return f"{sentence} ({entries.get('reason', 'reason not said')})"


def clock_changes(log: Log) -> list[str]:
    """What happened to the clocks, with the time of the log at which it was noticed."""
    return [
        f"{entries.get('what', '')}, noticed at {_seconds(entries.get('monotonic_ns', ''), log.origin_ns)} s"
        for name, entries in log.metadata.items()
        if name.startswith(CLOCK_PREFIX)
    ]


def _utc(nanoseconds: str) -> str:
    try:
        return time.strftime("at %Y-%m-%d %H:%M:%S UTC", time.gmtime(int(nanoseconds) // 1_000_000_000))
    except (ValueError, OverflowError, OSError):
        return "at a time not said"


def _seconds(nanoseconds: str, origin_ns: int) -> str:
    return f"{(int(nanoseconds) - origin_ns) / 1e9:.3f}" if nanoseconds.isdecimal() and len(nanoseconds) < 20 else "?"
