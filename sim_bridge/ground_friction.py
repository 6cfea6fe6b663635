# SPDX-License-Identifier: Apache-2.0
"""Where the ground is slippery."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class FrictionPatch:
    """A rectangle of ground with a friction of its own.

    Attributes:
        x_m, y_m: its ends along either axis, the smaller one first.
        friction: of a tyre on it.

    Raises:
        ValueError: if the ends are not in order or the friction is not positive.
    """

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    friction: float

    def __post_init__(self) -> None:
        if not (self.x_m[0] < self.x_m[1] and self.y_m[0] < self.y_m[1]):
            raise ValueError(f"friction patch: {self.x_m} by {self.y_m} m is not a rectangle")
        if not 0.0 < self.friction < np.inf:
            raise ValueError(f"friction patch: friction = {self.friction} must be positive and finite")

    def holds(self, x: Array, y: Array) -> Flags:
        """Whether each point lies on it."""
        return (self.x_m[0] <= x) & (x <= self.x_m[1]) & (self.y_m[0] <= y) & (y <= self.y_m[1])


def friction_at(x: Array, y: Array, patches: Sequence[FrictionPatch], elsewhere: float) -> Array:
    """Friction of the ground at each point; of patches that overlap the last one counts."""
    friction = np.full(np.shape(x), elsewhere)
    for patch in patches:
        friction[patch.holds(x, y)] = patch.friction
    return friction


def on_any(x: Array, y: Array, patches: Sequence[FrictionPatch]) -> Flags:
    """Whether each point lies on a patch."""
    return np.any([patch.holds(x, y) for patch in patches], axis=0)
