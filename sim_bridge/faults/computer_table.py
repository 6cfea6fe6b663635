# SPDX-License-Identifier: Apache-2.0
"""The faults of processes, network, disk and clocks in virtual time, with their answers and how soon these are due."""

from __future__ import annotations

import resource
from functools import partial

from runtime.link import topics as ros
from runtime.link.loop import STATUS
from runtime.robots import topics
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Fault, Motion, Request
from sim_bridge.faults import operator
from sim_bridge.faults.computer import CONTROL, LINK, OPERATOR, RECORDER, Computer
from sim_bridge.faults.computer_trial import ComputerRow, Inject
from sim_bridge.faults.table import CROUCH, DAMP, PAUSE, STAND, WALK_ON, crouched, stood, ticks
from sim_bridge.faults.table_parts import MS, at_once, imu_stale, lease_over
from sim_bridge.faults.wires import QuadrupedWires
from sim_bridge.ros_messages import TYPES

SECOND_NS = 1000 * MS
CONTROL_LOOPS = ("wbc", "mpc")
RESTART_NS, WATCHDOG_NS = SECOND_NS, 2 * SECOND_NS
"""Of control, as in `ugv-control.service`."""
RECORDER_RESTART_NS = 200 * MS
"""As in `ugv-recorder.service`."""
FLOODED_STEP_NS = 500 * MS
"""Of a link that sends to too many."""
MALFORMED = 20
"""Messages on each topic."""
SHORT = (ros.E_STOP, ros.ARM, ros.HEARTBEAT, ros.RESET, ros.RELEASE)
"""Topics whose messages are so short that chance may hit one that is well formed."""


def drives_let_go(config: Uslgo1Config) -> int:
    """Until drives that hear nothing damp by themselves."""
    return config.simulation.command_timeout_ns + 2 * config.loops.wbc_period_ns + config.simulation.time_step_ns


def _hold(wires: QuadrupedWires, loops: tuple[str, ...], begin_ns: int, end_ns: int) -> None:
    """Steps of loops that begin within a time last until its end."""
    periods = {loop: wires.period_ns(loop) for loop in loops}
    for loop in loops:
        wires.delays[loop] = lambda index, period_ns=periods[loop]: (  # type: ignore[misc]
            end_ns - index * period_ns if begin_ns <= index * period_ns < end_ns else 0
        )


