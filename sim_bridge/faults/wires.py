# SPDX-License-Identifier: Apache-2.0
"""What a fault can lay hands on: buses, ports, the world, tasks, and the time that loops take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from drivers.can_frame import Frames
from drivers.memory_bus import End, Tamper
from runtime.executors.loop_run import InputPort
from runtime.records import Record
from runtime.robots.robot_config import RobotConfig
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.robots.vehicle_4ws4wd.config import Vehicle4ws4wdConfig
from runtime.tasks import Loop, Task
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.vehicle_world import VehicleWorld
from sim_bridge.world import World

FOREVER_NS = 1 << 62
ConfigT = TypeVar("ConfigT", bound=RobotConfig)
WorldT = TypeVar("WorldT", bound=World)


class Buses(Protocol):
    """Buses whose frames and links can be tampered with; a `MemoryBus` is such, and so are `LiveBuses`.

    Attributes:
        tamper: alters or destroys frames on their way; None leaves them alone.
    """

    tamper: Tamper | None

    def send(self, end: End, bus: npt.NDArray[np.uint8], frames: Frames, at_ns: int | npt.NDArray[np.int64]) -> None:
        """Give frames (n,) to the buses (n,)."""

    def take_down(self, bus: int) -> None:
        """Let a link be lost."""

    def bring_up(self, bus: int) -> None:
        """Let it return."""


@dataclass
class Wires(Generic[ConfigT, WorldT]):
    """What a fault can lay hands on.

    Attributes:
        config: of the robot.
        bus, world: the far ends.
        inputs: ports by topic.
        loops: of the robot.
        rng: for what a fault leaves to chance.
        delays: of the loops' steps, by loop: from (index) to ns.
        events: called with the time at every tick, before the world moves on.
    """

    config: ConfigT
    bus: Buses
    world: WorldT
    inputs: dict[str, InputPort]
    loops: Sequence[Loop]
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))
    delays: dict[str, Callable[[int], int]] = field(default_factory=dict)
    events: list[Callable[[int], None]] = field(default_factory=list)

    def task(self, name: str) -> Task:
        """A task of the robot."""
        (found,) = (item.task for loop in self.loops for item in loop.schedule if item.task.name == name)
        return found

    def period_ns(self, loop: str) -> int:
        """Between two releases of a loop."""
        (found,) = (one.period_ns for one in self.loops if one.name == loop)
        return found

    def delay(self, loop: str, index: int) -> int:
        """How long a step takes, as an executor asks for it."""
        delay = self.delays.get(loop)
        return 0 if delay is None else delay(index)

    def tamper(self, change: Callable[[End, int, int, bytearray], bool]) -> None:
        """Have every frame changed on its way (sender, bus, arrival, bytes); it is destroyed where that is false."""

        def tamper(sender: End, bus: int, arrival_ns: int, frame: bytes) -> bytes | None:
            altered = bytearray(frame)
            return bytes(altered) if change(sender, bus, arrival_ns, altered) else None

        self.bus.tamper = tamper

    def filter(self, topic: str, change: Callable[[Any, int], bool]) -> None:
        """Have every record of an input port changed after it was read; it is withheld where that is false."""
        self.inputs[topic] = _Filter(self.inputs[topic], change)

    def once(self, at_ns: int, act: Callable[[], None]) -> None:
        """Do something at a time."""

        def event(now_ns: int) -> None:
            nonlocal at_ns
            if now_ns >= at_ns:
                at_ns = FOREVER_NS
                act()

        self.events.append(event)


class _Filter:
    """An input port whose records are changed or withheld."""

    def __init__(self, port: InputPort, change: Callable[[Any, int], bool]) -> None:
        self._port, self._change = port, change
        self._news: Record | None = None

    def read(self, record: Record, now_ns: int) -> bool:
        if self._news is None:
            self._news = record.like()
        news = self._news
        news.copy_from(record)
        if not self._port.read(news, now_ns) or not self._change(news, now_ns):
            return False
        record.copy_from(news)
        return True


AnyWires = Wires[Any, Any]
QuadrupedWires = Wires[Uslgo1Config, QuadrupedWorld]
VehicleWires = Wires[Vehicle4ws4wdConfig, VehicleWorld]
Inject = Callable[[AnyWires, int, int], None]
"""Prepares a fault that is there from a time until before another, ns."""
