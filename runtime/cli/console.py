# SPDX-License-Identifier: Apache-2.0
"""What the verbs print: progress on stderr, results on stdout."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

ReportProgress = Callable[[float, float], None]
"""Called with how much is done, and of how much."""


@contextlib.contextmanager
def progress_bar(label: str) -> Iterator[ReportProgress]:
    """A progress bar, shown from its first movement on; gives the function that moves it."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    bar = Progress(*columns, console=Console(stderr=True), refresh_per_second=4)
    task = bar.add_task(label, total=None)

    def report(done: float, total: float) -> None:
        bar.start()
        bar.update(task, completed=min(done, total), total=total)

    try:
        yield report
    finally:
        bar.stop()


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print a table to stdout, the first column to the left, the others to the right."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table()
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*(Text(text_of(cell)) for cell in row))
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)
    if title:
        console.print(Text(title, style="bold"), soft_wrap=True)
    console.print(table)


def text_of(cell: Any) -> str:
    """A cell's text: figures with four digits, truth as yes or no, and a dash for what there is none of."""
    if cell is None:
        return "-"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, float):
        return f"{cell:.4g}"
    return str(cell)