def control_stopped(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """The control process stands still, and goes on."""
    _hold(wires, CONTROL_LOOPS, begin_ns, end_ns)


def control_killed(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """The control process is killed, and started again."""
    wires.once(begin_ns, lambda: computer.running.discard(CONTROL))
    wires.once(end_ns, lambda: computer.running.add(CONTROL))


def stopped_and_killed(stop_ns: int, kill_ns: int) -> Inject:
    """The operator stops the robot; control is killed, is started again, and is asked to walk.

    Args:
        stop_ns: when the stop comes, after the beginning.
        kill_ns: when control is killed, likewise.
    """

    def inject(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
        operator.insert(wires, topics.OPERATOR_EVENT, begin_ns + stop_ns, [operator.says(Request.EMERGENCY_STOP)])
        control_killed(computer, wires, begin_ns + kill_ns, end_ns)
        asks = (Request.MOTION, Motion.STAND), (Request.ARM, Motion.REST), (Request.MOTION, Motion.WALK)
        operator.insert(wires, topics.OPERATOR_EVENT, end_ns + 100 * MS, [operator.says(*ask) for ask in asks])

    return inject


def hung(*loops: str) -> Inject:
    """Loops hang, whereupon control is killed by its watchdog, and started again."""

    def inject(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
        _hold(wires, loops, begin_ns, end_ns)
        control_killed(computer, wires, end_ns - RESTART_NS, end_ns)

    return inject


def link_killed(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """The link is killed, and started again."""
    wires.once(begin_ns, computer.kill_link)
    wires.once(end_ns, computer.start_link)


def stopped(process: str) -> Inject:
    """A process stands still, and goes on."""

    def inject(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
        wires.once(begin_ns, partial(computer.stop, process))
        wires.once(end_ns, partial(computer.go_on, process))

    return inject


def recorder_killed(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """The recorder is killed, and started again."""
    wires.once(begin_ns, computer.kill_recorder)
    wires.once(end_ns, computer.start_recorder)


def partitioned(asked: float) -> Inject:
    """Nothing comes from the operator, then all at once.

    Args:
        asked: when the operator asks to walk again, as a share of that time: at its end, or to nobody who hears.
    """

    def inject(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
        operator.walks_again(wires, begin_ns + int(asked * (end_ns - begin_ns)))
        wires.once(begin_ns, partial(computer.network.cut, OPERATOR))
        wires.once(end_ns, partial(computer.network.mend, OPERATOR))

    return inject


def flooded(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """So many subscribe that the link takes half a second to send what it otherwise sends at once."""

    def take(step_ns: int) -> None:
        assert computer.link is not None
        computer.link.step_ns = step_ns

    wires.once(begin_ns, partial(take, FLOODED_STEP_NS))
    wires.once(end_ns, partial(take, 0))


def malformed_messages(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """Somebody sends what cannot be read, on every topic but the short ones."""
    session = computer.network.join("babbler")
    spoken = {topic: type_name for topic, type_name in TYPES.items() if topic not in SHORT}

    def babble() -> None:
        for topic, type_name in spoken.items():
            publisher = session.publisher(topic, type_name)
            for _ in range(MALFORMED):
                publisher.put(wires.rng.bytes(int(wires.rng.integers(200))))

    wires.once(begin_ns, babble)


def disk_full(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """No file of this process can grow any more."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    restore = partial(resource.setrlimit, resource.RLIMIT_FSIZE, before)
    wires.once(begin_ns, partial(resource.setrlimit, resource.RLIMIT_FSIZE, (0, before[1])))
    wires.once(end_ns, restore)
    computer.held.callback(restore)


def logs_gone(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """The directory of the logs is moved away, and is found again."""
    away = computer.logs.with_name("away")

    def gone() -> None:
        computer.logs.rename(away)

    def back() -> None:
        for bag in away.iterdir():
            bag.rename(computer.logs / bag.name)
        away.rmdir()

    wires.once(begin_ns, gone)
    wires.once(end_ns, back)


def clock_set(by_ns: int) -> Inject:
    """The computer's clock is set, and set back."""

    def inject(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
        def step(by_ns: int) -> None:
            computer.clocks.set_ns += by_ns

        wires.once(begin_ns, partial(step, by_ns))
        wires.once(end_ns, partial(step, -by_ns))

    return inject


def suspended(computer: Computer, wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """The computer is suspended while the world goes on."""
    wires.once(begin_ns, partial(computer.suspend, SECOND_NS))


COMPUTER_ROWS = (
    ComputerRow(
        "control stopped for 0.5 s",
        control_stopped,
        DAMP,
        drives_let_go,
        500 * MS,
        fault=Fault.STOOD_STILL,
    ),
    ComputerRow("control killed", control_killed, DAMP, drives_let_go, RESTART_NS),
    ComputerRow(
        "emergency stop, then control killed",
        stopped_and_killed(0, 100 * MS),
        DAMP,
        ticks(3),
        RESTART_NS,
        SECOND_NS,
        Fault.EMERGENCY_STOP,
    ),
    ComputerRow(
        "control killed, then emergency stop",
        stopped_and_killed(500 * MS, 0),
        DAMP,
        drives_let_go,
        RESTART_NS,
        SECOND_NS,
    ),
    ComputerRow("WBC hung", hung("wbc"), DAMP, drives_let_go, WATCHDOG_NS + RESTART_NS),
    ComputerRow("control hung", hung(*CONTROL_LOOPS), DAMP, drives_let_go, WATCHDOG_NS + RESTART_NS),
    ComputerRow("link killed", link_killed, CROUCH, crouched(imu_stale), SECOND_NS, SECOND_NS, Fault.STALE_IMU),
    ComputerRow(
        "link stopped for 0.3 s", stopped(LINK), CROUCH, crouched(imu_stale), 300 * MS, SECOND_NS, Fault.STALE_IMU
    ),
    ComputerRow(
        "operator partitioned",
        partitioned(asked=1.0),
        PAUSE,
        stood(lease_over),
        3 * SECOND_NS,
        2500 * MS,
        Fault.NO_LEASE,
    ),
    ComputerRow(
        "operator partitioned, and asks",
        partitioned(asked=0.5),
        STAND,
        stood(lease_over),
        3 * SECOND_NS,
        1500 * MS,
        Fault.NO_LEASE,
        (STATUS, "rejected"),
    ),
    ComputerRow("subscribers flood", flooded, WALK_ON, at_once, 2 * SECOND_NS, SECOND_NS),
    ComputerRow("malformed messages", malformed_messages, WALK_ON, at_once, 500 * MS, counted=(STATUS, "rejected")),
    ComputerRow("recorder killed", recorder_killed, WALK_ON, at_once, RECORDER_RESTART_NS, loses=20, breaks_log=True),
    ComputerRow(
        "recorder stopped for 4 s",
        stopped(RECORDER),
        WALK_ON,
        at_once,
        4 * SECOND_NS,
        told="the recorder is silent",
        breaks_log=True,
    ),
    ComputerRow(
        "disk full",
        disk_full,
        WALK_ON,
        at_once,
        3 * SECOND_NS,
        1500 * MS,
        told="cannot record any more",
        breaks_log=True,
    ),
    ComputerRow(
        "log directory gone",
        logs_gone,
        WALK_ON,
        at_once,
        3 * SECOND_NS,
        1500 * MS,
        told="is gone; what it held is lost",
        breaks_log=True,
    ),
    ComputerRow(
        "clock set a minute ahead, and back",
        clock_set(60 * SECOND_NS),
        WALK_ON,
        at_once,
        2 * SECOND_NS,
        1500 * MS,
        counted=(STATUS, "clock_steps"),
    ),
    ComputerRow(
        "clock set a minute back, and ahead",
        clock_set(-60 * SECOND_NS),
        WALK_ON,
        at_once,
        2 * SECOND_NS,
        1500 * MS,
        counted=(STATUS, "clock_steps"),
    ),
    ComputerRow(
        "suspended for 1 s",
        suspended,
        DAMP,
        drives_let_go,
        0,
        2 * SECOND_NS,
        Fault.STOOD_STILL,
        counted=(STATUS, "suspends"),
    ),
)
