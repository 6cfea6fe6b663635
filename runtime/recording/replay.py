# SPDX-License-Identifier: Apache-2.0
"""Steps every task again on what the log says it saw, and compares what it writes with what was recorded.

Inputs of ports are taken from the tick that read them; signals of other loops by the sequence number that the tick
consumed; signals within a loop are the replayed ones. Key-frames are passed as the live run passed them: every task's
state is saved and taken up again. Over a gap (a dropped tick), and up to the start of the wanted stretch, records are
only held; the loop is stepped again from a key-frame on. Periods that an overrun skipped are no gap.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any

from runtime.executors.tick import manifest_of
from runtime.recording import fingerprint, setup
from runtime.recording.divergence import Comparison, Divergence
from runtime.recording.errors import LogError
from runtime.recording.log import Log
from runtime.recording.logged_ticks import LoggedTick, damaged_topics, flipped_bit, logged_ticks
from runtime.recording.loop_replay import LoopReplay
from runtime.recording.replay_result import Comparing, Damage, ReplayResult, TaskResult
from runtime.records import Record
from runtime.tasks import Loop, Task, due

_HISTORY = 4096
_PROGRESS_TICKS = 64
_KEY_FRAMES_BEFORE = 3
"""From so many before the wanted stretch the log is read: by then every signal has been logged, and a key-frame."""

Stepped = Callable[[str, int, int], None]
"""Is told the loop, the index and the processor time, ns, of the tasks of a tick that was stepped again."""


def unheard(loop: str, index: int, spent_ns: int) -> None:
    """Nobody listens."""


class Replay:
    """A replay of one log.

    Args:
        log: to replay.
        loops: freshly assembled from the log's configuration (or a changed one, for `Comparing.CHANGE`).
        robot: name of the robot that the loops make.
        comparing: None chooses identity where the log's fingerprint is that of this process, else the tolerance.
        relative, absolute: the tolerance.

    Raises:
        LogError: if the log belongs to another robot or has another layout.
    """

    def __init__(
        self,
        log: Log,
        loops: Sequence[Loop],
        robot: str,
        comparing: Comparing | None = None,
        relative: float = 1e-6,
        absolute: float = 1e-9,
    ) -> None:
        self._log, self._loops = log, tuple(loops)
        self._manifest = manifest_of(self._loops)
        log.check(robot, self._manifest)
        self._key_frame_ns = key_frame_ns = self._check_loops(log.json(setup.MANIFEST))
        self._notes: list[str] = []
        foreign = fingerprint.differences(_marks(log), fingerprint.fingerprint())
        if comparing is None:
            comparing = Comparing.TOLERANCE if foreign else Comparing.IDENTITY
            if foreign:
                self._notes.append(f"made elsewhere, so compared within a tolerance ({'; '.join(foreign)})")
        self._comparing = comparing
        if comparing is not Comparing.TOLERANCE:
            relative = absolute = 0.0
        self._runs = {loop.name: LoopReplay(loop, self._manifest, key_frame_ns) for loop in self._loops}
        compared = [c.record for c in self._manifest.channels if c.role in ("output", "state")]
        self._comparisons = {record.topic: Comparison(record, relative, absolute) for record in compared}
        self._received = {record.topic: record.on_change for loop in self._loops for record in loop.receives}
        self._history: dict[str, dict[int, bytes]] = {topic: {} for topic in self._received}
        self._read_up_to = {loop.name: -1 for loop in self._loops}
        self._gap_at = dict(self._read_up_to)
        self._ahead: deque[LoggedTick] = deque()
        self._ticks: Iterator[LoggedTick] = iter(())

    def _check_loops(self, described: Any) -> int:
        """Refuse a log whose loops consumed other signals than these loops do; returns its key-frame interval."""
        try:
            logged = {entry["name"]: entry["receives"] for entry in described["loops"]}
            key_frame_ns = int(described["key_frame_ns"])
        except (KeyError, TypeError, ValueError):
            raise LogError(f"{self._log.path}: {setup.MANIFEST} does not describe the loops") from None
        for loop in self._loops:
            ours, theirs = [record.topic for record in loop.receives], logged.get(loop.name)
            if theirs != ours:
                raise LogError(f"{self._log.path}: loop {loop.name} receives {theirs} in the log, {ours} here")
        return key_frame_ns

    def run(
        self,
        from_s: float = 0.0,
        to_s: float = float("inf"),
        progress: Callable[[float], None] | None = None,
        tasks: Collection[str] | None = None,
        stepped: Stepped = unheard,
    ) -> ReplayResult:
        """Replay a stretch; from a later time, each loop starts at its first key-frame from then on.

        A `Replay` runs once: its tasks are then at the end of the stretch.

        Args:
            from_s: start of the stretch, in seconds of the log.
            to_s: its end.
            progress: told the fraction done.
            tasks: names of those to step; the others' outputs are taken from the log. None steps all.
            stepped: told of every tick that was stepped.
        """
        results = {i.task.name: TaskResult(i.task.name, loop.name) for loop in self._loops for i in loop.schedule}
        unknown = sorted(set(tasks or ()) - set(results))
        if unknown:
            raise LogError(f"{self._log.path} has no task {unknown[0]}; its tasks are {', '.join(results)}")
        result = ReplayResult(self._comparing, results)
        selected = frozenset(results if tasks is None else tasks)
        end_ns = min(to_s * 1e9, self._log.end_ns - self._log.origin_ns)
        begin_ns = from_s * 1e9
        read_from_ns = self._log.origin_ns + int(begin_ns) - _KEY_FRAMES_BEFORE * self._key_frame_ns
        self._ticks = logged_ticks(self._log, self._manifest, read_from_ns)
        for count, tick in enumerate(iter(self._next, None)):
            assert tick is not None
            if tick.at_ns > to_s * 1e9:
                break
            self._step(tick, begin_ns, selected, result, stepped)
            if progress is not None and count % _PROGRESS_TICKS == 0:
                progress(
                    min(1.0, (tick.at_ns - begin_ns) / max(1.0, end_ns - begin_ns)) if tick.at_ns > begin_ns else 0.0
                )
        if progress is not None:
            progress(1.0)
        self._conclude(result)
        return result

    def _conclude(self, result: ReplayResult) -> None:
        result.notes += self._notes
        if self._log.truncated:
            end_s = (self._log.end_ns - self._log.origin_ns) / 1e9
            result.notes.append(f"{self._log.path} was cut off; it was replayed up to {end_s:.3f} s")
        result.broken = [f"{self._log.path}: {phrase}" for phrase in self._log.damage]
        if self._comparing is not Comparing.IDENTITY:
            result.shifts = [s for c in self._comparisons.values() for s in c.shifts.values() if s.steps]

    def _next(self) -> LoggedTick | None:
        """The next tick of the log."""
        return self._ahead.popleft() if self._ahead else self._read()

    def _read(self) -> LoggedTick | None:
        """Read one tick and remember what it gives to other loops."""
        tick = next(self._ticks, None)
        if tick is not None:
            self._read_up_to[tick.loop] = tick.index
            if tick.gap is not None:
                self._gap_at[tick.loop] = tick.index
            for topic in self._history.keys() & tick.bodies.keys():
                history = self._history[topic]
                history[tick.index + 1] = bytes(tick.bodies[topic])
                if len(history) > _HISTORY:
                    del history[next(iter(history))]
        return tick

    def _step(
        self,
        tick: LoggedTick,
        begin_ns: float,
        selected: frozenset[str],
        result: ReplayResult,
        stepped: Stepped,
    ) -> None:
        run, wanted = self._runs[tick.loop], tick.at_ns >= begin_ns
        self._note_damage(run, tick, result)
        if tick.gap is not None:
            run.pass_gap()
            if wanted:
                result.gaps.append(tick.gap)
        result.recorded += wanted
        if not self._receive(run, tick):
            run.stretch = None
        elif run.stretch is None and wanted and run.can_start(tick):
            result.stretches.append(run.start(tick))
        run.hold(tick)
        if run.stretch is None:
            return
        run.stretch.step(tick.index, tick.at_ns)
        run.load_inputs(tick)
        if run.is_key_frame(tick):
            self._pass_key_frame(run, tick, selected, result)
        spent_ns = 0
        for item in run.loop.schedule:
            if due(item, tick.index):
                if item.task.name in selected:
                    began_ns = time.thread_time_ns()
                    item.task.step(tick.now_ns)
                    spent_ns += time.thread_time_ns() - began_ns
                    self._compare_outputs(run, tick, item.task, result)
                else:
                    for record in item.task.writes:
                        if record.topic in tick.bodies:
                            record.load(tick.bodies[record.topic])
        stepped(tick.loop, tick.index, spent_ns)

    def _receive(self, run: LoopReplay, tick: LoggedTick) -> bool:
        """Load what the step consumed; False if the log does not hold it."""
        whole = True
        for record, sequence in zip(run.loop.receives, tick.consumed, strict=True):
            if sequence:
                body = self._find(record, sequence)
                if body is None:
                    whole = False
                else:
                    record.load(body)
        return whole

    def _find(self, record: Record, sequence: int) -> bytes | None:
        """The value that a writer published under a sequence number; reads ahead if it is logged later."""
        history = self._history[record.topic]
        writer = self._manifest.of_topic(record.topic).loop
        while self._read_up_to[writer] < sequence - 1:
            tick = self._read()
            if tick is None:
                break
            self._ahead.append(tick)
        if record.on_change:
            known = max((known for known in history if known <= sequence), default=0)
            return None if known <= self._gap_at[writer] < sequence else history.get(known)
        return history.get(sequence)

    def _pass_key_frame(
        self, run: LoopReplay, tick: LoggedTick, selected: frozenset[str], result: ReplayResult
    ) -> None:
        for item in run.loop.schedule:
            task = item.task
            saved = task.save()
            if task.name in selected and task.state is not None and task.state.topic in tick.bodies:
                result.tasks[task.name].states += 1
                self._compare(run, tick, task, task.state, tick.bodies[task.state.topic], saved, result)
            task.restore(saved)

    def _compare_outputs(self, run: LoopReplay, tick: LoggedTick, task: Task, result: ReplayResult) -> None:
        row = result.tasks[task.name]
        row.steps += 1
        for record in task.writes:
            replayed = record.to_bytes()
            if self._comparing is Comparing.CHANGE and record.topic in self._history:
                self._history[record.topic][tick.index + 1] = replayed
            logged = tick.bodies.get(record.topic)
            if logged is None and record.on_change:
                logged = run.held.get(record.topic)
            if logged is not None:
                row.signals += 1
                self._compare(run, tick, task, record, logged, replayed, result)

    def _compare(
        self,
        run: LoopReplay,
        tick: LoggedTick,
        task: Task,
        record: Record,
        logged: memoryview,
        replayed: bytes,
        result: ReplayResult,
    ) -> None:
        comparison = self._comparisons[record.topic]
        if self._comparing is not Comparing.IDENTITY:
            comparison.add_shifts(tick.at_ns, logged, replayed)
        if self._comparing is Comparing.CHANGE:
            return
        difference = comparison.first_difference(logged, replayed)
        if difference is None:
            return
        assert run.stretch is not None
        run.stretch.identical = False
        found = Divergence(task.name, run.loop.name, tick.index, tick.at_ns, record.topic, difference)
        result.first = result.first or found
        row = result.tasks[task.name]
        row.divergence = row.divergence or found

    def _note_damage(self, run: LoopReplay, tick: LoggedTick, result: ReplayResult) -> None:
        for topic, expected in damaged_topics(tick, run.topics):
            bit = flipped_bit(tick.bodies[topic], expected)
            difference = None
            if bit is not None:
                altered = bytearray(tick.bodies[topic])
                altered[bit >> 3] ^= 1 << (bit & 7)
                record = self._manifest.of_topic(topic).record
                difference = Comparison(record).first_difference(tick.bodies[topic], bytes(altered))
            result.damage.append(Damage(tick.loop, tick.index, tick.at_ns, topic, run.roles[topic], difference))


def _marks(log: Log) -> dict[str, str]:
    """The fingerprint that the log carries."""
    marks = log.json(setup.FINGERPRINT)
    if not isinstance(marks, dict):
        raise LogError(f"{log.path}: {setup.FINGERPRINT} is not a fingerprint")
    return marks
