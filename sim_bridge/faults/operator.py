# SPDX-License-Identifier: Apache-2.0
"""Operators that fall silent, fight for the robot, stop it, or talk nonsense."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from runtime.records import Record
from runtime.robots import topics
from runtime.signals import Motion, OperatorEvent, Path, Request
from sim_bridge.faults.sensors import silent
from sim_bridge.faults.wires import AnyWires, Inject
from sim_bridge.script import PRIORITY, SOURCE

OTHER, BOSS = 2, 3
"""Senders of lower and of higher priority than the operator's."""


def insert(wires: AnyWires, topic: str, at_ns: int, acts: list[Callable[[Any], None]]) -> None:
    """Put records of one's own before those of a port, from a time on, one a read."""
    port, acts = wires.inputs[topic], list(acts)

    class Inserted:
        def read(self, record: Record, now_ns: int) -> bool:
            if now_ns < at_ns or not acts:
                return port.read(record, now_ns)
            record.stamp_ns = now_ns
            acts.pop(0)(record)
            return True

    wires.inputs[topic] = Inserted()


def says(request: Request, motion: Motion = Motion.REST, source: int = SOURCE, priority: int = PRIORITY) -> Any:
    """Something that fills an event."""

    def act(event: OperatorEvent) -> None:
        event.request, event.motion, event.source, event.priority = request, motion, source, priority
        event.velocity = 0.0

    return act


def operator_says(*acts: Callable[[OperatorEvent], None]) -> Inject:
    """Events, one after the other; then nothing but them until the end."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        silent(topics.OPERATOR_EVENT)(wires, begin_ns, end_ns)
        insert(wires, topics.OPERATOR_EVENT, begin_ns, list(acts))

    return inject


def interrupted(*acts: Callable[[OperatorEvent], None]) -> Inject:
    """Events of others among those of the operator."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        insert(wires, topics.OPERATOR_EVENT, begin_ns, list(acts))

    return inject


def walks_again(wires: AnyWires, at_ns: int) -> None:
    """The operator asks to walk anew, once there is a robot to ask."""
    insert(wires, topics.OPERATOR_EVENT, at_ns, [says(Request.MOTION, Motion.WALK)])


def bad_path(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """A path arrives that cannot be followed."""

    def act(path: Path) -> None:
        path.count, path.speed = 3, 0.5
        path.x[:3], path.y[:3] = (0.0, np.nan, 1.0), 0.0

    insert(wires, topics.PATH, begin_ns, [act])


def path_withdrawn_by(source: int) -> Inject:
    """Somebody takes back the path."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        def act(path: Path) -> None:
            path.source, path.count = source, 0

        insert(wires, topics.PATH, begin_ns, [act])

    return inject


def asks_for(forward: float, lateral: float, yaw_rate: float) -> Any:
    """Something that fills an event by which the operator steers, m/s and rad/s."""

    def act(event: OperatorEvent) -> None:
        event.request, event.source, event.priority = Request.VELOCITY, SOURCE, PRIORITY
        event.velocity = (forward, lateral, yaw_rate)

    return act


def nonsense(event: OperatorEvent) -> None:
    """A request that there is none of."""
    event.request = 200


def not_a_number(event: OperatorEvent) -> None:
    """A velocity that is no number."""
    event.request, event.velocity = Request.VELOCITY, np.nan


def from_long_ago(event: OperatorEvent) -> None:
    """An event that was long on its way."""
    event.request, event.motion = Request.MOTION, Motion.SIT
    event.stamp_ns -= 10_000_000_000


TAKES_OVER = says(Request.LIFE, source=BOSS, priority=200)
FOREIGN = [says(request, Motion.SIT, OTHER, 1) for request in Request if request != Request.EMERGENCY_STOP]
NONSENSE = [nonsense, not_a_number, from_long_ago]
