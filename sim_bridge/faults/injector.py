# SPDX-License-Identifier: Apache-2.0
"""Faults in real time, injected where the simulator stands: it is the far end of every wire.

It is given one order a line: the name of a fault, to begin at a random phase of the gait as soon as the robot walks, or
the end of the present one. A fault of processes has nothing to inject here: who gave the order is told the moment.
"""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec
import numpy as np

from runtime.executors.loop_run import InputPort
from runtime.records import Record
from runtime.robots import topics
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import BodyCommand, Gait, Mode, SafetyStatus
from sim_bridge.faults.live_buses import LiveBuses
from sim_bridge.faults.wires import Inject, QuadrupedWires
from sim_bridge.faults.witness import Witness
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.tick_mirror import TickMirror

STEADY_NS, STEADY_MPS = 500_000_000, 0.4
"""A robot that has been asked for so long to walk so fast, or faster, is at its speed; one that was given its path anew
first looks for its place on it."""
LEFT_M = 5.0
"""Of its lap: a robot that stands at the end of it while a fault is watched would seem to have been stopped by that."""
LOOK_NS = 10_000_000
SILENT_NS = 200_000_000
"""Without a tick for so long, control is called silent."""
SILENT = "SILENT"
FRAMES_FILE = "frames.npz"


class Order(msgspec.Struct):
    """What the injector is told.

    Attributes:
        fault: name; of one that the injector does not know only the moment is told. None ends the present one.
        seed: of the phase, and of what the fault leaves to chance.
        lasts_ns: how long the fault is there.
    """

    fault: str | None
    seed: int = 0
    lasts_ns: int = 0


class Tap:
    """An input port that is looked up at each read, so that what stands there can be changed."""

    def __init__(self, inputs: Mapping[str, InputPort], topic: str) -> None:
        self._inputs, self._topic = inputs, topic

    def read(self, record: Record, now_ns: int) -> bool:
        """Read the port that stands there now."""
        return self._inputs[self._topic].read(record, now_ns)


class Injector:
    """Carries out orders in a world that runs in real time.

    Args:
        config: of the robot.
        world, buses: the far ends.
        inputs: ports by topic; those that are read through a `Tap` can be broken.
        mirror: of the robot's records.
        faults: what can be injected, by name.
        directory: for the frames that the drives received.
        answer: told of the moment (`struck`), of the robot's state when it changes (`state`), and of what was seen
            (`seen`).
        orders: descriptor to read them from.
    """

    def __init__(
        self,
        config: Uslgo1Config,
        world: QuadrupedWorld,
        buses: LiveBuses,
        inputs: dict[str, InputPort],
        mirror: TickMirror,
        faults: Mapping[str, Inject],
        directory: Path,
        answer: Callable[..., None],
        orders: int,
    ) -> None:
        self._config, self._world, self._buses, self._inputs = config, world, buses, inputs
        self._whole = dict(inputs)
        self._mirror, self._faults, self._answer, self._orders = mirror, faults, answer, orders
        self._file, self._pending = directory / FRAMES_FILE, b""
        self._safety: SafetyStatus = mirror.records[topics.SAFETY]  # type: ignore[assignment]
        self._gait: Gait = mirror.records[topics.GAIT]  # type: ignore[assignment]
        self._command: BodyCommand = mirror.records[topics.BODY_COMMAND]  # type: ignore[assignment]
        self._witness = Witness(config, world)
        buses.heard = self._witness.hear
        self._wires: QuadrupedWires | None = None
        self._order: Order | None = None
        self._strike_ns = 0
        self._walks_since_ns: int | None = None
        self._ticks = self._tick_ns = 0
        self._state = ""

    def step(self, now_ns: int) -> None:
        """Once a step of the physics."""
        if self._wires is not None:
            for event in self._wires.events:
                event(now_ns)
        self._witness.look()
        if now_ns % LOOK_NS == 0:
            self._look(now_ns)
        if self._strike_ns and self._wires is None and now_ns >= self._strike_ns - LOOK_NS:
            self._prepare()
        if self._strike_ns and now_ns >= self._strike_ns:
            self._strike()

    def _look(self, now_ns: int) -> None:
        self._watch_robot(now_ns)
        for order in self._taken():
            if order.fault is None:
                self._mend()
            else:
                self._order = order
        since_ns = self._walks_since_ns
        if self._order is not None and not self._strike_ns and since_ns is not None and now_ns - since_ns >= STEADY_NS:
            rng = np.random.default_rng((self._order.seed, *(self._order.fault or "").encode()))
            self._strike_ns = now_ns + int(rng.integers(self._config.gait.period_ns))

    def _watch_robot(self, now_ns: int) -> None:
        if self._mirror.taken != self._ticks:
            self._ticks, self._tick_ns = self._mirror.taken, now_ns
        silent = now_ns - self._tick_ns > SILENT_NS
        state = SILENT if silent else Mode(self._safety.mode).name
        on_its_way = self._command.velocity[0] >= STEADY_MPS and self._command.remaining >= LEFT_M
        walks = state == Mode.ACTIVE.name and bool(self._gait.walking) and on_its_way
        if not walks:
            self._walks_since_ns = None
            if self._strike_ns:  # it stumbled before the moment came: wait until it walks again
                self._strike_ns = 0
                self._restore()
        elif self._walks_since_ns is None:
            self._walks_since_ns = now_ns
        if state != self._state:
            self._state = state
            self._answer(state=state)

    def _taken(self) -> list[Order]:
        """Orders that have come."""
        while select.select([self._orders], [], [], 0)[0]:
            read = os.read(self._orders, 4096)
            if not read:
                break
            self._pending += read
        *lines, self._pending = self._pending.split(b"\n")
        return [msgspec.json.decode(line, type=Order) for line in lines]

    def _prepare(self) -> None:
        """Get hold of the wires; what they carry until the fault begins may be of use to it."""
        order = self._order
        assert order is not None
        name = order.fault or ""
        rng = np.random.default_rng((order.seed, 1, *name.encode()))
        self._wires = QuadrupedWires(self._config, self._buses, self._world, self._inputs, (), rng)
        if name in self._faults:
            self._faults[name](self._wires, self._strike_ns, self._strike_ns + order.lasts_ns)

    def _strike(self) -> None:
        order, self._order, self._strike_ns = self._order, None, 0
        assert order is not None
        self._witness.begin()
        self._answer(struck=order.fault, at_ns=time.monotonic_ns())

    def _mend(self) -> None:
        """End the fault, and tell what was seen."""
        self._restore()
        self._answer(seen=self._witness.end(self._file))

    def _restore(self) -> None:
        """Put everything back as it was."""
        self._wires, self._buses.tamper = None, None
        self._inputs.update(self._whole)
        for joint in range(len(self._config.drives.bus)):
            self._world.drives.force_error(joint, 0)
        for bus in range(self._config.drives.buses):
            self._buses.bring_up(bus)
