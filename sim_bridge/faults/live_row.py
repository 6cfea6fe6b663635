# SPDX-License-Identifier: Apache-2.0
"""What a row says of a fault that is tried in real time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

from runtime.recording.recorder_status import RecorderStatus
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Fault
from sim_bridge.faults.stage import Act
from sim_bridge.faults.table import Bound
from sim_bridge.faults.table_parts import MS, at_once
from sim_bridge.faults.wires import FOREVER_NS, Inject

LINGER_NS = 500 * MS
"""How long to go on watching after the last answer is due."""


class Need(Enum):
    """What a fault takes that not every computer grants; the value says so."""

    DISK = "no disk of its own may be mounted here"
    CLOCK = "the clock may not be set here"


@dataclass(frozen=True)
class LiveRow:
    """A fault in real time, and its answer.

    Attributes:
        name: for people.
        answer: what the robot is to do, in order; see `Row`.
        bound_ns: how soon, of the configuration.
        inject: breaks the wires, in the simulator;
        act, mend: or something beside them, and puts it right again;
        prepare: makes ready for it what takes time.
        lasts_ns: how long the fault is there; what is there for good ends when its answer was seen.
        after_ns: how long to go on watching then.
        fault: bits by which it is to be named.
        counted: topic and field of what is to be counted.
        before: answers that may come before.
        holds_up: loops that the fault itself holds up.
        recorder: what the recorder says of itself while the fault is there.
        needs: what it takes that may not be granted.
        breaks_log: whether ticks are missing while it is there.
        settings: configuration that shows this answer.
    """

    name: str
    answer: tuple[str, ...]
    bound_ns: Bound = at_once
    inject: Inject | None = None
    prepare: Act | None = None
    act: Act | None = None
    mend: Act | None = None
    lasts_ns: int = FOREVER_NS
    after_ns: int = LINGER_NS
    fault: Fault = Fault.NONE
    counted: tuple[str, str] | None = None
    before: tuple[str, ...] = ()
    holds_up: tuple[str, ...] = ()
    recorder: Callable[[RecorderStatus], bool] | None = None
    needs: Need | None = None
    breaks_log: bool = False
    settings: dict[str, str] = field(default_factory=dict)

    def watched_ns(self, config: Uslgo1Config) -> int:
        """How long the fault is there."""
        return self.lasts_ns if self.lasts_ns < FOREVER_NS else self.bound_ns(config) + LINGER_NS
