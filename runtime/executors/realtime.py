# SPDX-License-Identifier: Apache-2.0
"""The real-time executor: each loop a thread under SCHED_FIFO, woken at absolute times.

It runs the tasks that lockstep runs, untouched. The first loop is the fast one, and cannot afford to contend for the
interpreter. So the others are released half a period of it later; it is woken a little early, waits for the interpreter
only shortly and for its release awake, and while it computes the others wait long. What one loop gives another becomes
visible at release + budget, or when it is ready if that is later; frames leave at once. A loop that is not done when
its next release comes skips whole periods, so that it never runs after a backlog, and counts them. A loop that ends, be
it by an exception in any of them, leaves its last outputs to its ports: what a drive hears last is not the command of a
moment long past.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack

from runtime.executors.blas_buffers import make_blas_buffers
from runtime.executors.collector import collector_paused
from runtime.executors.linux import Alarm, lock_memory, processors_awake, run_first, stay_on, unlock_memory
from runtime.executors.liveness import Liveness
from runtime.executors.loop_run import InputPort, LoopRun, OutputPort, TickSink, connected
from runtime.executors.switch_interval import set_switch_interval, switch_interval
from runtime.executors.tick import manifest_of
from runtime.executors.timing import next_tick
from runtime.tasks import Loop

SWITCH_INTERVAL_US = 50
"""How long the fast loop, once woken, waits for the interpreter if another loop has it; below 50 us, loops on one
processor can starve each other for good."""
KEPT_US = 5000
"""How long the others wait while it computes: a tick is not interrupted for them, but a hung one is."""
EXIT_LATENCY_US = 0
"""How long a processor may take to leave its idle state: that is added to the wake latency of a loop."""
WAKE_EARLY_US = 60
"""How long before its release the fast loop is woken: what waking, caches gone cold and the interpreter take is mostly
over when the release comes. What then is left of it the loop waits awake."""
START_AFTER_NS = 50_000_000
"""From the start to the first release, so that every thread is waiting by then."""


class RealTime:
    """Runs loops as threads until it is stopped.

    Args:
        loops: of one robot.
        input_ports, output_ports: by topic; every port record of the loops needs one.
        sink: takes the datagrams, from every loop's thread.
        processors: that the threads may run on; none for all.
        key_frame_ns: how often every task's state is logged and taken up again.
        switch_interval_us: how long the first loop, once woken, waits for the interpreter if another loop has it.
        liveness: told of each tick of the first loop.
        exit_latency_us: how long a processor may take to leave its idle state.
        wake_early_us: how long before its release the first loop is woken, to wait for it awake.
        say: told, in a sentence each, what the system did not grant, as soon as that is known.

    Attributes:
        manifest: of the datagrams.
    """

    def __init__(
        self,
        loops: Sequence[Loop],
        input_ports: Mapping[str, InputPort],
        output_ports: Mapping[str, OutputPort],
        sink: TickSink,
        processors: Collection[int] = (),
        key_frame_ns: int = 1_000_000_000,
        switch_interval_us: int = SWITCH_INTERVAL_US,
        liveness: Liveness | None = None,
        exit_latency_us: int = EXIT_LATENCY_US,
        wake_early_us: int = WAKE_EARLY_US,
        say: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        self.manifest = manifest_of(tuple(loops))
        self._runs = connected(loops, self.manifest, key_frame_ns, input_ports, sink)
        self._fast = self._runs[0]
        self._output_ports, self._processors = output_ports, frozenset(processors)
        self._switch_interval_us, self._liveness = switch_interval_us, liveness
        self._exit_latency_us, self._wake_early_ns, self._say = exit_latency_us, 1000 * wake_early_us, say
        self._stop = threading.Event()
        self._failures: list[BaseException] = []
        self._refused: set[str] = set()

    def stop(self) -> None:
        """Let every loop end after its present step; may be called from any thread, a port or a signal handler."""
        self._stop.set()

    def run(self, start_ns: int | None = None) -> None:
        """Run the loops until `stop`.

        Args:
            start_ns: first release, on the monotonic clock; soon if not given.

        Raises:
            BaseException: what a loop raised; the others are then stopped.
        """
        make_blas_buffers(len(self._runs))
        with ExitStack() as stack:
            stack.enter_context(collector_paused())
            stack.enter_context(switch_interval(self._switch_interval_us))
            self._note(stack.enter_context(processors_awake(self._exit_latency_us)))
            self._note(lock_memory())
            stack.callback(unlock_memory)
            if start_ns is None:
                start_ns = time.monotonic_ns() + START_AFTER_NS
            threads = [
                threading.Thread(
                    target=self._guarded, args=(run, self._first_release(run, start_ns)), name=run.loop.name
                )
                for run in self._runs
            ]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        if self._failures:
            raise self._failures[0]

    def _first_release(self, run: LoopRun, start_ns: int) -> int:
        return start_ns if run is self._fast else start_ns + self._fast.loop.period_ns // 2

    def _note(self, refusal: str) -> None:
        if refusal and refusal not in self._refused:
            self._refused.add(refusal)
            self._say(refusal)

    def _guarded(self, run: LoopRun, start_ns: int) -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
        try:
            refusal = run_first(run.loop.priority)
            self._note(refusal)
            if refusal and self._liveness is not None:
                self._liveness.at_normal_priority(refusal)
            if self._processors:
                self._note(stay_on(self._processors))
            self._loop(run, start_ns)
        except BaseException as failure:
            self._failures.append(failure)
            self.stop()
        self._leave(run)

    def _leave(self, run: LoopRun) -> None:
        """Hand over the last outputs; from the loop's own thread, so that none of its commands comes after them."""
        try:
            for record in run.loop.last_outputs:
                self._output_ports[record.topic].write(record, time.monotonic_ns())
        except BaseException as failure:
            self._failures.append(failure)

    def _loop(self, run: LoopRun, start_ns: int) -> None:
        alarm, tick, loop = Alarm(), run.tick, run.loop
        outputs = [(record, self._output_ports[record.topic]) for record in loop.port_outputs]
        while not self._stop.is_set():
            tick.release_ns = start_ns + run.index * loop.period_ns
            self._sleep(run, alarm)
            now_ns = time.monotonic_ns()
            tick.wake_latency_ns = now_ns - tick.release_ns
            run.step(now_ns, time.clock_gettime_ns(time.CLOCK_BOOTTIME))
            done_ns = time.monotonic_ns()
            for record, port in outputs:
                port.write(record, done_ns)
            due_ns = tick.release_ns + loop.budget_ns
            tick.late = done_ns > due_ns
            run.publish(max(due_ns, done_ns))
            run.log()
            if self._liveness is not None and run is self._fast:
                self._liveness.ticked([other.index for other in self._runs], not tick.skipped, done_ns)
            run.index, tick.skipped = next_tick(run.index, start_ns, loop.period_ns, time.monotonic_ns())

    def _sleep(self, run: LoopRun, alarm: Alarm) -> None:
        """Wait for the release of a tick; the fast loop gets the interpreter soon, before it, and keeps it."""
        if run is not self._fast:
            alarm.sleep_until(run.tick.release_ns)
            return
        set_switch_interval(self._switch_interval_us)
        alarm.sleep_until(run.tick.release_ns - self._wake_early_ns)
        set_switch_interval(KEPT_US)
        while time.monotonic_ns() < run.tick.release_ns:
            pass
