# SPDX-License-Identifier: Apache-2.0
"""The control process: a robot's loops on its buses, its inputs in shared files, its ticks told to other processes.

Nothing else lives in it: the loops' threads, and a main thread that sleeps until it is told to stop.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from drivers.bus_health import BusMonitor
from drivers.bus_socket import open_buses
from drivers.socket_ports import SocketReader, SocketWriter
from runtime.executors.liveness import Liveness
from runtime.executors.loop_run import InputPort
from runtime.executors.notify import Notifier
from runtime.executors.realtime import EXIT_LATENCY_US, SWITCH_INTERVAL_US, WAKE_EARLY_US, RealTime
from runtime.executors.remembered_stop import RememberedStop
from runtime.executors.shared_ports import LatestPort
from runtime.executors.tick_stream import LINK_SOCKET, OBSERVER_SOCKET, RECORDER_SOCKET, TickStream, TickStreams
from runtime.robots import topics
from runtime.robots.fresh_frames import FreshFrames
from runtime.robots.robot import Robot

STREAMS = (RECORDER_SOCKET, LINK_SOCKET, OBSERVER_SOCKET)
"""Where the ticks go; the drops of the first are told in them."""


def control(
    robot: Robot,
    interface: str,
    channels: Sequence[str],
    directory: Path,
    command_age_max_ns: int,
    processors: Collection[int] = (),
    switch_interval_us: int = SWITCH_INTERVAL_US,
    exit_latency_us: int = EXIT_LATENCY_US,
    wake_early_us: int = WAKE_EARLY_US,
    say: Callable[[str], None] = lambda sentence: None,
) -> None:
    """Run a robot until SIGTERM or SIGINT.

    Args:
        robot: assembled; rehearsed before, or its first ticks are late.
        interface: of python-can, by which the buses are opened.
        channels: of that interface, one a bus.
        directory: runtime directory, shared with the other processes.
        command_age_max_ns: commands older than this are not sent.
        processors: that the loops may run on; none for all.
        switch_interval_us: see `RealTime`.
        exit_latency_us: likewise.
        wake_early_us: likewise.
        say: likewise.

    Raises:
        DriverConfigError: if a bus cannot be opened, but for one whose link is down: the others' drives are damped.
    """
    buses = open_buses(interface, channels)
    try:
        for bus in buses:
            if bus.awaited:
                say(f"{bus.awaited}; the robot can be reset when it is up")
        inputs: dict[str, InputPort] = {
            topics.CAN_RECEIVED: SocketReader(buses),
            topics.BUS_STATUS: BusMonitor([bus.health for bus in buses]),
            topics.OPERATOR_EVENT: RememberedStop(directory, robot.loops, say),
        }
        for loop in robot.loops:
            for record in loop.port_inputs:
                inputs.setdefault(record.topic, LatestPort(directory))
        executor = RealTime(
            robot.loops,
            inputs,
            {topics.CAN_SENT: FreshFrames(SocketWriter(buses), command_age_max_ns)},
            TickStreams(*(TickStream(directory / name) for name in STREAMS)),
            processors,
            switch_interval_us=switch_interval_us,
            liveness=Liveness(Notifier()),
            exit_latency_us=exit_latency_us,
            wake_early_us=wake_early_us,
            say=say,
        )
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: executor.stop())
        executor.run()
    finally:
        for bus in buses:
            bus.close()
