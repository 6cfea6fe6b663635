# SPDX-License-Identifier: Apache-2.0
"""Standing up and sitting down: joint-space motions between fixed postures."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled

Array = npt.NDArray[np.float64]


class PostureConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Heights of the trunk, and how it moves between them.

    Attributes:
        height_m: trunk origin above the stance plane when standing and walking.
        sitting_height_m: the same at rest.
        crouching_height_m: the same when it is lowered since it can no longer be balanced.
        crouch_s: duration of that.
        rise_s: duration of standing up and of sitting down.
        stiffness_nm_prad, damping_nms_prad: of the joints meanwhile.
    """

    height_m: Annotated[float, msgspec.Meta(gt=0.1, le=0.42)] = 0.29
    sitting_height_m: Annotated[float, msgspec.Meta(gt=0.05, le=0.3)] = 0.12
    crouching_height_m: Annotated[float, msgspec.Meta(gt=0.05, le=0.3)] = 0.17
    rise_s: Annotated[float, msgspec.Meta(gt=0.2, le=10.0)] = 1.5
    crouch_s: Annotated[float, msgspec.Meta(gt=0.1, le=2.0)] = 0.5
    stiffness_nm_prad: Annotated[float, msgspec.Meta(gt=0.0, le=500.0)] = 100.0
    damping_nms_prad: Annotated[float, msgspec.Meta(gt=0.0, le=5.0)] = 2.0


@compiled
def blend(begin: Array, end: Array, progress: float) -> tuple[Array, Array]:
    """Minimum-jerk motion: position, and rate per unit of progress, at `progress` in [0, 1]."""
    s = min(max(progress, 0.0), 1.0)
    position = begin + (end - begin) * (s**3.0 * (10 - 15 * s + 6 * s * s))
    rate = (end - begin) * (30 * s * s * (1 - s) ** 2)
    return position, rate
