# SPDX-License-Identifier: Apache-2.0
"""What is to come of a fault, what came of it when it was tried, and in what the two differ."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol, TypeVar

from runtime.robots.robot_config import RobotConfig
from runtime.signals import Fault
from sim_bridge.faults.wires import ConfigT

ConfigT_contra = TypeVar("ConfigT_contra", bound=RobotConfig, contravariant=True)


class Expectation(Protocol[ConfigT_contra]):
    """What is to come of a fault in a trial; see `Row`."""

    @property
    def answer(self) -> tuple[str, ...]:
        """What the robot is to do, in order."""

    @property
    def bound_ns(self) -> Callable[[ConfigT_contra], int]:
        """How soon the last of it is to be reached."""

    @property
    def fault(self) -> Fault:
        """Bits by which it is to be named."""

    @property
    def counted(self) -> tuple[str, str] | None:
        """Topic and field of what is to be counted."""

    @property
    def forced(self) -> bool:
        """Whether a force from outside may take the robot beyond its limits."""


class Trial(NamedTuple):
    """What came of one.

    Attributes:
        answer: what the robot did, in order.
        time_ns: from the fault to the last of it, but going on; 0 if there is nothing else.
        faults: bits that were seen.
        counted: by how much the count grew.
        limits_kept: whether what safety promises of joints or wheels was kept until the robot was damped.
        oldest_ns: age of the oldest command when it reached the far end of its bus.
        stop_kept: whether a damped robot was not driven any more.
        fell: whether it fell before it was damped.
    """

    answer: tuple[str, ...]
    time_ns: int
    faults: Fault
    counted: int
    limits_kept: bool
    oldest_ns: int
    stop_kept: bool
    fell: bool


def flaws(row: Expectation[ConfigT], trial: Trial, config: ConfigT) -> list[str]:
    """In what a trial differs from what it is to be."""
    found = []
    if trial.answer != row.answer:
        found.append(f"answer is {', '.join(trial.answer)}")
    if trial.time_ns > row.bound_ns(config):
        found.append(f"took {trial.time_ns * 1e-6:.0f} ms of {row.bound_ns(config) * 1e-6:.0f} ms")
    if row.fault & ~trial.faults:
        found.append(f"{(row.fault & ~trial.faults).name} was not named")
    if row.counted is not None and not trial.counted:
        found.append(f"{row.counted[1]} did not grow")
    if not trial.limits_kept and not row.forced:
        found.append("a limit was passed")
    if trial.oldest_ns > config.drives.command_age_max_ns:
        found.append(f"a command of {trial.oldest_ns * 1e-6:.1f} ms was sent")
    if not trial.stop_kept:
        found.append("it was driven though damped")
    if trial.fell:
        found.append("it fell before it was damped")
    return found
