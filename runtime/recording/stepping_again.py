# SPDX-License-Identifier: Apache-2.0
"""What the tasks of recorded ticks need when they are stepped again on what they saw."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.tasks import Loop

_LEAD_S = 2.0
"""The stepping begins at a key-frame, of which there is one a second; and its first steps load kernels."""


def needed_ns(log: Log, loops: Sequence[Loop], name: str, from_ns: int, to_ns: int) -> dict[int, int]:
    """Processor time, ns, that the tasks of a loop's ticks take when stepped again, by the ticks' index.

    Those that cannot be stepped again, as those before the first key-frame after a gap, are missing.

    Args:
        log: to step again.
        loops: freshly assembled from the log's configuration.
        name: of the loop; nothing is known of one that is not among these.
        from_ns: from which on the ticks began, by the log's clock.
        to_ns: until then.
    """
    tasks = [item.task.name for loop in loops if loop.name == name for item in loop.schedule]
    needed: dict[int, int] = {}
    if tasks:
        begin_s, end_s = ((at_ns - log.origin_ns) * 1e-9 for at_ns in (from_ns, to_ns))
        Replay(log, loops, log.robot).run(begin_s - _LEAD_S, end_s, tasks=tasks, stepped=_Note(name, needed))
    return needed


class _Note:
    """Notes the ticks of one loop."""

    def __init__(self, loop: str, needed: dict[int, int]) -> None:
        self._loop, self._needed = loop, needed

    def __call__(self, loop: str, index: int, spent_ns: int) -> None:
        if loop == self._loop:
            self._needed[index] = spent_ns
