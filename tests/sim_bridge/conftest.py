# SPDX-License-Identifier: Apache-2.0
"""Bags that hold nothing but ticks of the fast loop, for what reads the logs of a run in real time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from runtime.executors.tick import ENTRY, TICK_TOPIC_PREFIX, Tick
from runtime.recording.bag import BagSink
from runtime.recording.setup import recording_setup
from runtime.tasks import Loop

WriteBag = Callable[..., Path]
PERIOD_NS = 2_000_000


@pytest.fixture
def write_bag() -> WriteBag:
    """Writes a bag of ticks of a loop of 500 Hz with some indices, of which some woke late; gives its directory."""

    def write(directory: Path, indices: Sequence[int], late: Sequence[int] = (), late_ns: int = 10_000_000) -> Path:
        loop = Loop("wbc", PERIOD_NS, PERIOD_NS // 2, 80, (), (), (), ())
        sink = BagSink(directory, recording_setup((loop,), "toy", "", 0, ()))
        for index in indices:
            tick = Tick(TICK_TOPIC_PREFIX + "wbc", {"received": 0})
            tick.index, tick.release_ns, tick.now_ns = index, index * PERIOD_NS, index * PERIOD_NS
            tick.wake_latency_ns = late_ns if index in late else 0
            body = tick.to_bytes()
            sink.write(ENTRY.pack(0, len(body)) + body)
        sink.close()
        return directory

    return write
