# SPDX-License-Identifier: Apache-2.0
"""How far ahead to aim: look-ahead policies (paper 000, eq 17-18). The tracker takes any of them."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from runtime.tracking.fuzzy import coefficient_changes
from runtime.tracking.polyline import Polyline

Distance = Annotated[float, Meta(ge=0.1, le=10.0)]
Coefficient = Annotated[float, Meta(ge=-10.0, le=10.0)]
Scope = Annotated[float, Meta(ge=0.0, le=10.0)]


class LookAhead(NamedTuple):
    """A look-ahead distance and the coefficients it came from.

    Attributes:
        distance: m.
        k_v: coefficient of v^2, eq 18; zero where the policy has none.
        k_w: coefficient of v, eq 18; zero where the policy has none.
    """

    distance: float
    k_v: float = 0.0
    k_w: float = 0.0


class FixedLookAhead(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="fixed"):
    """The same distance always: the paper's pMW.

    Attributes:
        distance_m: look-ahead distance.
    """

    distance_m: Distance = 2.0

    def __call__(self, lateral_error: float, error_rate: float, speed: float) -> LookAhead:
        """The distance."""
        return LookAhead(self.distance_m)

    def along(self, path: Polyline, progress: float) -> float:
        """The distance, m, wherever on the path."""
        return self.distance_m


class FuzzyLookAhead(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="fuzzy"):
    """l = l_0 + lambda_v k_v v^2 + lambda_w k_w v with k = k_0 + delta k from the rule tables (eq 17-18).

    l_0 = 2 m and the tables are the paper's; it does not print the other numbers. The defaults were chosen by
    experiment with a unicycle (0.2 s lag; S-curve at 0.5 and 0.6 m/s, circle and line at 0.6 m/s with 1 cm of noise at
    10 Hz, a line at 1.4 m/s from 0.3 m beside it). Without an error k_w is k_w0 - 1 by the tables, so l = 2 + 1.3 v^2
    - 2.1 v: 2 m at
    rest, 1.2 to 1.3 m at 0.5 to 0.6 m/s, where the mean error on the S-curve is about 1 cm (fixed 2 m: 6 cm, 1.5 m:
    2.4 cm) and noise costs 2 mm, and longer again above 1 m/s for the sake of damping. Scopes of 0.3 and 0.5 let an
    error of 0.1 m change l by about 0.1 m; larger ones overshoot when a large error shrinks at 1.4 m/s (14 cm from 0.3
    m at 1 and 0.5, against 4 cm).

    Attributes:
        base_m: l_0, the distance at rest.
        minimum_m: least distance.
        maximum_m: greatest distance.
        k_v0: coefficient of v^2 before the fuzzy change.
        k_w0: coefficient of v before the fuzzy change.
        lambda_v: scope of the v^2 term, in m per (m/s)^2.
        lambda_w: scope of the v term, in m per (m/s).
    """

    base_m: Distance = 2.0
    minimum_m: Distance = 0.6
    maximum_m: Distance = 2.5
    k_v0: Coefficient = 4.3
    k_w0: Coefficient = -3.2
    lambda_v: Scope = 0.3
    lambda_w: Scope = 0.5

    def __post_init__(self) -> None:
        """Check the bounds against each other.

        Raises:
            ValueError: if they cross.
        """
        if self.minimum_m > self.maximum_m:
            raise ValueError(f"minimum_m = {self.minimum_m} is above maximum_m = {self.maximum_m}")

    def __call__(self, lateral_error: float, error_rate: float, speed: float) -> LookAhead:
        """The distance for this error and speed."""
        delta_v, delta_w = coefficient_changes(lateral_error, error_rate)
        k_v, k_w = self.k_v0 + delta_v, self.k_w0 + delta_w
        distance = self.base_m + self.lambda_v * k_v * speed * speed + self.lambda_w * k_w * speed
        return LookAhead(min(max(distance, self.minimum_m), self.maximum_m), k_v, k_w)
