# SPDX-License-Identifier: Apache-2.0
"""A tiny robot of two loops: a fast one that filters a sensor, and a slow one that plans from that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from runtime import signals
from runtime.executors.lockstep import Delays, Lockstep, no_delay
from runtime.executors.realtime import RealTime
from runtime.executors.tick import ENTRY, Tick, tick_record
from runtime.recording.bag import BagOptions, BagSink
from runtime.recording.setup import Attachment, RecordingSetup, recording_setup
from runtime.records import Record, float64, float64_array, int64, uint32
from runtime.tasks import Loop, Scheduled, Task

SIZES = {"joint": 3, "foot": 4, "foot_xyz": 12, "foot_pair": 16, "path": 5, "frame": 4, "frame_byte": 64}
JOINTS = ("hip", "thigh", "calf")
SMALL_CHUNKS = BagOptions(chunk_bytes=4096, chunk_span_ns=20_000_000, sync_ns=0, compression="")


class Filtered(Record):
    """What the fast loop makes of its sensor."""

    stamp_ns = int64("ns")
    value = float64_array("joint", "rad")
    mean = float64("rad")


class FilterState(Record):
    """The memory of the filter."""

    value = float64_array("joint", "rad")
    steps = uint32()


class Plan(Record):
    """What the slow loop asks."""

    stamp_ns = int64("ns")
    target = float64_array("joint", "rad")


class Note(Record):
    """Logged only when it changes."""

    on_change = True
    crossings = uint32("", "times that the mean changed its sign")


class Filter(Task):
    """A first-order filter towards sensor and plan, with a gain that can be changed."""

    name = "filter"

    def __init__(self, joints: signals.JointState, plan: Plan, gain: float) -> None:
        self.joints, self.plan, self.gain = joints, plan, gain
        self.output, self.note = Filtered("/ugv/filtered", SIZES), Note("/ugv/note")
        self.state: FilterState = FilterState("/ugv/state/filter", SIZES)
        self.reads, self.writes = (joints, plan), (self.output, self.note)

    def step(self, now_ns: int) -> None:
        value = self.state.value
        value += self.gain * (self.joints.position + 0.1 * self.plan.target - value)
        self.state.steps += 1
        mean = float(value.mean())
        if (mean > 0.0) != (self.output.mean > 0.0):
            self.note.crossings += 1
        self.output.stamp_ns, self.output.value, self.output.mean = now_ns, value, mean


class Body(Task):
    """Every third tick: an estimate and a path, so that the standard topics have a source."""

    name = "body"

    def __init__(self, filtered: Filtered) -> None:
        self.filtered, self.state = filtered, None
        self.body, self.path = signals.BodyState("/ugv/body_state", SIZES), signals.Path("/ugv/path", SIZES)
        self.reads, self.writes = (filtered,), (self.body, self.path)

    def step(self, now_ns: int) -> None:
        self.body.stamp_ns, self.body.orientation = now_ns, (0.0, 0.0, 0.0, 1.0)
        self.body.position = self.filtered.value * 2.0
        self.path.count, self.path.x = 5, np.arange(5.0)


class Planner(Task):
    """Steps the opposite way of what it hears."""

    name = "planner"

    def __init__(self, filtered: Filtered, path: signals.Path) -> None:
        self.filtered, self.path, self.state = filtered, path, None
        self.plan, self.command = Plan("/ugv/plan", SIZES), signals.BodyCommand("/ugv/body_command", SIZES)
        self.reads, self.writes = (filtered, path), (self.plan, self.command)

    def step(self, now_ns: int) -> None:
        self.plan.stamp_ns, self.plan.target = now_ns, -self.filtered.value * self.path.x[1]
        self.command.stamp_ns, self.command.velocity = now_ns, (self.filtered.mean, 0.0)


def make_loops(gain: float = 0.3) -> tuple[Loop, ...]:
    """Fresh loops."""
    joints, imu = signals.JointState("/ugv/joint_state", SIZES), signals.Imu("/ugv/imu", SIZES)
    plan = Plan("/ugv/plan", SIZES)
    fast = Filter(joints, plan, gain)
    body = Body(fast.output)
    slow = Planner(fast.output.like(), body.path.like())
    return (
        Loop("fast", 2_000_000, 1_000_000, 80, (joints, imu), (plan,), (Scheduled(fast), Scheduled(body, 3)), ()),
        Loop("slow", 20_000_000, 10_000_000, 60, (), (slow.filtered, slow.path), (Scheduled(slow),), ()),
    )


class Sensor:
    """An input port: a wave with seeded noise; the inertial one gives a sample at every other read."""

    def __init__(self, seed: int) -> None:
        self.random, self.reads = np.random.default_rng(seed), 0

    def read(self, record: Record, now_ns: int) -> bool:
        """Fill the record."""
        self.reads += 1
        if isinstance(record, signals.JointState):
            record.stamp_ns = now_ns
            record.position = np.sin(now_ns * 2e-8 + np.arange(3)) + 0.01 * self.random.standard_normal(3)
            return True
        if self.reads % 2:
            return False
        record.stamp_ns = now_ns  # type: ignore[attr-defined]
        return True


class Nowhere:
    """A world without content."""

    def advance(self, until_ns: int) -> None:
        """Let time pass."""


class Datagrams(list[bytes]):
    """A sink that keeps what it is given."""

    dropped = 0

    def write(self, datagram: bytes) -> None:
        """Keep it."""
        self.append(datagram)


def datagrams(
    seconds: float = 0.5, seed: int = 0, key_frame_ns: int = 100_000_000, delays: Delays = no_delay
) -> Datagrams:
    """What a run of the tiny robot hands to its recorder."""
    sink = Datagrams()
    ports = {"/ugv/joint_state": Sensor(seed), "/ugv/imu": Sensor(seed + 1)}
    run = Lockstep(make_loops(), ports, {}, Nowhere(), sink, key_frame_ns, delays)
    run.run(int(seconds * 1e9), lambda now_ns: now_ns >= seconds * 1e9)
    return sink


class LastSensor(Sensor):
    """A sensor whose last read ends the run."""

    def __init__(self, seed: int, reads: int) -> None:
        super().__init__(seed)
        self.last, self.stop = reads, lambda: None

    def read(self, record: Record, now_ns: int) -> bool:
        """Fill the record."""
        if self.reads == self.last - 1:
            self.stop()
        return super().read(record, now_ns)


def live_datagrams(ticks: int = 120, key_frame_ns: int = 50_000_000) -> Datagrams:
    """The same of a run in real time, that ends after so many ticks of the fast loop."""
    sink, sensor = Datagrams(), LastSensor(1, ticks)
    ports = {"/ugv/joint_state": Sensor(0), "/ugv/imu": sensor}
    run = RealTime(make_loops(), ports, {}, sink, key_frame_ns=key_frame_ns)
    sensor.stop = run.stop
    run.run()
    return sink


def altered(datagram: bytes, change: Callable[[Tick], None]) -> bytes:
    """A datagram with another tick record."""
    tick = tick_record(make_loops()[0 if datagram[:2] == b"\0\0" else 1])
    end = ENTRY.size + tick.cdr_size
    tick.load(datagram[ENTRY.size : end])
    change(tick)
    return datagram[: ENTRY.size] + tick.to_bytes() + datagram[end:]


def renumbered(datagram: bytes, index: int, release_ns: int) -> bytes:
    """A datagram as that of another tick of its loop."""

    def change(tick: Tick) -> None:
        tick.index, tick.release_ns = index, release_ns

    return altered(datagram, change)


def late(datagram: bytes, start_ns: int, latency_ns: int) -> bytes:
    """A datagram as that of a loop which was started on a machine's clock, and woke late."""

    def change(tick: Tick) -> None:
        tick.release_ns, tick.wake_latency_ns = tick.release_ns + start_ns, latency_ns
        tick.now_ns = tick.release_ns + latency_ns

    return altered(datagram, change)


