# SPDX-License-Identifier: Apache-2.0
"""What the processes of `ugv run` say can be read line by line, whichever thread says it."""

import io
import sys

from runtime.cli.main import main
from runtime.executors import control


class Writes(io.StringIO):
    """Keeps every write apart: between two of them another thread may write."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[str] = []

    def write(self, text: str) -> int:
        self.seen.append(text)
        return len(text)


def test_what_a_loop_says_is_one_write_so_that_another_loops_does_not_get_into_it(tmp_path, monkeypatch):
    told = Writes()
    monkeypatch.setattr(control, "control", lambda *arguments: arguments[-1]("no SCHED_FIFO"))
    monkeypatch.setattr("runtime.robots.rehearse", lambda config: None)
    monkeypatch.setattr(sys, "stderr", told)
    assert main(["run", "uslgo1", "--process", "control", "--runtime-dir", str(tmp_path)]) == 0
    assert told.seen == ["ugv control: no SCHED_FIFO\n"]
