# SPDX-License-Identifier: Apache-2.0
"""What a fault of processes, of the network or of the disk can lay hands on, and those faults."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.executors.linux import run_first
from runtime.link import topics as ros
from runtime.messages import definitions
from runtime.messages.keys import DEFAULT_QUALITY
from runtime.messages.session import Publisher, RosSession, session_config
from runtime.messages.twist import encode_twist
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.faults.held_thread import held, thread_of
from sim_bridge.faults.relay import Relay
from sim_bridge.ros_messages import TYPES

if TYPE_CHECKING:  # the simulator, which these processes start, looks up faults too
    from sim_bridge.live_processes import LiveProcesses

EVERYONE = ("control", "link", "recorder", "sim")
SUBSCRIBERS = 12
MALFORMED = 20
"""Messages on each topic."""
SPEAKS_EVERY_S = 0.1
"""The holder of a lease."""
CLOCK_STEP_NS = 60_000_000_000
_FILLER = ".filler"
_RECORDED_MEANWHILE_BYTES, _BLOCK_BYTES = 32 << 20, 64 << 10
_FREED_BYTES = 128 << 20
"""Not all: a host that is given gigabytes back at once may hold up its guests."""
_TICK_S = 0.0006
"""A loop that was held and is let go has taken its tick by then, and sleeps."""
_BABBLED = (ros.IMU, ros.LOCALIZATION, ros.BATTERY, ros.PATH, ros.PATH_SPEED, ros.CMD_VEL, ros.MOTION)
"""Topics on which no few bytes are a request by chance."""
_SENT = {
    ros.JOINT_STATES: definitions.JOINT_STATE,
    ros.ODOMETRY: definitions.ODOMETRY,
    ros.DIAGNOSTICS: definitions.DIAGNOSTIC_ARRAY,
}


@dataclass
class Stage:
    """What a fault beside the wires can lay hands on.

    Attributes:
        config: of the robot.
        live: its processes.
        relay: the network between the operator and the link.
        logs: directory in which the recorder makes bags.
        chance: for what a fault leaves to it.
        held: what is let go when the fault ends.
        publishers: that were made ready for it, by topic.
    """

    config: Uslgo1Config
    live: LiveProcesses
    relay: Relay
    logs: Path
    chance: random.Random
    held: ExitStack
    publishers: dict[str, Publisher] = field(default_factory=dict)

    @property
    def away(self) -> Path:
        """Where the logs are while their directory is gone: on the same disk, or they could not be moved."""
        return self.logs / ".away"


Act = Callable[[Stage], None]


def signalled(number: int, *names: str) -> Act:
    """Send a signal to processes."""

    def act(stage: Stage) -> None:
        for name in names:
            os.kill(stage.live.processes.pid(name), number)

    return act


def killed(name: str) -> Act:
    """Kill a process."""
    return signalled(signal.SIGKILL, name)


def stopped(*names: str) -> Act:
    """Stop processes where they are."""
    return signalled(signal.SIGSTOP, *names)


def continued(*names: str) -> Act:
    """Let them go on."""
    return signalled(signal.SIGCONT, *names)


def started_again(name: str) -> Act:
    """Do what a service manager does about a process that died, or that its watchdog found hung."""

    def act(stage: Stage) -> None:
        os.kill(stage.live.processes.pid(name), signal.SIGKILL)
        stage.live.restart(name)

    return act


def loop_held(name: str) -> Act:
    """A loop of control stands still until the fault ends."""

    def act(stage: Stage) -> None:
        stage.held.enter_context(held(_loop(stage, name)))

    return act


def loop_held_for(name: str, duration_s: float) -> Act:
    """A loop of control stands still for a moment."""

    def act(stage: Stage) -> None:
        with held(_loop(stage, name)):
            time.sleep(duration_s)

    return act


def loop_held_again_and_again(name: str, duration_s: float, times: int) -> Act:
    """A loop of control stands still before each of many ticks."""

    def act(stage: Stage) -> None:
        thread = _loop(stage, name)
        with _before_all_loops(stage):
            for _ in range(times):
                with held(thread):
                    time.sleep(duration_s)
                time.sleep(_TICK_S)

    return act


@contextmanager
def _before_all_loops(stage: Stage) -> Iterator[None]:
    """The calling thread is not held up by any loop, where that is granted."""
    run_first(stage.config.loops.wbc_priority + 1)
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _loop(stage: Stage, name: str) -> int:
    """The thread of a loop."""
    loops = stage.config.loops
    priority = {"wbc": loops.wbc_priority, "mpc": loops.mpc_priority}[name]
    return thread_of(stage.live.processes.pid("control"), priority)


def partitioned(stage: Stage) -> None:
    """Nothing passes between operator and link, and neither is told."""
    stage.relay.partition()


def healed(stage: Stage) -> None:
    """The network is back."""
    stage.relay.heal()


def released(stage: Stage) -> None:
    """Let go what the fault held."""
    stage.held.close()


class _Listener:
    """Takes messages and forgets them."""

    def receive(self, payload: bytes, attachment: bytes) -> None:
        """Forget a message."""

    def refuse(self, reason: str) -> None:
        """Forget one that was not looked at."""


def _session(stage: Stage, node: str) -> RosSession:
    link = stage.config.link
    return stage.held.enter_context(RosSession(node, link.domain_id, session_config((), link.listen), link.type_hashes))


def flooded_by_subscribers(stage: Stage) -> None:
    """Many subscribe to everything that the robot sends."""
    for number in range(SUBSCRIBERS):
        session = _session(stage, f"subscriber_{number}")
        for topic, type_name in _SENT.items():
            session.subscribe(topic, type_name, _Listener())


def malformed_messages(stage: Stage) -> None:
    """Somebody sends what cannot be read, on many topics."""
    session = _session(stage, "babbler")
    for topic in _BABBLED:
        publisher = session.publisher(topic, TYPES[topic], DEFAULT_QUALITY)
        for _ in range(MALFORMED):
            publisher.put(stage.chance.randbytes(stage.chance.randrange(200)))


def teleoperator_ready(stage: Stage) -> None:
    """Somebody of higher priority than the operator's is there, and says nothing."""
    session = _session(stage, "teleoperator")
    stage.publishers[ros.TELEOP] = session.publisher(ros.TELEOP, definitions.TWIST, DEFAULT_QUALITY)


