# SPDX-License-Identifier: Apache-2.0
"""Reading a log: values as arrays, and one clear sentence for whatever cannot be read."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

from runtime.executors.tick import manifest_of
from runtime.recording.bag import BagOptions
from runtime.recording.compare import first_log_difference
from runtime.recording.errors import LogError, RecordingError
from runtime.recording.layout import body_size, dtype_of, first_difference
from runtime.recording.log import Log
from runtime.recording.recover import recover
from runtime.recording.replay import Replay


def file_of(run):
    return run / "run_0.mcap"


def test_signals_are_arrays_in_the_records_layout(toy, recorded):
    log = Log(recorded)
    assert not log.truncated
    joints = log.read_signal("/ugv/joint_state")
    record = toy.loops()[0].port_inputs[0]
    assert joints.values.dtype == record.dtype
    assert np.array_equal(joints.log_ns, np.arange(250) * 2_000_000)
    with AnyReader([recorded]) as reader:
        connections = [c for c in reader.connections if c.topic == "/ugv/joint_state"]
        for i, (connection, _, raw) in enumerate(reader.messages(connections)):
            message = reader.deserialize(raw, connection.msgtype)
            for name in record.dtype.names:
                assert np.array_equal(getattr(message, name), joints.values[name][i])


def test_the_layout_follows_from_the_message_text(toy):
    for channel in manifest_of(toy.loops()).channels:
        dtype = dtype_of(channel.record.ros_definition())
        assert dtype == channel.record.dtype
        assert body_size(dtype) == channel.record.cdr_size


def test_a_log_can_be_opened_by_its_file(recorded):
    assert Log(file_of(recorded)).counts() == Log(recorded).counts()


def test_a_missing_log(tmp_path):
    with pytest.raises(LogError, match="nowhere does not exist"):
        Log(tmp_path / "nowhere")
    with pytest.raises(LogError, match=r"holds no \.mcap file"):
        Log(tmp_path)


def test_two_logs_in_one_directory(tmp_path):
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(LogError, match=r"holds 2 \.mcap files; name one of them"):
        Log(tmp_path)


def test_an_empty_file(tmp_path):
    (tmp_path / "x.mcap").write_bytes(b"")
    with pytest.raises(LogError, match=r"x.mcap is empty"):
        Log(tmp_path)


@pytest.mark.parametrize("content", [b"\0" * 100, b"PK\3\4 a zip file", b"x", b"\x89PNG\r\n\x1a\n" * 9])
def test_a_file_that_is_not_mcap(tmp_path, content):
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(LogError, match=r"x.mcap is not an MCAP file"):
        Log(tmp_path)


def test_a_log_cut_off_anywhere_is_read_up_to_its_last_whole_chunk(recorded, tmp_path):
    data = file_of(recorded).read_bytes()
    whole = Log(recorded).read_signal("/ugv/filtered").values
    path, known = tmp_path / "x.mcap", 0
    for size in range(1, len(data), 997):
        path.write_bytes(data[:size])
        try:
            log = Log(path)
        except LogError as error:
            assert str(error) == f"{path} was cut off before its first message"
            assert known == 0
            continue
        assert log.truncated
        values = log.read_signal("/ugv/filtered").values
        assert np.array_equal(values, whole[: len(values)])
        assert len(values) >= known
        assert not log.damage
        known = len(values)
    assert known == len(whole)


def test_a_topic_that_is_not_there(recorded):
    with pytest.raises(LogError, match="has no topic /ugv/wings"):
        Log(recorded).read_signal("/ugv/wings")


def test_another_robot_and_another_layout_are_refused(toy, recorded):
    log, manifest = Log(recorded), manifest_of(toy.loops())
    log.check("toy", manifest)
    with pytest.raises(LogError, match="is a log of toy, not of titan8"):
        log.check("titan8", manifest)
    record = next(c.record for c in manifest.channels if c.record.topic == "/ugv/filtered")
    record.ros_definition = lambda: "int64 stamp_ns\nfloat64[4] value\nfloat64 mean\n"  # type: ignore[method-assign]
    with pytest.raises(LogError, match=r"/ugv/filtered: field `value` is float64\[3\] in the log and float64\[4\]"):
        log.check("toy", manifest)


@pytest.mark.parametrize(
    ("logged", "ours", "says"),
    [
        ("int64 a\nuint8 b\n", "int64 a  # now with a unit\nuint8 b\n", None),
        ("int64 a\nuint8 b\n", "int64 a\n", "field `b` (uint8) is in the log but not in this code"),
        ("int64 a\n", "int64 a\nbool c\n", "field `c` (bool) is in this code but not in the log"),
        ("int64 a\n", "float64 a\n", "field `a` is int64 in the log and float64 in this code"),
        ("int64 a\nint64 b\n", "int64 b\nint64 a\n", "field `a` of the log stands where this code has `b`"),
    ],
)
def test_layouts_differ_by_field_name(logged, ours, says):
    assert first_difference(logged, ours) == says


def test_recovery_saves_what_a_cut_off_log_still_holds(recorded, tmp_path):
    data = file_of(recorded).read_bytes()
    (tmp_path / "x.mcap").write_bytes(data[: 2 * len(data) // 3])
    cut = Log(tmp_path / "x.mcap")
    path = recover(cut, tmp_path / "saved")
    saved = Log(tmp_path / "saved")
    assert path == saved.path
    assert not saved.truncated
    assert saved.config == cut.config
    assert saved.counts() == cut.counts()
    assert saved.counts()["/ugv/filtered"] > 100
    with AnyReader([tmp_path / "saved"]) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
        assert reader.message_count == sum(cut.counts().values())
    with pytest.raises(RecordingError, match="already exists"):
        recover(cut, tmp_path / "saved")


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7), compressed=st.booleans())
def test_one_flipped_bit_anywhere_is_never_a_traceback(toy, short_logs, tmp_path, place, bit, compressed):
    data = bytearray(short_logs[compressed])
    at = int(place * len(data))
    data[at] ^= 1 << bit
    (tmp_path / "x.mcap").write_bytes(data)
    try:
        log = Log(tmp_path / "x.mcap")
        Replay(log, toy.loops(), "toy").run()
        log.counts()
    except LogError as error:
        assert "x.mcap" in str(error) or "definition" in str(error)


@pytest.fixture(scope="module")
def short_logs(toy, tmp_path_factory):
    folder = tmp_path_factory.mktemp("short")
    return [
        file_of(toy.bag(folder / name / "run", BagOptions(4096, 10**8, 0, compression), seconds=0.03)).read_bytes()
        for name, compression in (("plain", ""), ("packed", "zstd"))
    ]


def test_two_runs_of_one_seed_hold_the_same_and_of_another_do_not(toy, recorded, tmp_path):
    same, other = toy.bag(tmp_path / "same" / "run"), toy.bag(tmp_path / "other" / "run", seed=1)
    assert first_log_difference(Log(recorded), Log(same)) is None
    said = first_log_difference(Log(recorded), Log(other))
    assert said is not None
    assert said.startswith("/ugv/joint_state at 0.000 s differs")
    short = toy.bag(tmp_path / "short" / "run", seconds=0.4)
    assert "ends before /ugv/tick/" in str(first_log_difference(Log(short), Log(recorded)))


def test_recovery_keeps_a_topic_whose_type_is_damaged(recorded, tmp_path):
    damaged = tmp_path / "damaged.mcap"
    content = next(recorded.glob("*.mcap")).read_bytes()
    damaged.write_bytes(content.replace(b"tf2_msgs/msg/TFMessage", b"tf2_msgs/msg/TFMessa'e"))
    saved = Log(recover(Log(damaged), tmp_path / "saved"))
    assert saved.channels["/tf"].type_name == "tf2_msgs/msg/TFMessa'e"
    assert saved.counts()["/tf"] == Log(recorded).counts()["/tf"]
