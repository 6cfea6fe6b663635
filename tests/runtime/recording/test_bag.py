# SPDX-License-Identifier: Apache-2.0
"""A recorded run is a rosbag2 directory that independent implementations read in full."""

from __future__ import annotations

import errno
import json
import os
from collections import Counter

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from runtime.executors.tick import entries
from runtime.recording import bag as bag_module
from runtime.recording.bag import LOCKSTEP, REALTIME, BagOptions, BagSink
from runtime.recording.errors import RecordingError
from runtime.recording.log import Log

OWN = {
    "/ugv/tick/fast": 250,
    "/ugv/tick/slow": 25,
    "/ugv/joint_state": 250,
    "/ugv/imu": 129,  # four of them held over a key-frame
    "/ugv/filtered": 250,
    "/ugv/body_state": 84,
    "/ugv/path": 5,
    "/ugv/plan": 25,
    "/ugv/body_command": 25,
    "/ugv/state/filter": 4,
    "/ugv/checksum/fast": 250,
    "/ugv/checksum/slow": 25,
}
STANDARD = {"/imu/data": 125, "/joint_states": 50, "/odom": 25, "/tf": 25, "/path": 1, "/cmd_vel": 25}


@pytest.mark.parametrize("options", [LOCKSTEP, REALTIME, BagOptions(1, 0, 0, "zstd")])
def test_every_message_of_every_topic_deserialises(toy, tmp_path, options):
    run = toy.bag(tmp_path / "run", options)
    with AnyReader([run]) as reader:
        counts = Counter()
        for connection, time_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            counts[connection.topic] += 1
            if hasattr(message, "release_ns"):
                assert message.release_ns == time_ns
        assert counts.pop("/ugv/note") > 1
        assert counts == {**OWN, **STANDARD}
        assert reader.message_count == sum(c.msgcount for c in reader.connections)


def test_the_metadata_agrees_with_the_file(recorded):
    with Reader(recorded) as outer, Reader(recorded / "run_0.mcap") as inner:
        assert outer.message_count == inner.message_count
        assert outer.start_time == inner.start_time == 0
        assert outer.end_time == inner.end_time
        theirs = {c.topic: (c.msgtype, c.msgcount) for c in inner.connections}
        assert {c.topic: (c.msgtype, c.msgcount) for c in outer.connections} == theirs
        assert all(c.digest.startswith("RIHS01_") for c in outer.connections)
        assert theirs["/ugv/joint_state"] == ("ugv_toy_msgs/msg/JointState", 250)
        assert {theirs[f"/ugv/tick/{name}"][0] for name in ("fast", "slow")} == {
            "ugv_toy_msgs/msg/TickFast",
            "ugv_toy_msgs/msg/TickSlow",
        }


