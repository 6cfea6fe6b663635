# SPDX-License-Identifier: Apache-2.0
"""What the simulator of a run says, followed by a thread, so that others can wait for a part of it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from runtime.executors.processes import ProcessError


class LiveAnswers:
    """Follows the answers of a simulator.

    Args:
        answers: as `LiveProcesses.answers` gives them.

    Attributes:
        state: of the robot, as it was told last.
        struck: the moments of faults: name and time, monotonic ns.
        seen: what the witness saw of each.
        ended: why no more answers come, empty while they do.
    """

    def __init__(self, answers: Iterator[dict[str, Any]]) -> None:
        self.state, self.ended = "", ""
        self.struck: list[tuple[str, int]] = []
        self.seen: list[dict[str, Any]] = []
        self._answers, self._news = answers, threading.Condition()
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        ended = "the simulator's run is over"
        try:
            for answer in self._answers:
                self._take(answer)
        except ProcessError as error:
            ended = str(error)
        with self._news:
            self.ended = ended
            self._news.notify_all()

    def _take(self, answer: dict[str, Any]) -> None:
        with self._news:
            self.state = answer.get("state", self.state)
            if "struck" in answer:
                self.struck.append((answer["struck"], answer["at_ns"]))
            if "seen" in answer:
                self.seen.append(answer["seen"])
            self._news.notify_all()

    def wait(self, happened: Callable[[], bool], within_s: float) -> bool:
        """Wait until something is so, by what was said; false if it takes too long or no more is said."""
        with self._news:
            self._news.wait_for(lambda: happened() or bool(self.ended), within_s)
            return happened()

    def wait_for_more(self, told: Sequence[Any], before: int, within_s: float) -> bool:
        """Wait until more was told than so many."""
        return self.wait(lambda: len(told) > before, within_s)

    def rest(self, duration_s: float) -> None:
        """Let time pass, unless the run ends."""
        with self._news:
            self._news.wait_for(lambda: bool(self.ended), duration_s)
