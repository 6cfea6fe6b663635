# SPDX-License-Identifier: Apache-2.0
"""Copies of what the loops of another process write, kept up to date from its ticks."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from runtime.executors.tick import entries, manifest_of
from runtime.executors.tick_stream import TickListener
from runtime.records import Record
from runtime.tasks import Loop


class TickMirror:
    """Follows the ticks.

    Args:
        loops: assembled as those of the other process.
        topics: of the wanted records.
        listener: that the ticks come to.

    Attributes:
        records: the copies, by topic.
        taken: ticks so far.
    """

    def __init__(self, loops: Sequence[Loop], topics: Collection[str], listener: TickListener) -> None:
        self._listener, self.taken = listener, 0
        wanted = [channel for channel in manifest_of(tuple(loops)).channels if channel.record.topic in topics]
        self._of_number: dict[int, Record] = {channel.number: channel.record for channel in wanted}
        self.records = {channel.record.topic: channel.record for channel in wanted}

    def update(self) -> None:
        """Take up every tick that has come."""
        while (datagram := self._listener.receive(0.0)) is not None:
            self.taken += 1
            for number, body in entries(datagram):
                record = self._of_number.get(number)
                if record is not None:
                    record.load(body)
