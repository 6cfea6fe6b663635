# SPDX-License-Identifier: Apache-2.0
"""Logs: what reads them, and what steps a robot again on them."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path
from types import SimpleNamespace

from fuzz_target import RECORDING, Target, file_of, room, toy

from runtime.errors import UgvError
from runtime.recording.bag import BagSink
from runtime.recording.log import Log
from runtime.recording.loop_timing import read_loop_times
from runtime.recording.recover import recover
from runtime.recording.replay import Replay
from runtime.recording.run_data import load_run


def decode_log(data: bytes) -> None:
    """Everything that reads a log, but for its replay."""
    with file_of(data, "run_0.mcap") as place:
        log = Log(place)
        for topic in log.channels:
            try:
                log.read_signal(topic)
            except UgvError:
                continue
        log.counts()
        recover(log, place.parent / "recovered")
        read_loop_times(log)
        load_run(place)


def decode_replay(data: bytes) -> None:
    """A replay of a log that was altered."""
    with file_of(data, "run_0.mcap") as place:
        Replay(Log(place), toy().loops(), "toy").run()


@functools.cache
def log_seeds() -> list[bytes]:
    """Logs of a short run, whole and cut off, compressed and not."""
    found = []
    for compression in ("", "zstd"):
        with tempfile.TemporaryDirectory(dir=room()) as directory:
            options = SimpleNamespace(chunk_bytes=4096, chunk_span_ns=20_000_000, sync_ns=0, compression=compression)
            sink = BagSink(Path(directory) / "run", toy().setup(), options)  # type: ignore[arg-type]
            for datagram in toy().datagrams(seconds=0.06, key_frame_ns=20_000_000):
                sink.write(datagram)
            sink.close()
            data = sink.path.read_bytes()
            found += [data, data[: 2 * len(data) // 3]]
    return found


TARGETS = (
    Target("log", decode_log, RECORDING, log_seeds),
    Target("replay", decode_replay, RECORDING, log_seeds),
)
