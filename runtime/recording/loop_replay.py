# SPDX-License-Identifier: Apache-2.0
"""One loop in a replay: its records, what is known of them, and whether it is being stepped."""

from __future__ import annotations

from runtime.executors.tick import Manifest
from runtime.recording.logged_ticks import LoggedTick
from runtime.recording.replay_result import Stretch
from runtime.tasks import Loop


class LoopReplay:
    """One loop.

    It can be stepped from its first tick on, and after a gap from the first key-frame at which every signal that its
    tasks wrote has been logged since: a task may remember by what it wrote.

    Args:
        loop: freshly assembled.
        manifest: of all loops.
        key_frame_ns: interval of the live run.

    Attributes:
        topics: of its channels, in their order.
        roles: by topic.
        held: what was last logged of each record.
        stretch: the one that is being stepped, if any.
    """

    def __init__(self, loop: Loop, manifest: Manifest, key_frame_ns: int) -> None:
        self.loop = loop
        self.topics = [channel.record.topic for channel in manifest.channels if channel.loop == loop.name]
        self.roles = {channel.record.topic: channel.role for channel in manifest.channels}
        self.held: dict[str, memoryview] = {}
        self.stretch: Stretch | None = None
        self._records = {record.topic: record for record in (*loop.port_inputs, *loop.writes)}
        self._states = {item.task.state.topic: item.task for item in loop.schedule if item.task.state is not None}
        self._key_frame_every = max(1, key_frame_ns // loop.period_ns)
        self._unknown: set[str] = set()

    def pass_gap(self) -> None:
        """Stop stepping, for ticks are missing."""
        self.stretch = None
        self._unknown = {record.topic for record in self.loop.writes}

    def hold(self, tick: LoggedTick) -> None:
        """Keep what a tick logged."""
        self.held.update(tick.bodies)
        self._unknown.difference_update(tick.bodies)

    def is_key_frame(self, tick: LoggedTick) -> bool:
        """Whether the live run took up every state again before this step."""
        before = max(0, tick.index - 1 - tick.skipped)
        return tick.index // self._key_frame_every > before // self._key_frame_every

    def can_start(self, tick: LoggedTick) -> bool:
        """Whether everything is known that the live run had before this step."""
        if tick.index == 0:
            return not self.held
        return self.is_key_frame(tick) and not self._unknown and self._states.keys() <= tick.bodies.keys()

    def start(self, tick: LoggedTick) -> Stretch:
        """Bring the loop into the condition in which the live run began this step."""
        for topic, record in self._records.items():
            if topic in self.held:
                record.load(self.held[topic])
        for topic, task in self._states.items():
            if topic in tick.bodies:
                task.restore(tick.bodies[topic])
        self.stretch = Stretch(self.loop.name, tick.index, tick.index, tick.at_ns, tick.at_ns)
        return self.stretch

    def load_inputs(self, tick: LoggedTick) -> None:
        """Fill the ports' records with what was read."""
        for record in self.loop.port_inputs:
            if record.topic in tick.bodies:
                record.load(tick.bodies[record.topic])
