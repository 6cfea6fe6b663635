# SPDX-License-Identifier: Apache-2.0
"""A log replays to the same bits, from any key-frame on, and whatever differs is named."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from runtime.recording import setup
from runtime.recording.bag import BagSink
from runtime.recording.errors import LogError
from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.recording.replay_result import Comparing


def rewrite(source, target, change):
    """Copy a log message by message through the mcap library, letting `change(topic, sequence, data)` alter each."""
    with open(source, "rb") as stream, open(target, "wb") as output:
        reader, writer = make_reader(stream), Writer(output)
        writer.start("ros2")
        for record in reader.iter_attachments():
            writer.add_attachment(0, 0, record.name, record.media_type, record.data)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        channels = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", number)
            data = change(channel.topic, message.sequence, bytearray(message.data))
            if data is not None:
                writer.add_message(
                    channels[channel.id], message.log_time, bytes(data), message.publish_time, message.sequence
                )
        writer.finish()
    return Log(target)


def flip(topic, sequence, byte, bit=4):
    """A change that flips one bit of one message's body."""

    def change(name, number, data):
        if (name, number) == (topic, sequence):
            data[4 + byte] ^= 1 << bit
        return data

    return change


def file_of(run):
    return run / f"{run.name}_0.mcap"


def test_replay_is_identical(toy, recorded):
    result = Replay(Log(recorded), toy.loops(), "toy").run()
    assert result.identical
    assert {name: task.steps for name, task in result.tasks.items()} == {"filter": 250, "body": 84, "planner": 25}
    assert {name: task.signals for name, task in result.tasks.items()} == {"filter": 500, "body": 168, "planner": 50}
    assert result.tasks["filter"].states == 4
    assert [task.verdict for task in result.tasks.values()] == ["identical"] * 3
    assert (result.stepped, result.recorded, result.gaps) == (275, 275, [])


def test_a_run_in_real_time_is_replayed_bit_for_bit(toy, tmp_path):
    """Each step is given what its tick says it consumed, whenever that was."""
    run = toy.written(toy.live_datagrams(ticks=150), tmp_path / "live")
    result = Replay(Log(run), toy.loops(), "toy").run()
    assert result.identical
    assert [task.verdict for task in result.tasks.values()] == ["identical"] * 3


