# SPDX-License-Identifier: Apache-2.0
"""The link as a process: zenoh's threads take what comes, this thread sends, and logs how it keeps its own time."""

from __future__ import annotations

import gc
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from runtime.executors.clocks import LOOK_EVERY_NS, ClockWatch, read_clocks
from runtime.executors.companions import CompanionTicks
from runtime.executors.linux import Alarm, run_first, stay_on
from runtime.executors.liveness import ALIVE_EVERY_NS
from runtime.executors.notify import Notifier
from runtime.executors.switch_interval import switch_interval
from runtime.executors.tick import manifest_of
from runtime.executors.tick_stream import LINK_SOCKET, RECORDER_SOCKET, TickListener, TickStream
from runtime.link.clocks import instant
from runtime.link.control_monitor import ControlMonitor
from runtime.link.diagnosis import Diagnosis
from runtime.link.inputs import Inputs
from runtime.link.loop import STATUS, LinkStatus, link_loop
from runtime.link.outputs import Outputs
from runtime.link.setup import LinkSetup
from runtime.link.topics import TAKEN
from runtime.messages.session import RosSession, session_config
from runtime.recording.recorder_status import read_status
from runtime.records import Record
from runtime.robots import topics
from runtime.signals import Battery, Imu, OperatorEvent, Pose
from runtime.signals import Path as PathRecord
from runtime.tasks import Loop

_MOST_DATAGRAMS = 256
"""Taken in one tick, so that a backlog does not hold up what is to be sent."""
_NS_PER_SECOND = 1_000_000_000


def run(setup: LinkSetup, directory: Path, stop: threading.Event, say: Callable[[str], None]) -> None:
    """Carry messages until told to stop.

    Args:
        setup: of the robot.
        directory: the runtime directory.
        stop: ends the run within a tick.
        say: told, in a sentence each, what the system did not grant, and that the link is up.

    Raises:
        SessionError: if zenoh cannot be opened.
        SharedMemoryError: if another link is running.
        TickStreamError: if another link is running.
    """
    refused = [reason for reason in _privileges(setup) if reason]
    for reason in refused:
        say(f"link: {reason}")
    link = setup.config
    listener = TickListener(directory / LINK_SOCKET)
    try:
        notifier = Notifier()
        inputs = Inputs(link, _records(setup.loops), directory, _taken_hz(setup.loops))
        try:
            config = session_config(link.listen, link.connect, Path(link.zenoh_config) if link.zenoh_config else None)
            with (
                _collector_frozen(),
                switch_interval(setup.switch_interval_us),
                RosSession("ugv_link", link.domain_id, config, link.type_hashes) as session,
            ):
                inputs.subscribe(session)
                say(f"link: carrying messages of ROS domain {link.domain_id}")
                notifier.send("READY=1")
                _Carrier(setup, directory, session, listener, inputs, refused, notifier).run(stop)
        finally:
            inputs.close()
    finally:
        listener.close()


