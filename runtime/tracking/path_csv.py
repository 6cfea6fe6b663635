# SPDX-License-Identifier: Apache-2.0
"""Waypoints from a CSV file: two columns x,y in metres, an optional header, blank lines and # comments skipped."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from runtime.tracking.errors import PathError
from runtime.tracking.waypoints import check_waypoints

HEADERS = (["x", "y"], ["x_m", "y_m"])


class WaypointCheck(Protocol):
    """Which waypoints are a path, as `check_waypoints` says it."""

    def __call__(
        self, points: npt.ArrayLike, *, closed: bool, capacity: int | None, source: str, rows: Sequence[int]
    ) -> npt.NDArray[np.float64]:
        """The waypoints, or a `PathError`."""


def read_path_csv(
    file: str | os.PathLike[str],
    *,
    closed: bool = False,
    capacity: int | None = None,
    check: WaypointCheck = check_waypoints,
) -> npt.NDArray[np.float64]:
    """Read and check the waypoints of a CSV file.

    Args:
        file: the file.
        closed: the last waypoint leads on to the first.
        capacity: largest number of waypoints, if bounded.
        check: which waypoints are a path for the robot.

    Returns:
        Waypoints, n x 2, m.

    Raises:
        PathError: the file cannot be read, or its contents are not a path; the message names file, row and value.
    """
    source = os.fspath(file)
    try:
        text = Path(file).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise PathError(f"{source}: is not UTF-8 text (byte {error.start})") from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise PathError(f"{source}: cannot be read ({reason})") from error
    points: list[tuple[float, float]] = []
    rows: list[int] = []
    first = True
    for row, content in enumerate(text.splitlines(), start=1):
        if not content.strip() or content.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in content.split(",")]
        if first and [cell.lower() for cell in cells] in HEADERS:
            first = False
            continue
        first = False
        points.append(_waypoint(cells, f"{source}: row {row}"))
        rows.append(row)
    if not points:
        raise PathError(f"{source}: the path has no points, at least 2 are needed")
    return check(points, closed=closed, capacity=capacity, source=source, rows=rows)


def _waypoint(cells: list[str], place: str) -> tuple[float, float]:
    if len(cells) != 2:
        raise PathError(f"{place}: has {len(cells)} column{'' if len(cells) == 1 else 's'}, x,y are needed")
    return _number(cells[0], "x", place), _number(cells[1], "y", place)


def _number(cell: str, name: str, place: str) -> float:
    try:
        if "_" in cell:
            raise ValueError
        return float(cell)
    except ValueError:
        raise PathError(f"{place}: {name} is {cell[:40]!r}, which is not a number") from None
