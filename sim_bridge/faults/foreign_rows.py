# SPDX-License-Identifier: Apache-2.0
"""What others than the operator say, and what nobody can mean: every robot counts it, and goes on."""

from __future__ import annotations

from typing import Any, TypeVar

from sim_bridge.faults.operator import FOREIGN, NONSENSE, OTHER, bad_path, interrupted, path_withdrawn_by
from sim_bridge.faults.row import Row
from sim_bridge.faults.table_parts import MALFORMED, MS, PATH_FOREIGN, PATH_REJECTED, REFUSED, at_once

RowT = TypeVar("RowT", bound=Row[Any, Any])


def foreign_rows(kind: type[RowT], goes_on: tuple[str, ...]) -> tuple[RowT, ...]:
    """The rows of a robot's table.

    Args:
        kind: of its rows.
        goes_on: its answer.
    """
    faults = (
        ("events of others", interrupted(*FOREIGN), REFUSED),
        ("malformed events", interrupted(*NONSENSE), MALFORMED),
        ("malformed path", bad_path, PATH_REJECTED),
        ("path withdrawn by another", path_withdrawn_by(OTHER), PATH_FOREIGN),
    )
    return tuple(kind(name, inject, goes_on, at_once, 100 * MS, counted=counted) for name, inject, counted in faults)
