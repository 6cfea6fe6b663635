# SPDX-License-Identifier: Apache-2.0
"""What the configuration of every robot has; each robot's own adds the rest."""

from __future__ import annotations

from abc import abstractmethod
from typing import Annotated, Literal

import msgspec

from runtime.robots.link_config import LinkConfig
from runtime.safety.authority import AuthorityConfig


class Variant(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which algorithms run; a robot's own names those that it has.

    Attributes:
        controller: the first that a robot names is its default.
        estimator: of the state; `truth` is for simulation only.
    """

    controller: str
    estimator: str


class RealtimeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the processes share the machine.

    Attributes:
        control_processors, link_processors: numbers of the processors that they run on; empty for all.
        link_priority: of the link's threads.
        recorder_priority: of the recorder's threads, below all others; 0 for the normal one.
        control_switch_interval_us: how long the fast loop, once woken, waits for the interpreter if another has it.
        link_switch_interval_us: the same for the link, whose threads are many and not all its own.
        exit_latency_max_us: how long a processor may take to leave its idle state, while control runs.
        control_wake_early_us: how long before its release the fast loop is woken, to wait for it awake.
    """

    control_processors: tuple[Annotated[int, msgspec.Meta(ge=0, le=1023)], ...] = ()
    link_processors: tuple[Annotated[int, msgspec.Meta(ge=0, le=1023)], ...] = ()
    link_priority: Annotated[int, msgspec.Meta(ge=1, le=98)] = 40
    recorder_priority: Annotated[int, msgspec.Meta(ge=0, le=98)] = 20
    control_switch_interval_us: Annotated[int, msgspec.Meta(ge=50, le=5000)] = 50
    link_switch_interval_us: Annotated[int, msgspec.Meta(ge=50, le=5000)] = 100
    exit_latency_max_us: Annotated[int, msgspec.Meta(ge=0, le=100_000)] = 0
    control_wake_early_us: Annotated[int, msgspec.Meta(ge=0, le=500)] = 60


class BusConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the buses are opened, and how old what is sent on them may be.

    Attributes:
        interface: of python-can, by which the buses are opened: socketcan, or ugv-unix (a CAN hub on a socket file).
        channels: of that interface, one a bus.
        bit_rate_hz: of every bus.
        command_age_max_ns: an older command is not sent.
    """

    interface: Literal["socketcan", "ugv-unix"]
    channels: tuple[str, ...]
    bit_rate_hz: Annotated[int, msgspec.Meta(ge=125_000, le=1_000_000)]
    command_age_max_ns: Annotated[int, msgspec.Meta(gt=0, le=100_000_000)]

    @property
    def buses(self) -> int:
        """Number of buses."""
        return len(self.channels)


class RobotConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the core reads of any robot's configuration."""

    robot: str
    variant: Variant
    realtime: RealtimeConfig
    link: LinkConfig
    drives: BusConfig
    authority: AuthorityConfig

    @property
    @abstractmethod
    def highest_priority(self) -> int:
        """Of the threads of its loops."""

    @abstractmethod
    def bus_loads(self) -> list[float]:
        """Share of each bus that is taken at the worst, 0 to 1."""