def test_replay_tells_its_progress(toy, recorded):
    told = []
    Replay(Log(recorded), toy.loops(), "toy").run(progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


@pytest.mark.parametrize("from_s", [0.05, 0.1, 0.25, 0.4])
def test_replay_from_a_key_frame_is_identical(toy, recorded, from_s):
    result = Replay(Log(recorded), toy.loops(), "toy").run(from_s, 0.45)
    assert result.identical
    begin = {0.05: 50, 0.1: 50, 0.25: 150, 0.4: 200}[from_s]
    assert result.tasks["filter"].steps == 226 - begin
    assert result.tasks["planner"].steps == 23 - begin // 10


def test_one_task_is_replayed_alone(toy, recorded):
    result = Replay(Log(recorded), toy.loops(), "toy").run(tasks=["body"])
    assert result.identical
    assert [task.steps for task in result.tasks.values()] == [0, 84, 0]
    with pytest.raises(LogError, match="has no task legs; its tasks are filter, body, planner"):
        Replay(Log(recorded), toy.loops(), "toy").run(tasks=["legs"])


def test_a_flipped_bit_of_an_input_is_found_and_named(toy, recorded, tmp_path):
    offset = toy.loops()[0].port_inputs[0].dtype.fields["position"][1] + 8
    log = rewrite(file_of(recorded), tmp_path / "x.mcap", flip("/ugv/joint_state", 123, offset + 6))
    result = Replay(log, toy.loops(), "toy").run()
    assert not result.identical
    [damage] = result.damage
    assert (damage.loop, damage.step, damage.signal, damage.role) == ("fast", 123, "/ugv/joint_state", "input")
    assert damage.difference.field == "position[1]"
    assert "tick 123 of fast (0.246 s): input /ugv/joint_state was altered" in str(damage)
    assert (result.first.task, result.first.step, result.first.signal) == ("filter", 123, "/ugv/filtered")
    assert result.first.difference.field == "value[1]"
    assert result.first.difference.logged != result.first.difference.replayed
    assert str(result.first).startswith("filter, step 123 (0.246 s): /ugv/filtered: value[1] is ")
    assert result.tasks["filter"].verdict == str(result.first)
    assert result.tasks["planner"].verdict == "identical", "it was given what the log says it saw"


def test_a_flipped_bit_is_found_by_divergence_alone(toy, tmp_path):
    bare = replace(toy.setup(), checksums=False)
    sink = BagSink(tmp_path / "run", bare, toy.small_chunks)
    for datagram in toy.datagrams():
        sink.write(datagram)
    sink.close()
    offset = toy.loops()[0].port_inputs[0].dtype.fields["position"][1]
    log = rewrite(sink.path, tmp_path / "x.mcap", flip("/ugv/joint_state", 7, offset + 6))
    result = Replay(log, toy.loops(), "toy").run()
    assert not result.damage
    assert (result.first.task, result.first.step) == ("filter", 7)


def test_a_flipped_bit_that_no_output_shows_is_found(toy, recorded, tmp_path):
    log = rewrite(file_of(recorded), tmp_path / "x.mcap", flip("/ugv/imu", 11, 8, bit=0))
    result = Replay(log, toy.loops(), "toy").run()
    assert result.first is None
    assert not result.identical
    assert "one flipped bit: sequence is 1 in the log and was recorded as 0" in str(result.damage[0])


def test_a_flipped_bit_of_a_state_is_found(toy, recorded, tmp_path):
    log = rewrite(file_of(recorded), tmp_path / "x.mcap", flip("/ugv/state/filter", 100, 24, bit=0))
    result = Replay(log, toy.loops(), "toy").run()
    assert (result.first.signal, result.first.difference.field) == ("/ugv/state/filter", "steps")
    assert (result.first.difference.logged, result.first.difference.replayed) == (101, 100)


def test_a_flipped_byte_of_the_file_is_found(toy, recorded, tmp_path):
    data = bytearray(file_of(recorded).read_bytes())
    body = next(m.body for m in Log(recorded).messages(["/ugv/joint_state"]) if m.sequence == 60)
    place = data.index(bytes(body))
    data[place] ^= 1
    (tmp_path / "x.mcap").write_bytes(data)
    result = Replay(Log(tmp_path / "x.mcap"), toy.loops(), "toy").run()
    assert not result.identical
    assert "does not match its checksum" in result.broken[0]
    assert "stamp_ns is 120000001 in the log and was recorded as 120000000" in str(result.damage[0])


def without(source, target, loop, lost):
    """A copy of a log in which some ticks of a loop are missing."""
    own = {f"/ugv/tick/{loop}", f"/ugv/checksum/{loop}", *LOGGED_BY[loop]}
    return rewrite(source, target, lambda topic, n, data: None if topic in own and n in lost else data)


LOGGED_BY = {
    "fast": {"/ugv/joint_state", "/ugv/imu", "/ugv/filtered", "/ugv/note", "/ugv/state/filter", "/ugv/body_state"},
    "slow": {"/ugv/plan", "/ugv/body_command"},
}


def test_over_a_gap_the_loop_is_taken_up_where_everything_it_wrote_is_known(toy, recorded, tmp_path):
    """At the key-frame of tick 150 `/ugv/note`, logged on change, is known only as it is after that tick."""
    log = without(file_of(recorded), tmp_path / "x.mcap", "fast", {120, 121, 122})
    result = Replay(log, toy.loops(), "toy").run()
    assert result.identical
    assert result.tasks["filter"].steps == 120 + (250 - 200)
    fast = [(s.first, s.last, s.ticks) for s in result.stretches if s.loop == "fast"]
    assert fast == [(0, 119, 120), (200, 249, 50)]
    [gap] = result.gaps
    assert (gap.loop, gap.after, gap.before, gap.missing) == ("fast", 119, 123, 3)
    assert str(gap) == ("fast: up to 3 ticks are missing between tick 119 (0.238 s) and tick 123 (0.246 s)")
    assert result.recorded - result.stepped == 200 - 123 + sum(
        not any(s.first <= n <= s.last for s in result.stretches if s.loop == "slow") for n in range(25)
    )


def test_a_loop_that_received_what_is_missing_is_taken_up_at_its_next_key_frame(toy, recorded, tmp_path):
    log = without(file_of(recorded), tmp_path / "x.mcap", "slow", {7})
    result = Replay(log, toy.loops(), "toy").run()
    assert result.identical
    stretches = {loop: [(s.first, s.last) for s in result.stretches if s.loop == loop] for loop in ("fast", "slow")}
    assert stretches == {"fast": [(0, 74), (100, 249)], "slow": [(0, 6), (10, 24)]}


def test_a_log_that_begins_in_the_middle_is_replayed_from_a_key_frame_on(toy, tmp_path):
    sink = BagSink(tmp_path / "run", toy.setup(), toy.small_chunks)
    for datagram in toy.datagrams(seconds=1.0)[100:]:
        sink.write(datagram)
    sink.close()
    result = Replay(Log(tmp_path / "run"), toy.loops(), "toy").run()
    assert result.identical
    assert sorted(str(gap).split(",")[0].split(" (")[0] for gap in result.gaps) == [
        "fast is recorded from its tick 91 on",
        "slow is recorded from its tick 9 on",
    ]
    assert [(s.loop, s.first, s.last) for s in result.stretches] == [("fast", 150, 499), ("slow", 15, 49)]


def test_periods_that_overruns_skipped_are_no_gap(toy, tmp_path):
    """Tasks with a schedule of their own step at the same indices as they did live, key-frames included."""

    def delays(loop, index):
        return (5_000_000 if index % 7 == 3 else 0) if loop == "fast" else (90_000_000 if index in (4, 11) else 0)

    given = toy.datagrams(seconds=1.0, delays=delays)
    result = Replay(Log(toy.written(given, tmp_path / "run")), toy.loops(), "toy").run()
    assert result.identical
    assert (result.gaps, result.stepped, result.recorded) == ([], len(given), len(given))
    assert len(given) < 500, "periods were skipped"


@settings(max_examples=25)
@given(lost=st.sets(st.integers(0, 274), max_size=12), skipping=st.booleans())
def test_whatever_is_dropped_the_rest_is_replayed_identically(toy, tmp_path_factory, lost, skipping):
    run = toy.datagrams(delays=lambda loop, index: 5_000_000 * (skipping and index % 11 == 5))
    kept = [datagram for number, datagram in enumerate(run) if number not in lost]
    log = Log(toy.written(kept, tmp_path_factory.mktemp("lossy") / "run"))
    result = Replay(log, toy.loops(), "toy").run()
    assert result.first is None
    assert all(stretch.identical for stretch in result.stretches)
    assert result.recorded == len(kept)
    places: dict[bytes, list[int]] = {}
    for number, datagram in enumerate(run):
        places.setdefault(datagram[:2], []).append(number)
    breaks = sum(
        after not in lost and before in lost for numbers in places.values() for before, after in pairwise(numbers)
    )
    assert len(result.gaps) == breaks
    if not lost:
        assert result.stepped == result.recorded


def test_a_changed_parameter_moves_the_outputs(toy, recorded):
    result = Replay(Log(recorded), toy.loops(gain=0.31), "toy", Comparing.CHANGE).run()
    assert result.first is None
    moved = {(shift.signal, shift.field): shift for shift in result.shifts}
    assert 0 < moved["/ugv/filtered", "value"].rms < moved["/ugv/filtered", "value"].largest < 0.1
    assert moved["/ugv/filtered", "stamp_ns"].largest == 0
    assert moved["/ugv/plan", "target"].rms > 0, "the change reaches the other loop"
    assert moved["/ugv/plan", "target"].steps == 25


def test_an_unchanged_parameter_moves_nothing(toy, recorded):
    result = Replay(Log(recorded), toy.loops(), "toy", Comparing.CHANGE).run()
    assert result.shifts
    assert all(shift.largest == 0 for shift in result.shifts)


def foreign_log(toy, directory):
    """A log that says it was made on another machine."""
    own = toy.setup()
    attachments = tuple(
        replace(a, data=b'{"machine": "abacus"}') if a.name == setup.FINGERPRINT else a for a in own.attachments
    )
    sink = BagSink(directory, replace(own, attachments=attachments), toy.small_chunks)
    for datagram in toy.datagrams():
        sink.write(datagram)
    sink.close()
    return Log(directory)


def test_a_log_made_elsewhere_is_compared_within_a_tolerance(toy, tmp_path):
    log = foreign_log(toy, tmp_path / "run")
    near = Replay(log, toy.loops(gain=0.3 * (1 + 1e-9)), "toy").run()
    assert near.comparing is Comparing.TOLERANCE
    assert near.identical
    assert "machine: abacus in the log" in near.notes[0]
    assert any(shift.largest > 0 for shift in near.shifts)
    far = Replay(log, toy.loops(gain=0.301), "toy").run()
    assert far.first.signal == "/ugv/filtered"


def test_a_log_of_another_robot_is_refused(toy, recorded):
    with pytest.raises(LogError, match="is a log of toy, not of titan"):
        Replay(Log(recorded), toy.loops(), "titan")


def test_a_cut_off_log_is_replayed_as_far_as_it_goes(toy, recorded, tmp_path):
    data = file_of(recorded).read_bytes()
    (tmp_path / "x.mcap").write_bytes(data[: len(data) // 2])
    result = Replay(Log(tmp_path / "x.mcap"), toy.loops(), "toy").run()
    assert result.identical
    assert 50 < result.tasks["filter"].steps < 200
    assert "was cut off; it was replayed up to" in result.notes[0]


def test_replay_needs_no_simulator(recorded):
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from pathlib import Path\n"
        "from conftest import make_loops\n"
        "from runtime.recording.log import Log\n"
        "from runtime.recording.replay import Replay\n"
        f"assert Replay(Log(Path({str(recorded)!r})), make_loops(), 'toy').run().identical\n"
    )
    environment = {"PYTHONPATH": ":".join([*sys.path, __file__.rsplit("/", 1)[0]]), "PYTHONHASHSEED": "1"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
