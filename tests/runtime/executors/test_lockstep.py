# SPDX-License-Identifier: Apache-2.0
"""What one loop gives another is seen at release + budget, and nothing depends on the host."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.executors.lockstep import Lockstep
from runtime.executors.tick import TICK_TOPIC_PREFIX, entries, manifest_of
from runtime.records import Record, float64, float64_array, int64, uint32_array
from runtime.tasks import Loop, Scheduled, Task

MS = 1_000_000


class Value(Record):
    """A number with its time."""

    stamp_ns = int64("ns")
    value = float64()


class Memory(Record):
    """What a task remembers."""

    value = float64()
    noise = float64_array(3)


class Relay(Task):
    """Adds its input to what it has, writes the sum, and notes what it saw and when."""

    def __init__(self, name, topic_in, topic_out, journal):
        self.name, self.journal = name, journal
        self.input, self.output = Value(topic_in), Value(topic_out)
        self.reads, self.writes, self.state = (self.input,), (self.output,), Memory(f"/ugv/state/{name}")

    def step(self, now_ns):
        self.journal.append((now_ns, self.name, self.input.stamp_ns, self.input.value))
        self.state.value = 0.5 * self.state.value + np.sin(self.input.value + 1e-9 * now_ns)
        self.state.noise = self.state.noise * 1.1 + self.state.value
        self.output.stamp_ns, self.output.value = now_ns, self.state.value


class Recorder(list):
    """World, ports and sink in one, that note every call in order."""

    dropped = 0

    def __init__(self):
        super().__init__()
        self.datagrams, self.now_ns = [], 0

    def advance(self, until_ns):
        assert until_ns >= self.now_ns, "the world never goes back"
        self.now_ns = until_ns

    def read(self, record, now_ns):
        assert self.now_ns == now_ns, "the world is at the release before a loop reads from it"
        record.stamp_ns, record.value = now_ns, float(now_ns % 7)
        return now_ns % (3 * MS) == 0

    def write(self, *arguments):
        if len(arguments) == 1:
            self.datagrams.append(arguments[0])
            return
        record, now_ns = arguments
        assert self.now_ns == now_ns, "the world is at the departure when a frame leaves"
        self.append((now_ns, record.stamp_ns, record.value))


def build(fast=(2, 1), slow=(10, 6), every=1, key_frame_ns=10**9, start_ns=0):
    """Two loops that listen to each other; the fast one has a sensor and a wire."""
    journal, outside = [], Recorder()
    a, b = Relay("a", "/b", "/a", journal), Relay("b", "/a", "/b", journal)
    sensor, wire = Value("/sensor"), a.output
    loops = (
        Loop("fast", int(fast[0] * MS), int(fast[1] * MS), 80, (sensor,), (a.input,), (Scheduled(a),), (wire,)),
        Loop("slow", int(slow[0] * MS), int(slow[1] * MS), 60, (), (b.input,), (Scheduled(b, every),), ()),
    )
    executor = Lockstep(loops, {"/sensor": outside}, {"/a": outside}, outside, outside, key_frame_ns, start_ns=start_ns)
    return executor, journal, outside


def run(executor, milliseconds):
    """Step every release before a time."""
    return executor.run(10**12, lambda now_ns: now_ns >= milliseconds * MS)


def never(now_ns):
    return False


@pytest.mark.parametrize("until_ns", [0, 1, 10 * MS - 1, 10 * MS, 10 * MS + 1, 11 * MS])
def test_every_step_released_before_the_end_is_taken_and_none_at_it(until_ns):
    executor, journal, outside = build()
    assert executor.run(until_ns, never) == until_ns == outside.now_ns
    expected = [(t, "a") for t in range(0, until_ns, 2 * MS)] + [(t, "b") for t in range(0, until_ns, 10 * MS)]
    assert [row[:2] for row in journal] == sorted(expected)


def test_a_run_in_pieces_is_the_run_in_one():
    whole, _, expected = build()
    whole.run(60 * MS, never)
    pieces, _, outside = build()
    for until_ns in (1, 10 * MS, 10 * MS, 13 * MS, 40 * MS, 60 * MS):
        pieces.run(until_ns, never)
    assert rows(pieces, outside) == rows(whole, expected)
    assert list(outside) == list(expected)


@given(
    st.integers(1, 5),
    st.integers(0, 12),
    st.integers(1, 12),
    st.integers(0, 40),
)
def test_a_result_is_seen_from_release_plus_budget_on(fast_ms, fast_budget, slow_ms, slow_budget):
    executor, journal, _ = build((fast_ms, fast_budget), (slow_ms, slow_budget))
    run(executor, 60)
    for now_ns, name, seen_ns, _ in journal:
        period, budget = (slow_ms, slow_budget) if name == "a" else (fast_ms, fast_budget)
        released = range(0, now_ns + 1, period * MS)
        # at the same instant the loop that is listed first runs first
        due = [t for t in released if t + budget * MS <= now_ns and (t < now_ns or name == "b")]
        assert seen_ns == (due[-1] if due else 0)


def test_a_run_that_begins_later_counts_its_ticks_from_there():
    executor, journal, _ = build(start_ns=30 * MS)
    executor.run(60 * MS, never)
    expected = [(t, "a") for t in range(30 * MS, 60 * MS, 2 * MS)] + [
        (t, "b") for t in range(30 * MS, 60 * MS, 10 * MS)
    ]
    assert [row[:2] for row in journal] == sorted(expected)


def test_loops_released_together_run_in_their_order_and_every_release_runs_once():
    executor, journal, _ = build()
    run(executor, 40)
    assert [row[:2] for row in journal] == sorted(
        [(t * MS, "a") for t in range(0, 40, 2)] + [(t * MS, "b") for t in range(0, 40, 10)]
    )


def test_frames_leave_at_release_plus_budget():
    executor, _, outside = build()
    run(executor, 20)
    assert [row[:2] for row in outside] == [((t + 1) * MS, t * MS) for t in range(0, 20, 2)]


def test_a_departing_record_holds_what_was_written_then():
    executor, _, outside = build(fast=(2, 5))
    run(executor, 60)
    at_once, _, expected = build(fast=(2, 0))
    run(at_once, 56)
    assert [row[0] - 5 * MS for row in outside] == [row[0] for row in expected] == [t * MS for t in range(0, 56, 2)]
    assert [row[1] for row in outside] == [row[0] for row in expected]


def test_slow_tasks_step_at_every_nth_release_and_publish_only_then():
    executor, journal, _ = build(every=3)
    run(executor, 100)
    assert [t for t, name, *_ in journal if name == "b"] == [0, 30 * MS, 60 * MS, 90 * MS]
    seen = {row[2] for row in journal if row[1] == "a"}
    assert seen == {0, 30 * MS, 60 * MS, 90 * MS}


def test_it_stops_when_told_or_in_time_and_says_when():
    executor, journal, _ = build()
    assert run(executor, 6) == 6 * MS
    assert journal[-1][0] == 4 * MS
    executor, journal, _ = build()
    assert executor.run(20 * MS, lambda now_ns: False) == 20 * MS


def written(executor, outside):
    """Every entry but for states and inputs, which a key-frame repeats."""
    roles = {channel.record.topic: channel.role for channel in executor.manifest.channels}
    return [row for row in rows(executor, outside) if roles[row[0]] not in ("state", "input")]


def rows(executor, outside):
    """Every entry of a run as (topic, bytes), wall time left out."""
    channels = {channel.number: channel for channel in executor.manifest.channels}
    found = []
    for datagram in outside.datagrams:
        for number, body in entries(datagram):
            channel = channels[number]
            if channel.role == "tick":
                tick = channel.record.like()
                tick.load(body)
                tick.compute_ns = tick.cpu_ns = 0
                body = tick.to_bytes()
            found.append((channel.record.topic, bytes(body)))
    return found


def test_two_runs_give_the_same_bytes():
    runs = []
    for _ in range(2):
        executor, _, outside = build(key_frame_ns=20 * MS)
        run(executor, 200)
        runs.append(rows(executor, outside))
    assert runs[0] == runs[1]
    assert len(runs[0]) > 250


def test_taking_up_every_state_at_every_tick_changes_nothing():
    plain, _, expected = build()
    run(plain, 200)
    often, _, outside = build(key_frame_ns=1)
    run(often, 200)
    assert written(often, outside) == written(plain, expected)
    states = sum(topic.startswith("/ugv/state/") for topic, _ in rows(often, outside))
    assert states == len(often.compute_ns["fast"]) + len(often.compute_ns["slow"]) - 2


def test_the_comparison_above_would_notice_a_task_that_does_not_survive_it(monkeypatch):
    plain, _, expected = build()
    run(plain, 200)

    def forget(self, data):
        Task.restore(self, data)
        self.state.value += 1e-9

    monkeypatch.setattr(Relay, "restore", forget)
    often, _, outside = build(key_frame_ns=1)
    run(often, 200)
    assert written(often, outside) != written(plain, expected)


def test_a_tick_names_the_sequence_numbers_it_consumed():
    executor, journal, outside = build()
    run(executor, 100)
    channel = executor.manifest.of_topic(TICK_TOPIC_PREFIX + "fast")
    seen = {row[0]: row[2] for row in journal if row[1] == "a"}
    ticks = []
    for datagram in outside.datagrams:
        number, body = next(entries(datagram))
        if number == channel.number:
            tick = channel.record.like()
            tick.load(body)
            ticks.append(tick)
    assert [tick.index for tick in ticks] == list(range(50))
    for tick in ticks:
        assert tick.release_ns == tick.now_ns == tick.index * 2 * MS
        # number n is the n-th result of the slow loop, released at (n - 1) times its period; 0 is none yet
        sequence = int(tick.consumed[0])
        assert sequence == (0 if tick.release_ns < 6 * MS else (tick.release_ns - 6 * MS) // (10 * MS) + 1)
        assert seen[tick.release_ns] == max(0, sequence - 1) * 10 * MS


def test_only_inputs_that_arrived_are_logged():
    executor, _, outside = build()
    run(executor, 30)
    logged = [topic for topic, _ in rows(executor, outside)]
    assert logged.count("/sensor") == len([t for t in range(0, 30, 2) if t % 3 == 0])
    assert logged.count("/a") == 15


def test_channels_are_numbered_in_an_order_that_follows_from_the_loops():
    executor, _, _ = build()
    again, _, _ = build()
    numbered = [(c.number, c.record.topic, c.role, c.loop) for c in executor.manifest.channels]
    assert numbered == [(c.number, c.record.topic, c.role, c.loop) for c in again.manifest.channels]
    assert [row[0] for row in numbered] == list(range(len(numbered)))
    assert [row[1] for row in numbered] == [
        "/ugv/tick/fast",
        "/sensor",
        "/a",
        "/ugv/state/a",
        "/ugv/tick/slow",
        "/b",
        "/ugv/state/b",
    ]
    with pytest.raises(KeyError, match="/nowhere"):
        executor.manifest.of_topic("/nowhere")


class Note(Record):
    """Logged when it changes."""

    on_change = True
    values = uint32_array(2)


class Noter(Task):
    """Changes its note at every fifth step."""

    name = "noter"

    def __init__(self):
        self.note, self.steps = Note("/note"), 0
        self.writes = (self.note,)

    def step(self, now_ns):
        self.note.values = (now_ns // (5 * MS), 1)


def test_a_record_that_is_logged_on_change_is_logged_once_per_value():
    task, outside = Noter(), Recorder()
    loop = Loop("only", MS, 0, 1, (), (), (Scheduled(task),), ())
    executor = Lockstep((loop,), {}, {}, outside, outside)
    run(executor, 23)
    notes = [body for topic, body in rows(executor, outside) if topic == "/note"]
    assert [np.frombuffer(body, "<u4")[0] for body in notes] == [0, 1, 2, 3, 4]
    assert manifest_of((loop,)).of_topic("/note").role == "output"
