# SPDX-License-Identifier: Apache-2.0
"""All bags of one recorder as one log: signals, ticks and stalls by the monotonic clock."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording.errors import LogError
from runtime.recording.log import Log, Signal
from runtime.recording.stalls import Stall, stalls_in
from runtime.robots import topics

FAST, LOOPS = "wbc", ("wbc", "mpc", "link", "sim")


class LiveLogs:
    """The bags in a directory, in the order in which they begin.

    Args:
        directory: of the recorder.
        wanted: topics beside those that every judgement needs.

    Attributes:
        bags: the logs.
        stalls: of all loops.
    """

    def __init__(self, directory: Path, wanted: Collection[str]) -> None:
        found = [log for log in map(_opened, directory.iterdir()) if log is not None]
        self.bags = sorted(found, key=lambda log: log.start_ns)
        self.stalls: list[Stall] = []
        ticks = {TICK_TOPIC_PREFIX + loop: loop for loop in LOOPS}
        read = {topics.SAFETY, topics.GAIT, topics.JOINT_COMMAND_SAFE, topics.CAN_SENT, *ticks}
        parts: dict[str, list[Signal]] = {topic: [] for topic in read | set(wanted)}
        for log in self.bags:
            for topic, signal in log.read_signals(sorted(parts.keys() & log.channels.keys())).items():
                parts[topic].append(signal)
                if topic in ticks:
                    self.stalls += stalls_in(ticks[topic], signal.values)
        self._signals = {
            topic: Signal(
                np.concatenate([part.log_ns for part in signals]), np.concatenate([part.values for part in signals])
            )
            for topic, signals in parts.items()
            if signals
        }

    def whole(self, topic: str) -> Signal:
        """All that was logged of a topic."""
        return self._signals[topic]

    def between(self, topic: str, from_ns: int, until_ns: int) -> Signal:
        """What was logged of a topic from a time until before another."""
        signal = self._signals[topic]
        rows = slice(*np.searchsorted(signal.log_ns, (from_ns, until_ns)).tolist())
        return Signal(signal.log_ns[rows], signal.values[rows])

    def stalls_between(self, from_ns: int, until_ns: int, without: Collection[str] = ()) -> list[Stall]:
        """Stalls that reach into a time, but for those of some loops."""
        return [
            stall
            for stall in self.stalls
            if stall.loop not in without and stall.at_ns < until_ns and stall.at_ns + stall.length_ns > from_ns
        ]

    def ticks(self, from_ns: int, until_ns: int) -> npt.NDArray[Any]:
        """Ticks of the fast loop."""
        return self.between(TICK_TOPIC_PREFIX + FAST, from_ns, until_ns).values


def _opened(directory: Path) -> Log | None:
    """The bag in a directory, if it came to hold anything."""
    try:
        return Log(directory) if directory.is_dir() else None
    except LogError:
        return None
