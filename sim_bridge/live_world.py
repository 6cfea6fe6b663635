# SPDX-License-Identifier: Apache-2.0
"""The simulated robot against the wall clock: its drives on real buses, its sensors' samples handed on.

World time begins with the first frame that reaches a drive, as a robot's begins when it is switched on. A world that
was late makes up for it step by step, up to a bound; what it is late beyond that is lost, and told.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

from drivers.device_end import Wires
from drivers.memory_bus import End
from runtime.executors.collector import collector_paused
from runtime.executors.companions import CompanionTicks
from runtime.executors.linux import Alarm
from runtime.executors.loop_run import InputPort
from runtime.executors.switch_interval import switch_interval
from runtime.records import Record
from sim_bridge.world import World
from sim_bridge.worst_lag import Lag, WorstLag

START_AFTER_NS = 5_000_000
POLL_NS = 1_000_000
PATIENCE_NS = 5_000_000_000
"""For so long a world waits for those who listen to its operator."""
SWITCH_INTERVAL_US = 100
"""A world that is late never sleeps, and the thread that sends the sensors' samples must not wait long for its turn."""
LONGEST_LAG_NS = 5_000_000
"""A world that is later than this stands still for the rest: a slow computer must not leave it behind for good, nor its
samples be too old when they are taken."""
CPU_NS = 0
"""Not measured, so that a long step of the world counts as a stall, which it is to the robot."""


class Outlet(Protocol):
    """Where what a sensor or the operator says leaves the simulator."""

    def publish(self, record: Record, start_ns: int) -> None:
        """Send the record.

        Args:
            record: stamped in world time.
            start_ns: of world time, on the monotonic clock.
        """


Source = tuple[Record, InputPort, Outlet]
"""A sensor (or the operator), the record that it fills, and where that goes."""


class LiveWorld:
    """Runs a world in real time.

    Args:
        world: whose buses are real.
        wires: those buses.
        step_ns: of its physics.
        sources: looked at after every step.
        ticks: logs the step since the last tick that was latest, given the time of its first release.
        heard: whether somebody listens to the operator.

    Attributes:
        lost_ns: for which the world stood still, since it was too late.
    """

    def __init__(
        self,
        world: World,
        wires: Wires,
        step_ns: int,
        sources: Sequence[Source],
        ticks: Callable[[int], CompanionTicks],
        heard: Callable[[], bool],
    ) -> None:
        self._world, self._wires, self._step_ns = world, wires, step_ns
        self._sources, self._ticks, self._heard = tuple(sources), ticks, heard
        self.start_ns = self.lost_ns = 0

    def run(self, over: Callable[[int], bool]) -> int:
        """Wait for a frame and for listeners, then run until `over(world time)`; returns the world time reached."""
        alarm = Alarm()
        with collector_paused(), switch_interval(SWITCH_INTERVAL_US):
            self._wait(alarm, over)
            self.start_ns = time.monotonic_ns() + START_AFTER_NS
            ticks, now_ns, lag = self._ticks(self.start_ns), 0, WorstLag()
            while not over(now_ns):
                due_ns = self.start_ns + now_ns + self._step_ns
                alarm.sleep_until(due_ns)
                began_ns, lost_ns = time.monotonic_ns(), self.lost_ns
                self._stand_still(began_ns - due_ns - LONGEST_LAG_NS)
                now_ns += self._step_ns
                self._step(now_ns)
                done_ns = time.monotonic_ns()
                lag.note(Lag(due_ns, began_ns, done_ns), lost_ns)
                if done_ns >= ticks.release_ns:
                    worst = lag.take(self.lost_ns)
                    ticks.log(worst.due_ns, worst.began_ns, worst.done_ns, CPU_NS, done_ns)
        return now_ns

    def _stand_still(self, too_late_ns: int) -> None:
        if too_late_ns > 0:
            self.start_ns += too_late_ns
            self.lost_ns += too_late_ns

    def _step(self, now_ns: int) -> None:
        self._world.advance(now_ns)
        for record, port, outlet in self._sources:
            if port.read(record, now_ns):
                outlet.publish(record, self.start_ns)

    def _wait(self, alarm: Alarm, over: Callable[[int], bool]) -> None:
        while not self._wires.receive(End.DEVICE, 0).bus.size and not over(0):
            alarm.sleep_until(time.monotonic_ns() + POLL_NS)
        until_ns = time.monotonic_ns() + PATIENCE_NS
        while not self._heard() and time.monotonic_ns() < until_ns and not over(0):
            alarm.sleep_until(time.monotonic_ns() + POLL_NS)
