# SPDX-License-Identifier: Apache-2.0
"""Bag after bag: each says where it begins and why, nothing that fails is silent, and recording goes on."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.executors.clocks import ClockReading
from runtime.executors.tick import ENTRY, tick_record
from runtime.recording import bags as bags_module
from runtime.recording.bags import Bags
from runtime.recording.log import Log
from runtime.recording.mcap_file import McapFile
from runtime.recording.recorder_status import RecorderStatus, read_status
from runtime.recording.setup import recording_setup
from runtime.tasks import Loop

UTC_NS = 1_800_000_000 * 10**9
NAME = "toy-20270115T080000Z"


@dataclass
class Clocks:
    """Clocks that the test moves."""

    monotonic_ns: int = 0
    utc_ns: int = UTC_NS
    boot_ns: int = 0

    def __call__(self) -> ClockReading:
        return ClockReading(self.monotonic_ns, self.utc_ns, self.boot_ns)

    def pass_s(self, seconds: float) -> None:
        """Let time pass on every clock."""
        self.monotonic_ns += int(seconds * 1e9)
        self.utc_ns += int(seconds * 1e9)
        self.boot_ns += int(seconds * 1e9)


@dataclass
class Bench:
    """Bags of the toy robot, and what they said."""

    toy: object
    directory: Path
    clocks: Clocks = field(default_factory=Clocks)
    status: RecorderStatus = field(default_factory=RecorderStatus)
    said: list[str] = field(default_factory=list)
    previous: str = ""

    def __post_init__(self):
        self.bags = Bags(
            self.directory,
            self.toy.setup(),
            self.status,
            self.said.append,
            self.toy.small_chunks,
            self.previous,
            self.clocks,
        )

    def write(self, datagrams):
        for datagram in datagrams:
            self.bags.write(datagram)


@pytest.fixture
def bench(toy, tmp_path):
    return Bench(toy, tmp_path / "logs")


def fast_ticks(directory):
    return Log(directory).read_signal("/ugv/tick/fast").values["index"].tolist()


def test_a_bag_says_why_it_begins_and_is_a_log_like_any_other(toy, bench):
    run = toy.datagrams()
    bench.write(run)
    bench.bags.close()
    log = Log(bench.directory / NAME)
    assert log.metadata["beginning"] == {
        "previous": "",
        "reason": "the recorder was started",
        "utc_ns": str(UTC_NS),
        "monotonic_ns": "0",
    }
    assert log.metadata["first_tick/fast"] == {"index": "0", "release_ns": "0"}
    assert not log.truncated
    assert fast_ticks(bench.directory / NAME) == list(range(250))
    assert (bench.status.recorded, bench.status.gaps, bench.status.failed) == (len(run), 0, 0)
    assert bench.said == [f"recording in {bench.directory / NAME / NAME}_0.mcap"]


def test_a_control_process_that_starts_anew_has_a_bag_of_its_own(toy, bench):
    run = toy.datagrams(seconds=0.2)
    bench.write(run)
    bench.write(later(toy, run))
    bench.bags.close()
    assert fast_ticks(bench.directory / NAME) == fast_ticks(bench.directory / f"{NAME}-2") == list(range(100))
    second = Log(bench.directory / f"{NAME}-2")
    assert second.metadata["beginning"]["previous"] == NAME
    assert second.metadata["beginning"]["reason"] == "control counts its ticks anew"
    assert (bench.status.bags, bench.status.gaps) == (2, 0)


def later(toy, run, by_ns=10**9):
    """The ticks of a run, as those of a process that was started later."""
    count = {b"\0\0": 0}
    numbered = []
    for datagram in run:
        index = count.get(datagram[:2], 0)
        count[datagram[:2]] = index + 1
        period_ns = 2_000_000 if datagram[:2] == b"\0\0" else 20_000_000
        numbered.append(toy.renumbered(datagram, index, index * period_ns + by_ns))
    return numbered


def test_a_tick_that_comes_twice_is_recorded_once(toy, bench):
    run = toy.datagrams(seconds=0.1)
    bench.write([datagram for datagram in run for _ in range(2)])
    bench.bags.close()
    assert (bench.status.recorded, bench.status.rejected, bench.status.bags) == (len(run), len(run), 1)


def test_what_an_earlier_control_process_left_in_its_socket_begins_no_bag(toy, bench):
    run = toy.datagrams(seconds=0.2)
    bench.write(run[:50])
    for new, left in zip(later(toy, run)[:40], run[50:90], strict=True):
        bench.write([new, left])
    bench.bags.close()
    assert bench.status.bags == 2
    assert bench.status.rejected == 40


def test_a_loop_of_another_process_that_starts_anew_stays_in_the_bag(toy, tmp_path):
    link = Loop("link", 10_000_000, 10_000_000, 40, (), (), (), ())
    tick = tick_record(link)
    loops = (*toy.loops(), link)
    setup = recording_setup(loops, "toy", "", 0)
    status = RecorderStatus()
    bags = Bags(tmp_path, setup, status, [].append, clocks=Clocks())
    number = next(spec.number for spec in setup.channels if spec.loop == "link")
    for index in (0, 1, 2, 0, 1):
        tick.index = index
        bags.write(ENTRY.pack(number, tick.cdr_size) + tick.to_bytes())
    bags.close()
    assert (status.bags, status.gaps, status.dropped) == (1, 1, 0)


def test_dropped_ticks_are_counted_and_a_bag_that_begins_late_is_marked(toy, tmp_path):
    bench = Bench(toy, tmp_path, previous="toy-before")
    run = [datagram for datagram in toy.datagrams() if datagram[:2] == b"\0\0"]
    bench.write(run[40:60] + run[63:])
    bench.bags.close()
    log = Log(tmp_path / NAME)
    assert log.metadata["first_tick/fast"] == {"index": "40", "release_ns": "80000000"}
    assert log.metadata["beginning"]["previous"] == "toy-before"
    assert (bench.status.gaps, bench.status.dropped) == (2, 3)


@settings(max_examples=30)
@given(data=st.binary(max_size=80), cut=st.integers(0, 300), place=st.integers(0, 300))
def test_what_is_no_tick_of_the_robot_is_rejected(toy, tmp_path_factory, data, cut, place):
    """Whatever reaches the socket, what is recorded is whole."""
    directory = tmp_path_factory.mktemp("logs")
    bench, run = Bench(toy, directory), toy.datagrams(seconds=0.02)
    whole = run[0]
    forged = [data, whole[:cut], whole[:place] + data + whole[place:], whole + data]
    bench.write(forged)
    assert bench.status.recorded + bench.status.rejected == len(forged)
    bench.write(run)
    bench.bags.close()
    for log in (Log(path) for path in directory.iterdir()):
        log.read_signals([topic for topic in log.channels if topic.startswith("/ugv/tick/")])
        assert not log.damage


def test_recording_goes_on_when_the_directory_is_removed(toy, bench):
    run = toy.datagrams()
    bench.write(run[:100])
    shutil.rmtree(bench.directory)
    bench.clocks.pass_s(1.0)
    bench.bags.tend()
    assert bench.status.error.endswith(f"{NAME}_0.mcap is gone; what it held is lost")
    assert bench.status.recording == ""
    bench.write(run[100:110])
    assert bench.status.failed >= 10
    bench.clocks.pass_s(1.0)
    bench.write(run[110:])
    bench.bags.close()
    [again] = bench.directory.iterdir()
    log = Log(again)
    assert log.metadata["beginning"]["previous"] == NAME
    assert "is gone" in log.metadata["beginning"]["reason"]
    assert int(log.metadata["first_tick/fast"]["index"]) == fast_ticks(again)[0] == 100
    assert sum(sentence.startswith("recording in ") for sentence in bench.said) == 2
    assert sum("trying again every second" in sentence for sentence in bench.said) == 1


def test_without_room_no_bag_is_begun_and_one_sentence_is_said(toy, bench, monkeypatch):
    room = [False]
    monkeypatch.setattr(bags_module, "_has_room", lambda directory: room[0])
    run = toy.datagrams()
    for second in range(5):
        bench.write(run[50 * second : 50 * (second + 1)])
        bench.clocks.pass_s(1.0)
    assert bench.said == [
        f"cannot write a log in {bench.directory / NAME}: no space left on device; trying again every second"
    ]
    assert (bench.status.failed, bench.status.recorded) == (250, 0)
    assert list(bench.directory.iterdir()) == []
    room[0] = True
    bench.write(run[250:])
    bench.bags.close()
    assert fast_ticks(next(bench.directory.iterdir()))[-1] == 249
    assert bench.status.failed + bench.status.recorded == len(run)


def test_a_disk_that_cannot_be_asked_for_its_room_ends_no_recorder(toy, bench, monkeypatch):
    answers = [OSError(5, "Input/output error"), os.statvfs("/")]

    def statvfs(directory):
        answer = answers.pop(0)
        if isinstance(answer, OSError):
            raise answer
        return answer

    monkeypatch.setattr(os, "statvfs", statvfs)
    monkeypatch.setattr(bags_module, "LEAST_ROOM_BYTES", 0)
    run = toy.datagrams()
    bench.write(run[:100])
    assert bench.said == [
        f"cannot write a log in {bench.directory / NAME}: input/output error; trying again every second"
    ]
    assert (bench.status.failed, list(bench.directory.iterdir())) == (100, [])
    bench.clocks.pass_s(1.0)
    bench.write(run[100:])
    bench.bags.close()
    assert bench.status.failed + bench.status.recorded == len(run)


@pytest.mark.parametrize("obstacle", ["a file", "no permission"])
def test_a_directory_that_cannot_be_made_is_named(toy, tmp_path, monkeypatch, obstacle):
    if obstacle == "a file":
        (tmp_path / "logs").write_text("")
    else:
        monkeypatch.setattr(Path, "mkdir", refuse)
    bench = Bench(toy, tmp_path / "logs")
    bench.write(toy.datagrams(seconds=0.1))
    [sentence] = bench.said
    assert sentence.startswith(f"cannot write a log in {tmp_path / 'logs'}: ")
    assert bench.status.error in sentence


def refuse(path, *arguments, **options):
    raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize("room", [20_000, 45_000, 60_000])
def test_on_a_full_disk_every_datagram_is_counted_once(toy, bench, monkeypatch, room):
    """And those that are counted as recorded are in the log."""
    written = [0]
    append = McapFile._append

    def limited(file, data):
        written[0] += len(data)
        if written[0] > room and len(data) > 200:
            raise OSError(28, "No space left on device")
        append(file, data)

    monkeypatch.setattr(McapFile, "_append", limited)
    run = toy.datagrams()
    bench.write(run)
    assert bench.status.failed > 0
    assert bench.status.recorded + bench.status.failed == len(run)
    in_logs = sum(
        len(Log(path).read_signal(f"/ugv/tick/{loop}").values)
        for path in bench.directory.iterdir()
        for loop in ("fast", "slow")
    )
    assert bench.status.recorded == in_logs


def test_no_descriptor_is_left_open_by_failures(toy, tmp_path, monkeypatch):
    bench = Bench(toy, tmp_path)
    monkeypatch.setattr(bags_module.BagWriter, "_declare", refuse)
    run = toy.datagrams()
    bench.write(run[:1])
    before = len(os.listdir("/proc/self/fd"))
    for datagram in run[:50]:
        bench.clocks.pass_s(1.0)
        bench.bags.write(datagram)
    assert len(os.listdir("/proc/self/fd")) == before
    assert list(tmp_path.iterdir()) == []


def test_steps_of_the_clock_and_suspensions_stand_in_the_log(toy, bench):
    run = toy.datagrams()
    bench.write(run[:10])
    bench.bags.tend()
    for happened in ({"utc_ns": 3 * 10**9}, {"utc_ns": 7 * 10**9, "boot_ns": 7 * 10**9}, {}):
        bench.clocks.pass_s(1.0)
        for name, by_ns in happened.items():
            setattr(bench.clocks, name, getattr(bench.clocks, name) + by_ns)
        bench.bags.tend()
    bench.write(run[10:])
    bench.bags.close()
    log = Log(next(bench.directory.iterdir()))
    said = {name: entries["what"] for name, entries in log.metadata.items() if name.startswith("clock/")}
    assert said == {
        "clock/1": "the system clock was set +3.000 s",
        "clock/2": "the system was suspended for 7.000 s",
    }
    assert np.array_equal(fast_ticks(log.path.parent), np.arange(250))


@given(status=st.builds(RecorderStatus, recording=st.text(), failed=st.integers(0), error=st.text()))
def test_the_status_is_read_as_it_was_written(tmp_path_factory, status):
    directory = tmp_path_factory.mktemp("status")
    status.write(directory)
    assert read_status(directory) == status
    assert [path.name for path in directory.iterdir()] == ["recorder.status"]


@given(content=st.one_of(st.binary(), st.sampled_from([b"[]", b'{"bags": "many"}', b"{}", b'{"x": 1, "bags": 2}'])))
def test_a_broken_status_is_none(tmp_path_factory, content):
    directory = tmp_path_factory.mktemp("status")
    (directory / "recorder.status").write_bytes(content)
    found = read_status(directory)
    assert found is None or found == RecorderStatus(bags=found.bags)
