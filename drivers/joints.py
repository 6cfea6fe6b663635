# SPDX-License-Identifier: Apache-2.0
"""How a joint hangs on its drive: address, direction, gear, offset and limits.

With m = direction * gear_ratio: motor angle = m (q - offset), motor speed = m q_dot, motor torque = joint torque / m,
and so stiffness and damping divide by m^2. Power is the same on both sides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.dialects import Ranges
from drivers.errors import DriverConfigError
from drivers.mit import FloatArray, Transform

UNBOUNDED = (-math.inf, math.inf)


@dataclass(frozen=True)
class Joint:
    """One joint and its drive.

    Attributes:
        name: for messages.
        bus: index of its bus.
        drive_id: the drive's own id.
        master_id: identifier to which the drive replies, where the dialect leaves that open.
        ranges: of the drive's fields, at the drive's output.
        direction: +1 or -1, the sense in which the drive counts the joint's angle.
        gear_ratio: turns of the drive's output for one turn of the joint.
        offset: rad, joint angle at which the drive reads zero.
        position_limits: rad, of commands; unbounded for a joint that turns on and on (it gets no stiffness).
        velocity_limit: rad/s, of commands.
        effort_limit: N.m, of the feed-forward effort.
        fallback_damping: N.m.s/rad, given when there is no valid command.
        plausible_position: rad; a reply outside of it is rejected as out of range.
        plausible_velocity: rad/s; the same.
    """

    name: str
    bus: int
    drive_id: int
    master_id: int
    ranges: Ranges
    direction: int = 1
    gear_ratio: float = 1.0
    offset: float = 0.0
    position_limits: tuple[float, float] = UNBOUNDED
    velocity_limit: float = math.inf
    effort_limit: float = math.inf
    fallback_damping: float = 0.0
    plausible_position: tuple[float, float] = UNBOUNDED
    plausible_velocity: float = math.inf

    def __post_init__(self) -> None:
        self._check(self.direction in (1, -1), f"direction = {self.direction} is neither 1 nor -1")
        self._check(0 < self.gear_ratio < math.inf, f"gear_ratio = {self.gear_ratio} is not a positive number")
        self._check(math.isfinite(self.offset), f"offset = {self.offset} is not a finite number")
        self._check(0 <= self.bus <= 255, f"bus = {self.bus} is not within 0 to 255")
        self._check(0 <= self.drive_id <= 0xFF, f"drive_id = {self.drive_id:#x} is not within 0 to 0xff")
        self._check(0 <= self.master_id <= 0x7FF, f"master_id = {self.master_id:#x} is not within 0 to 0x7ff")
        for name in ("position_limits", "plausible_position"):
            low, high = getattr(self, name)
            self._check(low < high, f"{name} = {low} to {high} is not an increasing pair")
        for name in ("velocity_limit", "effort_limit", "plausible_velocity"):
            self._check(getattr(self, name) > 0, f"{name} = {getattr(self, name)} is not positive")
        self._check_reach()

    @property
    def multiplier(self) -> float:
        """m, turns of the drive's output in its own sense for one turn of the joint."""
        return self.direction * self.gear_ratio

    @property
    def continuous(self) -> bool:
        """Whether the joint has no position limits."""
        return self.position_limits == UNBOUNDED

    def _check_reach(self) -> None:
        """The limits must be values that the drive can represent."""
        ranges, gear = self.ranges, self.gear_ratio
        if not self.continuous:
            ends = sorted(self.multiplier * (limit - self.offset) for limit in self.position_limits)
            self._within("position_limits", ends[0], ranges.position, "rad")
            self._within("position_limits", ends[1], ranges.position, "rad")
        if math.isfinite(self.velocity_limit):
            self._within("velocity_limit", gear * self.velocity_limit, ranges.velocity, "rad/s")
        if math.isfinite(self.effort_limit):
            self._within("effort_limit", self.effort_limit / gear, ranges.effort, "N.m")
        self._within("fallback_damping", self.fallback_damping / gear**2, ranges.damping, "N.m.s/rad")

    def _within(self, name: str, value: float, ends: tuple[float, float], unit: str) -> None:
        text = f"{name} needs {value:g} {unit} at the drive, whose range is {ends[0]:g} to {ends[1]:g}"
        self._check(ends[0] <= value <= ends[1], text)

    def _check(self, right: bool, message: str) -> None:
        if not right:
            raise DriverConfigError(f"joint {self.name}: {message}")


def transform_of(joints: Sequence[Joint]) -> Transform:
    """The map from joint to drive coordinates, rows as `COMMAND_FIELDS`."""
    m = np.array([joint.multiplier for joint in joints])
    factor = np.stack([m, m, 1 / m, 1 / m**2, 1 / m**2])
    shift = np.zeros_like(factor)
    shift[0] = -m * np.array([joint.offset for joint in joints])
    return Transform(factor, shift)


def command_limits(joints: Sequence[Joint]) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest command in joint coordinates, rows as `COMMAND_FIELDS`; no stiffness for continuous joints."""
    low = np.array(
        [[j.position_limits[0], -j.velocity_limit, -j.effort_limit, -math.inf, -math.inf] for j in joints]
    ).T.copy()
    high = np.array(
        [
            [j.position_limits[1], j.velocity_limit, j.effort_limit, 0.0 if j.continuous else math.inf, math.inf]
            for j in joints
        ]
    ).T.copy()
    return low, high


def column(joints: Sequence[Joint], name: str, dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    """One attribute of every joint as an array."""
    return np.array([getattr(joint, name) for joint in joints], dtype)