def lease_taken_over(stage: Stage) -> None:
    """The teleoperator asks the robot to rest where it is, until the fault ends."""
    publisher, over = stage.publishers.pop(ros.TELEOP), threading.Event()

    def speak() -> None:
        publisher.put(encode_twist(0.0, 0.0, 0.0))
        while not over.wait(SPEAKS_EVERY_S):
            publisher.put(encode_twist(0.0, 0.0, 0.0))

    speaking = threading.Thread(target=speak)
    speaking.start()
    stage.held.callback(speaking.join)
    stage.held.callback(over.set)


def clock_may_be_set() -> bool:
    """Whether this computer lets its clock be set."""
    try:
        _step_clock(0)
    except PermissionError:
        return False
    return True


def clock_ahead(stage: Stage) -> None:
    """The computer's clock is set ahead, and back when the fault ends."""
    _step_clock(CLOCK_STEP_NS)
    stage.held.callback(_step_clock, -CLOCK_STEP_NS)


def _step_clock(by_ns: int) -> None:
    time.clock_settime_ns(time.CLOCK_REALTIME, time.time_ns() + by_ns)


def disk_full(stage: Stage) -> None:
    """No room is left where the logs are."""
    descriptor = os.open(stage.logs / _FILLER, os.O_CREAT | os.O_WRONLY | os.O_APPEND, 0o600)
    try:
        disk = os.fstatvfs(descriptor)
        room = disk.f_bavail * disk.f_frsize - _RECORDED_MEANWHILE_BYTES
        if room > 0:
            os.posix_fallocate(descriptor, 0, room)
        with suppress(OSError):  # which is the end
            while True:
                os.write(descriptor, bytes(_BLOCK_BYTES))
    finally:
        os.close(descriptor)


def disk_freed(stage: Stage) -> None:
    """There is room again."""
    filler = stage.logs / _FILLER
    os.truncate(filler, max(0, filler.stat().st_size - _FREED_BYTES))


def logs_gone(stage: Stage) -> None:
    """The present log is moved away under the recorder's hands."""
    stage.away.mkdir(exist_ok=True)
    for bag in stage.logs.iterdir():
        if bag.is_dir() and bag != stage.away:
            bag.rename(stage.away / bag.name)


def logs_back(stage: Stage) -> None:
    """What was moved away is found again."""
    for bag in stage.away.iterdir():
        bag.rename(stage.logs / bag.name)
    stage.away.rmdir()
