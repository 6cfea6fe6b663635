# SPDX-License-Identifier: Apache-2.0
"""The bags that the recorder made of one run: one as a rule, several if it or its disk failed."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from runtime.executors.processes import ProcessError
from runtime.recording.errors import LogError
from runtime.recording.log import Log, Signal


class RunBags:
    """The bags of a run, in the order in which they begin.

    The longest is moved from a directory of its own into that of the run, named after it: it is the one that a report
    or a replay of the run's directory reads. The others stay where they are.

    Args:
        out: directory of the run.
        say: told, in a sentence each, that there are several, and which cannot be read.

    Attributes:
        longest: the log in the directory of the run.
        others: directories of the others, in the order in which they begin.

    Raises:
        ProcessError: if there is none that can be read.
    """

    def __init__(self, out: Path, say: Callable[[str], None]) -> None:
        found: list[Log] = []
        for directory in sorted(path for path in out.iterdir() if path.is_dir()):
            try:
                found.append(Log(directory))
            except LogError as error:
                say(f"a bag of the run cannot be read: {error}")
        if not found:
            raise ProcessError(f"the recorder made no bag of the run in {out} that can be read")
        found.sort(key=lambda log: log.start_ns)
        longest = max(found, key=lambda log: log.end_ns - log.start_ns)
        self.others = [log.path.parent for log in found if log is not longest]
        self.longest = _moved(longest.path.parent, out)
        self._logs = [self.longest if log is longest else log for log in found]
        if self.others:
            say(f"the log is in {len(found)} bags; the report is of the longest, {self.longest.path.name}")

    def __iter__(self) -> Iterator[Log]:
        return iter(self._logs)

    def read(self, topic: str) -> Signal:
        """A signal from all bags."""
        parts = [log.read_signal(topic) for log in self._logs]
        return Signal(np.concatenate([part.log_ns for part in parts]), np.concatenate([part.values for part in parts]))


def _moved(bag: Path, out: Path) -> Log:
    """A bag moved into the directory of its run and named after that."""
    before, after = bag.name, out.resolve().name
    for file in bag.iterdir():
        shutil.move(file, out / file.name.replace(before, after))
    bag.rmdir()
    metadata = out / "metadata.yaml"
    if metadata.exists():
        metadata.write_text(metadata.read_text().replace(before, after))
    return Log(out)
