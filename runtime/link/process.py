# SPDX-License-Identifier: Apache-2.0
"""The link as a process: zenoh's threads take what comes, this thread sends, and logs how it keeps its own time."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

from runtime.executors.clocks import read_clocks
from runtime.executors.linux import Alarm, run_first, stay_on
from runtime.executors.liveness import ALIVE_EVERY_NS
from runtime.executors.notify import Notifier
from runtime.executors.switch_interval import switch_interval
from runtime.executors.tick_stream import LINK_SOCKET, RECORDER_SOCKET, TickListener, TickStream
from runtime.link.carrier import Carrier
from runtime.link.inputs import inputs_of
from runtime.link.setup import LinkSetup
from runtime.messages.session import RosSession, session_config
from runtime.recording.recorder_status import read_status


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
    link, notifier = setup.config, Notifier()
    config = session_config(link.listen, link.connect, Path(link.zenoh_config) if link.zenoh_config else None)
    with (
        closing(TickListener(directory / LINK_SOCKET)) as listener,
        closing(inputs_of(setup, directory)) as inputs,
        closing(TickStream(directory / RECORDER_SOCKET)) as log,
        _collector_frozen(),
        switch_interval(setup.switch_interval_us),
        RosSession("ugv_link", link.domain_id, config, link.type_hashes) as session,
    ):
        inputs.subscribe(session)
        say(f"link: carrying messages of ROS domain {link.domain_id}")
        notifier.send("READY=1")
        take, recorder = partial(listener.receive, 0.0), partial(read_status, directory)
        _carry(Carrier(setup, session, inputs, take, recorder, read_clocks, log, refused), notifier, stop)


def _carry(carrier: Carrier, notifier: Notifier, stop: threading.Event) -> None:
    """Tick until told to stop."""
    alarm, alive_ns = Alarm(), 0
    while not stop.is_set():
        alarm.sleep_until(carrier.ticks.release_ns)
        began_ns, began_cpu_ns = time.monotonic_ns(), time.thread_time_ns()
        carrier.step()
        if began_ns >= alive_ns:
            alive_ns = began_ns + ALIVE_EVERY_NS
            notifier.send("WATCHDOG=1")
        cpu_ns, done_ns = time.thread_time_ns() - began_cpu_ns, time.monotonic_ns()
        carrier.log(began_ns, done_ns, cpu_ns)


def _privileges(setup: LinkSetup) -> Iterator[str]:
    """Ask for what zenoh's threads are to inherit; gives why something was refused."""
    yield run_first(setup.priority)
    if setup.processors:
        yield stay_on(setup.processors)


@contextmanager
def _collector_frozen() -> Iterator[None]:
    """What is there by now is never looked at again by the cyclic garbage collector, which so has little to do."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