def toy_setup(robot: str = "toy", extra: Sequence[Attachment] = (), key_frame_ns: int = 100_000_000) -> RecordingSetup:
    """What its recorder is told."""
    return recording_setup(
        make_loops(), robot, "gain = 0.3\n", 7, JOINTS, revision="abc123", key_frame_ns=key_frame_ns, extra=extra
    )


@dataclass
class Toy:
    """The tiny robot, for tests."""

    loops: Callable[..., tuple[Loop, ...]] = make_loops
    setup: Callable[..., RecordingSetup] = toy_setup
    datagrams: Callable[..., Datagrams] = datagrams
    live_datagrams: Callable[..., Datagrams] = live_datagrams
    renumbered: Callable[[bytes, int, int], bytes] = renumbered
    late: Callable[[bytes, int, int], bytes] = late
    small_chunks: BagOptions = SMALL_CHUNKS

    def bag(self, directory: Path, options: BagOptions = SMALL_CHUNKS, **run: Any) -> Path:
        """Record a run; returns the run directory."""
        return self.written(datagrams(**run), directory, options)

    def written(self, given: Datagrams, directory: Path, options: BagOptions = SMALL_CHUNKS) -> Path:
        """Record datagrams; returns the run directory."""
        sink = BagSink(directory, toy_setup(), options)
        for datagram in given:
            sink.write(datagram)
        sink.close()
        return directory


@pytest.fixture(scope="session")
def toy() -> Toy:
    """The tiny robot."""
    return Toy()


@pytest.fixture(scope="session")
def recorded(toy: Toy, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run directory; not to be changed."""
    return toy.bag(tmp_path_factory.mktemp("runs") / "run")