class _Carrier:
    """The link's own loop."""

    def __init__(
        self,
        setup: LinkSetup,
        directory: Path,
        session: RosSession,
        listener: TickListener,
        inputs: Inputs,
        refused: Sequence[str],
        notifier: Notifier,
    ) -> None:
        self._session, self._listener, self._inputs, self._refused = session, listener, inputs, refused
        self._notifier, self._alive_ns = notifier, 0
        self._monitor = ControlMonitor(manifest_of(setup.loops))
        self._clocks, self._look_ns = ClockWatch(read_clocks()), 0
        self._status = LinkStatus(STATUS, {"input": len(TAKEN)})
        self._told, self._tell_ns = b"", 0
        self._log = TickStream(directory / RECORDER_SOCKET)
        loop = link_loop(setup.config, setup.priority)
        self._ticks = CompanionTicks(setup.loops, loop, self._log, time.monotonic_ns())
        self._outputs = Outputs(
            session,
            setup.config,
            setup.robot,
            setup.joint_names,
            setup.description,
            self._monitor,
            Diagnosis(
                self._monitor,
                inputs.tally,
                setup.config.silent_ns,
                partial(read_status, directory),
                setup.config.battery_age_max_ns,
            ),
            instant(),
        )

    def run(self, stop: threading.Event) -> None:
        """Tick until told to stop."""
        alarm = Alarm()
        try:
            while not stop.is_set():
                alarm.sleep_until(self._ticks.release_ns)
                began_ns, began_cpu_ns = time.monotonic_ns(), time.thread_time_ns()
                self._step(began_ns)
                cpu_ns, done_ns = time.thread_time_ns() - began_cpu_ns, time.monotonic_ns()
                self._ticks.done(began_ns, done_ns, cpu_ns, *self._news(done_ns))
        finally:
            self._log.close()

    def _news(self, now_ns: int) -> Sequence[LinkStatus]:
        """What became of the messages, if that has changed, and now and then for a recorder that came late."""
        status, (_, rejected, lost) = self._status, self._inputs.tally.snapshot()
        by_topic = Counter[str]()
        for (topic, _), number in rejected.items():
            by_topic[topic] += number
        status.rejected[:] = [by_topic[topic] for topic in TAKEN]
        status.lost[:] = [lost.get(topic, 0) for topic in TAKEN]
        status.merged, status.malformed = self._inputs.outlet.merged, self._monitor.malformed
        status.clock_steps, status.suspends = self._clocks.steps, self._clocks.suspends
        body = status.to_bytes()
        if body == self._told and now_ns < self._tell_ns:
            return ()
        self._told, self._tell_ns = body, now_ns + _NS_PER_SECOND
        return (status,)

    def _step(self, now_ns: int) -> None:
        self._inputs.outlet.flush(now_ns)
        for _ in range(_MOST_DATAGRAMS):
            datagram = self._listener.receive(0.0)
            if datagram is None:
                break
            self._monitor.take(datagram, now_ns)
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_EVERY_NS
            self._clocks.look(read_clocks())
        self._outputs.publish(instant(), self._figures)
        if now_ns >= self._alive_ns:
            self._alive_ns = now_ns + ALIVE_EVERY_NS
            self._notifier.send("WATCHDOG=1")

    def _figures(self) -> dict[str, object]:
        """What /diagnostics says of the link itself."""
        outlet = self._inputs.outlet
        return {
            "peers": self._session.peers(),
            "clock_steps": self._clocks.steps,
            "suspends": self._clocks.suspends,
            "requests_written": outlet.written,
            "requests_merged": outlet.merged,
            "requests_waiting": outlet.waiting,
            "tokens_overlooked": self._inputs.senders.overlooked,
            "recorder_drops": self._log.dropped,
            "ticks": self._ticks.index,
            "not_granted": "; ".join(self._refused) or "nothing",
        }


def _privileges(setup: LinkSetup) -> Iterator[str]:
    """Ask for what zenoh's threads are to inherit; gives why something was refused."""
    yield run_first(setup.priority)
    if setup.processors:
        yield stay_on(setup.processors)


def _records(loops: Sequence[Loop]) -> dict[str, Record]:
    """A record of each input's layout."""
    measured = (Imu(topics.IMU), Pose(topics.LOCALIZATION), Battery(topics.BATTERY))
    path = next(r for loop in loops for r in loop.port_inputs if isinstance(r, PathRecord))
    return {record.topic: record for record in (*measured, path.like(), OperatorEvent(topics.OPERATOR_EVENT))}


def _taken_hz(loops: Sequence[Loop]) -> float:
    """How many requests the control loop takes a second: one a tick."""
    return _NS_PER_SECOND / min(loop.period_ns for loop in loops)


@contextmanager
def _collector_frozen() -> Iterator[None]:
    """What is there by now is never looked at again by the cyclic garbage collector, which so has little to do."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
