# SPDX-License-Identifier: Apache-2.0
"""Something that is kept of each sender."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from typing import Generic, TypeVar

Kept = TypeVar("Kept")
MOST_SOURCES = 32


class PerSource(Generic[Kept]):
    """Keeps something of each source; of too many the one that was not asked for the longest is forgotten.

    It may be asked in several threads at once.

    Args:
        make: what is kept of a source that is new, or was forgotten.
    """

    def __init__(self, make: Callable[[], Kept]) -> None:
        self._make = make
        self._kept: OrderedDict[int, Kept] = OrderedDict()
        self._lock = threading.Lock()

    def of(self, source: int) -> Kept:
        """What is kept of a source."""
        with self._lock:
            if source not in self._kept:
                self._kept[source] = self._make()
                if len(self._kept) > MOST_SOURCES:
                    self._kept.popitem(last=False)
            self._kept.move_to_end(source)
            return self._kept[source]