def test_the_mcap_library_finds_nothing_to_complain_about(recorded):
    with open(recorded / "run_0.mcap", "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}
        assert summary.statistics.message_count == sum(1 for _ in reader.iter_messages())
        names = {a.name for a in reader.iter_attachments()}
        assert names >= {"config.toml", "git_revision.txt", "seed.txt", "versions.json", "fingerprint.json"}
        for _, channel, message in reader.iter_messages(["/ugv/tick/fast"]):
            assert message.log_time == message.publish_time == message.sequence * 2_000_000
            assert channel.metadata["offered_qos_profiles"] == "[]"


def test_the_log_holds_the_bytes_of_the_datagrams(toy, recorded):
    specs = {spec.number: spec.topic for spec in toy.setup().channels}
    sent = [
        (specs[number], bytes(body))
        for datagram in toy.datagrams()
        for number, body in entries(datagram)
        if "tick" not in specs[number]
    ]
    topics = {topic for topic in specs.values() if "tick" not in topic}
    assert [(m.topic, bytes(m.body)) for m in Log(recorded).messages(topics)] == sent


def test_the_log_carries_the_run(recorded):
    log = Log(recorded)
    assert (log.robot, log.seed, log.config) == ("toy", 7, "gain = 0.3\n")
    assert log.text("git_revision.txt") == "abc123\n"
    assert log.json("versions.json")["numpy"] == np.__version__
    loops = log.json("manifest.json")["loops"]
    assert [(loop["name"], loop["receives"]) for loop in loops] == [
        ("fast", ["/ugv/plan"]),
        ("slow", ["/ugv/filtered", "/ugv/path"]),
    ]
    assert json.loads(log.text("fingerprint.json"))["machine"] == os.uname().machine


def test_a_directory_that_holds_a_log_is_not_written_over(toy, tmp_path):
    run = toy.bag(tmp_path / "run")
    before = (run / "run_0.mcap").read_bytes()
    with pytest.raises(RecordingError, match="run already holds a log"):
        BagSink(run, toy.setup())
    assert (run / "run_0.mcap").read_bytes() == before


def test_an_output_directory_below_a_file_is_refused(toy, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordingError, match=r"cannot write a log in .*file/run: not a directory"):
        BagSink(tmp_path / "file" / "run", toy.setup())
    with pytest.raises(RecordingError, match="file is not a directory"):
        BagSink(tmp_path / "file", toy.setup())


class FullDisk:
    """A file on a disk that is full after some bytes, but for the room that was held back."""

    def __init__(self, path, room):
        self.stream, self.room, self.reserve = open(path, "xb", buffering=0), room, 0  # noqa: SIM115

    def write(self, data):
        space = self.room + self.reserve - self.stream.tell()
        if space <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.stream.write(data[:space])

    def seek(self, offset):
        return self.stream.seek(offset)

    def truncate(self, size):
        return self.stream.truncate(size)

    def close(self):
        self.stream.close()


def record_until_full(toy, run, monkeypatch, reserve):
    """Record onto a disk that fills up; returns what was said."""
    made = []

    def full_disk(path):
        made.append(FullDisk(path, 60_000))
        return made[0], made[0].stream.fileno()

    release = os.close

    def close(descriptor):
        made[0].reserve = reserve
        release(descriptor)

    monkeypatch.setattr(bag_module, "open_output", full_disk)
    monkeypatch.setattr(bag_module.os, "close", close)
    sink = BagSink(run, toy.setup(), toy.small_chunks)
    with pytest.raises(RecordingError) as caught:
        for datagram in toy.datagrams():
            sink.write(datagram)
    return str(caught.value)


@pytest.mark.parametrize("reserve", [1 << 20, 0])
def test_on_a_full_disk_nothing_recorded_is_lost(toy, tmp_path, monkeypatch, reserve):
    said = record_until_full(toy, tmp_path / "run", monkeypatch, reserve)
    assert "run_0.mcap: no space left on device; the log is whole up to 0." in said
    log = Log(tmp_path / "run")
    until = float(said.rsplit("up to ", 1)[1].split()[0])
    assert log.end_ns == pytest.approx(until * 1e9, abs=0.005e9)
    assert log.truncated == (reserve == 0)
    ticks = log.read_signal("/ugv/tick/fast").values["index"]
    assert np.array_equal(ticks, np.arange(len(ticks)))
    assert len(ticks) > 20
    assert not log.damage
    if reserve:
        with AnyReader([tmp_path / "run"]) as reader:
            assert sum(1 for _ in reader.messages()) == reader.message_count


def test_a_sync_that_failed_is_told_when_the_log_is_closed_and_the_log_is_whole(toy, tmp_path, monkeypatch):
    monkeypatch.setattr(bag_module.Syncer, "close", lambda syncer: OSError(errno.EIO, "Input/output error"))
    sink = BagSink(tmp_path / "run", toy.setup(), REALTIME)
    for datagram in toy.datagrams(seconds=0.1):
        sink.write(datagram)
    with pytest.raises(RecordingError, match="input/output error"):
        sink.close()
    assert not Log(tmp_path / "run").truncated
    assert (tmp_path / "run" / "metadata.yaml").exists()
