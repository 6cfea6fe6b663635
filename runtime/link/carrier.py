# SPDX-License-Identifier: Apache-2.0
"""What the link does in each tick of its own loop: send what is due, and tell how messages and clocks fare."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from runtime.executors.clocks import LOOK_EVERY_NS, ClockReading, ClockWatch
from runtime.executors.companions import CompanionTicks
from runtime.executors.loop_run import TickSink
from runtime.executors.tick import manifest_of
from runtime.link.clocks import Instant
from runtime.link.control_monitor import ControlMonitor
from runtime.link.diagnosis import Diagnosis
from runtime.link.inputs import Inputs
from runtime.link.loop import STATUS, LinkStatus, link_loop
from runtime.link.outputs import Outputs
from runtime.link.setup import LinkSetup
from runtime.link.topics import TAKEN
from runtime.messages.session import Session
from runtime.recording.recorder_status import RecorderStatus

_MOST_DATAGRAMS = 256
"""Taken in one tick, so that a backlog does not hold up what is to be sent."""
_NS_PER_SECOND = 1_000_000_000


class Carrier:
    """Carries the robot's signals to the network, one step a tick.

    Args:
        setup: of the robot.
        session: to publish in.
        inputs: whose waiting requests it lets go, and whose counts it tells.
        take: gives the next datagram of the control loops, None if none waits.
        recorder: gives what the recorder says of itself, None if it has never said anything.
        clocks: reads the clocks.
        log: takes the link's own ticks.
        refused: what the system did not grant, a sentence each.

    Attributes:
        ticks: of the link's loop.
        status: what became of the messages.
    """

    def __init__(
        self,
        setup: LinkSetup,
        session: Session,
        inputs: Inputs,
        take: Callable[[], bytes | None],
        recorder: Callable[[], RecorderStatus | None],
        clocks: Callable[[], ClockReading],
        log: TickSink,
        refused: Sequence[str] = (),
    ) -> None:
        now = clocks()
        self._session, self._inputs, self._take, self._refused = session, inputs, take, refused
        self._monitor = ControlMonitor(manifest_of(setup.loops))
        self._clocks, self._watch, self._look_ns = clocks, ClockWatch(now), 0
        self.status = LinkStatus(STATUS, {"input": len(TAKEN)})
        self._told, self._tell_ns = b"", 0
        self._log = log
        self.ticks = CompanionTicks(setup.loops, link_loop(setup.config, setup.priority), log, now.monotonic_ns)
        link = setup.config
        self._outputs = Outputs(
            session,
            link,
            setup.robot,
            setup.joint_names,
            setup.description,
            self._monitor,
            Diagnosis(self._monitor, inputs.tally, link.silent_ns, recorder, link.battery_age_max_ns),
            Instant(now.monotonic_ns, now.utc_ns),
        )

    def step(self) -> None:
        """One tick."""
        now = self._clocks()
        self._inputs.outlet.flush(now.monotonic_ns)
        for _ in range(_MOST_DATAGRAMS):
            datagram = self._take()
            if datagram is None:
                break
            self._monitor.take(datagram, now.monotonic_ns)
        if now.monotonic_ns >= self._look_ns:
            self._look_ns = now.monotonic_ns + LOOK_EVERY_NS
            self._watch.look(now)
        self._outputs.publish(Instant(now.monotonic_ns, now.utc_ns), self._figures)

    def log(self, began_ns: int, done_ns: int, cpu_ns: int) -> None:
        """Log the tick, and with it what became of the messages if that has changed.

        It is logged now and then anyway, for a recorder that came late.

        Args:
            began_ns: of the tick, monotonic;
            done_ns: and its end.
            cpu_ns: what of it was computing.
        """
        self._count()
        body = self.status.to_bytes()
        if body == self._told and done_ns < self._tell_ns:
            self.ticks.done(began_ns, done_ns, cpu_ns)
            return
        self._told, self._tell_ns = body, done_ns + _NS_PER_SECOND
        self.ticks.done(began_ns, done_ns, cpu_ns, self.status)

    def _count(self) -> None:
        status, (_, rejected, lost) = self.status, self._inputs.tally.snapshot()
        by_topic = Counter[str]()
        for (topic, _), number in rejected.items():
            by_topic[topic] += number
        status.rejected[:] = [by_topic[topic] for topic in TAKEN]
        status.lost[:] = [lost.get(topic, 0) for topic in TAKEN]
        status.merged, status.malformed = self._inputs.outlet.merged, self._monitor.malformed
        status.clock_steps, status.suspends = self._watch.steps, self._watch.suspends

    def _figures(self) -> dict[str, object]:
        """What /diagnostics says of the link itself."""
        outlet = self._inputs.outlet
        return {
            "peers": self._session.peers(),
            "clock_steps": self._watch.steps,
            "suspends": self._watch.suspends,
            "requests_written": outlet.written,
            "requests_merged": outlet.merged,
            "requests_waiting": outlet.waiting,
            "tokens_overlooked": self._inputs.senders.overlooked,
            "recorder_drops": self._log.dropped,
            "ticks": self.ticks.index,
            "not_granted": "; ".join(self._refused) or "nothing",
        }
