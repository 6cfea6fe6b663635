# SPDX-License-Identifier: Apache-2.0
"""One robot that walks in real time, and several faults one after the other, each after it has walked again."""

from __future__ import annotations

import ctypes
import os
import random
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from runtime.executors.processes import ProcessError
from runtime.executors.runtime_directory import runtime_directory
from runtime.recording.recorder_status import RecorderStatus, read_status
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.faults.injector import FRAMES_FILE, Order
from sim_bridge.faults.live_row import LiveRow
from sim_bridge.faults.relay import Relay
from sim_bridge.faults.stage import Stage
from sim_bridge.live_answers import LiveAnswers
from sim_bridge.live_buses import hub_buses
from sim_bridge.live_processes import LiveProcesses, wired
from sim_bridge.process import Task

ROBOT, SCENARIO = "uslgo1", "circle-6cm"
WALKS_WITHIN_S = 90.0
TELLS_WITHIN_S = 20.0
DISK_BYTES = 2 << 30
"""More than a campaign of a slow computer writes: only what is meant to fill the disk may."""
_LIBC = ctypes.CDLL(None, use_errno=True)
_MNT_DETACH = 2


class Frames(NamedTuple):
    """Commands as they arrived at the drives.

    Attributes:
        arrival_ns: (n,) on the monotonic clock.
        bus: (n,).
        raw: (n, 16).
    """

    arrival_ns: Any
    bus: Any
    raw: Any


class Episode(NamedTuple):
    """What one fault left behind beside the log.

    Attributes:
        row: the fault.
        at_ns, mended_ns, until_ns: when it struck, when it was put right, and until when it was watched; monotonic.
        released_ns: when the drives had no more than damping in force, None if that never was.
        joints_kept, fell: of the robot until then.
        frames: that the drives received.
        recorder: what the recorder said of itself at the end of the fault.
    """

    row: LiveRow
    at_ns: int
    mended_ns: int
    until_ns: int
    released_ns: int | None
    joints_kept: bool
    fell: bool
    frames: Frames
    recorder: RecorderStatus | None


def play(rows: Sequence[LiveRow], seed: int, logs: Path, told: Callable[[str], None]) -> list[Episode]:
    """Try faults in turn on one robot; gives those that could be tried.

    Args:
        rows: the faults, all of one configuration.
        seed: of the phases of the gait, and of what the faults leave to chance.
        logs: directory for the bags.
        told: told the name of each fault that was tried, and why the rest was not.

    Raises:
        ProcessError: if a process ends that is not to.
    """
    episodes: list[Episode] = []
    with runtime_directory() as directory, wired(ROBOT, rows[0].settings, directory, hub_buses) as (config, _):
        assert isinstance(config, Uslgo1Config)
        port = int(config.link.listen[0].rpartition(":")[2])
        with Relay(port) as relay:
            task = Task("", SCENARIO, seed, str(directory), duration_s=1e6, injects=True)
            task.operator_at = f"tcp/127.0.0.1:{relay.port}"
            with LiveProcesses(config, task, logs) as live, ExitStack() as held:
                answers = LiveAnswers(live.answers())
                stage = Stage(config, live, relay, logs, random.Random(seed), held)
                for row in rows:
                    if row.prepare is not None:
                        row.prepare(stage)
                    struck = len(answers.struck)
                    live.order(Order(row.name, seed, row.lasts_ns))
                    if not answers.wait_for_more(answers.struck, struck, WALKS_WITHIN_S):
                        told(f"{row.name}: {answers.ended or f'the robot did not walk within {WALKS_WITHIN_S:g} s'}")
                        break
                    try:
                        episodes.append(_episode(row, stage, answers, directory))
                    except ProcessError as error:
                        told(f"{row.name}: {error}")
                        break
                    told(row.name)
                live.stop()
    return episodes


def _episode(row: LiveRow, stage: Stage, answers: LiveAnswers, directory: Path) -> Episode:
    at_ns = answers.struck[-1][1]
    if row.act is not None:
        at_ns = time.monotonic_ns()
        row.act(stage)
    answers.rest(row.watched_ns(stage.config) * 1e-9)
    status, mended_ns = read_status(directory), time.monotonic_ns()
    if row.mend is not None:
        row.mend(stage)
    answers.rest(row.after_ns * 1e-9)
    count = len(answers.seen)
    stage.live.order(Order(None))
    if not answers.wait_for_more(answers.seen, count, TELLS_WITHIN_S):
        raise ProcessError(f"{row.name}: the simulator does not say what it saw")
    frames = frames_in(directory)
    return Episode(row, at_ns, mended_ns, time.monotonic_ns(), frames=frames, recorder=status, **answers.seen[-1])


def frames_in(directory: Path) -> Frames:
    """Commands that the drives received during a fault, as the simulator left them in the runtime directory."""
    with np.load(directory / FRAMES_FILE) as kept:
        return Frames(kept["arrival_ns"], kept["bus"], kept["raw"].reshape(-1, 16))


@contextmanager
def disk(directory: Path) -> Iterator[bool]:
    """Let a directory be a disk of its own, in memory; gives whether that was allowed."""
    mounted = _LIBC.mount(b"ugv-faults", os.fsencode(directory), b"tmpfs", 0, f"size={DISK_BYTES}".encode()) == 0
    try:
        yield mounted
    finally:
        if mounted:
            _LIBC.umount2(os.fsencode(directory), _MNT_DETACH)
