# SPDX-License-Identifier: Apache-2.0
"""The bags of a recorder that goes on: one after the other, each marked with where it begins and why.

A control process that counts its ticks from 0 again has a bag of its own. When a bag cannot be written any further,
what it holds stays readable, and once a second another one is tried; meanwhile datagrams are counted and let go.
"""

from __future__ import annotations

import os
import shutil
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from runtime.executors.clocks import LOOK_EVERY_NS, ClockReading, ClockWatch, read_clocks
from runtime.executors.tick import ENTRY, Tick
from runtime.recording.bag import REALTIME, BagOptions, BagWriter, prepare
from runtime.recording.continuity import Continuity
from runtime.recording.errors import RecordingError
from runtime.recording.layout import body_size, dtype_of
from runtime.recording.recorder_status import RecorderStatus
from runtime.recording.setup import BEGINNING, RecordingSetup

FIRST_TICK_PREFIX, CLOCK_PREFIX = "first_tick/", "clock/"
"""Names of the metadata records on the first tick of each loop, and on what happened to the clocks."""
TRY_AGAIN_NS = 1_000_000_000
LEAST_ROOM_BYTES = 4 << 20
"""Free room on the disk below which no bag is begun: it would be full at once."""
_EARLIER_LIFE_NS = 500_000_000
"""A control process takes longer than this to start; a tick released so long before its first one is not its own."""


class Bags:
    """Writes datagrams into bags.

    Args:
        directory: that the bags are made in; made if missing.
        setup: what is to be recorded.
        status: kept up to date.
        say: told, in a sentence, of each failure and of each beginning.
        options: how the log reaches the disk.
        previous: name of the bag of the recorder before this one, if known.
        clocks: read for the names of bags, and for what happens to the clocks.
    """

    def __init__(
        self,
        directory: Path,
        setup: RecordingSetup,
        status: RecorderStatus,
        say: Callable[[str], None],
        options: BagOptions = REALTIME,
        previous: str = "",
        clocks: Callable[[], ClockReading] = read_clocks,
    ) -> None:
        self._directory, self._setup, self._options = directory, setup, options
        self._status, self._say, self._clocks = status, say, clocks
        self._of_control = {spec.loop for spec in setup.channels if spec.role == "output"}
        body = {spec.number: body_size(dtype_of(spec.definition)) for spec in setup.channels}
        self._sizes = {
            tick.number: {spec.number: body[spec.number] for spec in setup.channels if spec.loop == tick.loop}
            for tick in setup.channels
            if tick.role == "tick"
        }
        self._ticks = {spec.number: Tick(spec.topic, spec.sizes) for spec in setup.channels if spec.role == "tick"}
        self._loop_of = {spec.number: spec.loop for spec in setup.channels}
        prepare(setup)
        self._bag: BagWriter | None = None
        self._previous, self._reason = previous, "the recorder was started"
        self._try_again_ns = self._look_after_ns = 0
        self._continuity: dict[str, Continuity] = {}
        self._last: dict[str, tuple[int, int]] = {}
        self._life_begins_ns = 0
        self._clock_watch = ClockWatch(clocks())
        self._clock_notes = 0

    def write(self, datagram: bytes) -> None:
        """Record one tick, or count it."""
        number = self._tick_number(datagram)
        if number is None:
            self._status.rejected += 1
            return
        loop, tick = self._loop_of[number], self._ticks[number]
        if loop in self._of_control and not self._is_of_this_life(loop, tick):
            self._status.rejected += 1
            return
        try:
            self._record(loop, number, datagram)
        except RecordingError as error:
            self._fail(str(error))

    def _is_of_this_life(self, loop: str, tick: Tick) -> bool:
        """Whether a tick of control is neither late nor a repetition; one that counts anew ends the bag."""
        if tick.release_ns < self._life_begins_ns - _EARLIER_LIFE_NS:
            return False
        last_index, last_ns = self._last.get(loop, (-1, -1))
        if tick.index <= last_index:
            if tick.release_ns <= last_ns:
                return False
            self._end("control counts its ticks anew")
            self._last.clear()
        if not self._last:
            self._life_begins_ns = tick.release_ns
        self._last[loop] = tick.index, tick.release_ns
        return True

    def flush(self) -> None:
        """Hand what was recorded so far to the operating system."""
        if self._bag is not None:
            try:
                self._bag.flush()
            except RecordingError as error:
                self._fail(str(error))

    def tend(self) -> None:
        """Once a second: see whether the bag is still where it belongs, and what the clocks do."""
        now = self._clocks()
        if now.monotonic_ns < self._look_after_ns:
            return
        self._look_after_ns = now.monotonic_ns + LOOK_EVERY_NS
        happened = self._clock_watch.look(now)
        bag = self._bag
        if bag is None:
            return
        try:
            if happened:
                self._clock_notes += 1
                bag.note(f"{CLOCK_PREFIX}{self._clock_notes}", {"what": happened, **_times(now)})
            if not bag.is_in_place:
                with suppress(RecordingError):
                    bag.close()
                raise RecordingError(f"{bag.path} is gone; what it held is lost")
        except RecordingError as error:
            self._fail(str(error))

    def close(self) -> None:
        """Close the present bag."""
        self._end("")

    def _tick_number(self, datagram: bytes) -> int | None:
        """Number of the tick channel of a datagram, whose record is loaded; None if the datagram is none of ours."""
        unpack, size, position = ENTRY.unpack_from, len(datagram), 0
        first, sizes = -1, dict[int, int]()
        while position < size:
            try:
                number, length = unpack(datagram, position)
            except struct.error:
                return None
            if not position:
                first, sizes = number, self._sizes.get(number, {})
            if sizes.get(number) != length:
                return None
            position += ENTRY.size + length
        if position != size or first < 0:
            return None
        self._ticks[first].load(memoryview(datagram)[ENTRY.size : ENTRY.size + sizes[first]])
        return first

    def _record(self, loop: str, number: int, datagram: bytes) -> None:
        bag = self._bag or self._begun()
        if bag is None:
            self._status.failed += 1
            return
        tick, begins = self._ticks[number], loop not in self._continuity
        gap = self._continuity.setdefault(loop, Continuity(loop)).take(tick.index, tick.skipped, tick.release_ns)
        if gap is not None:
            self._status.gaps += 1
            self._status.dropped += 0 if begins else gap.missing
        self._status.recorded += 1
        bag.write(datagram)
        if begins:
            bag.note(FIRST_TICK_PREFIX + loop, {"index": str(tick.index), "release_ns": str(tick.release_ns)})

    def _begun(self) -> BagWriter | None:
        """A new bag, or None if none can be had now."""
        now = self._clocks()
        if now.monotonic_ns < self._try_again_ns:
            return None
        directory = None
        try:
            directory = _new_directory(self._directory, self._setup.robot, now.utc_ns)
            if not _has_room(directory):
                raise RecordingError(f"cannot write a log in {directory}: no space left on device")
            bag = BagWriter(directory, self._setup, self._options)
            bag.note(BEGINNING, {"previous": self._previous, "reason": self._reason, **_times(now)})
        except RecordingError as error:
            if directory is not None:
                shutil.rmtree(directory, ignore_errors=True)
            self._fail(str(error))
            return None
        self._bag, self._previous = bag, directory.name
        self._continuity.clear()
        status = self._status
        status.bags, status.bag = status.bags + 1, directory.name
        status.recording, status.since_ns = str(bag.path), now.utc_ns
        self._say(f"recording in {bag.path}")
        return bag

    def _end(self, reason: str) -> None:
        """Close the present bag; the next one is begun for a reason."""
        bag, self._bag = self._bag, None
        if bag is not None:
            self._reason = reason
            try:
                bag.close()
            except RecordingError as error:
                self._fail(str(error))

    def _fail(self, sentence: str) -> None:
        """Let the present bag go, and try again later."""
        status, bag = self._status, self._bag
        now = self._clocks()
        self._try_again_ns = now.monotonic_ns + TRY_AGAIN_NS
        if bag is not None:
            self._bag = None
            status.failed += bag.pending
            status.recorded -= bag.pending
            if bag.is_empty:
                shutil.rmtree(bag.directory, ignore_errors=True)
        if status.recording or not status.error:
            status.since_ns = now.utc_ns
            self._say(f"{sentence}; trying again every second")
        self._reason, status.error, status.recording = sentence, sentence, ""


def _times(now: ClockReading) -> dict[str, str]:
    return {"utc_ns": str(now.utc_ns), "monotonic_ns": str(now.monotonic_ns)}


def _new_directory(parent: Path, robot: str, utc_ns: int) -> Path:
    """A directory of its own for each bag, by the time at which it begins."""
    name = f"{robot}-{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime(utc_ns // 1_000_000_000))}"
    try:
        parent.mkdir(parents=True, exist_ok=True)
        for number in range(1, 1000):
            directory = parent / (name if number == 1 else f"{name}-{number}")
            with suppress(FileExistsError):
                directory.mkdir()
                return directory
    except OSError as error:
        raise RecordingError(f"cannot write a log in {parent}: {(error.strerror or str(error)).lower()}") from error
    raise RecordingError(f"cannot write a log in {parent}: it holds every name from {name} on")


def _has_room(directory: Path) -> bool:
    try:
        disk = os.statvfs(directory)
    except OSError as error:
        raise RecordingError(f"cannot write a log in {directory}: {(error.strerror or str(error)).lower()}") from error
    return disk.f_bavail * disk.f_frsize >= LEAST_ROOM_BYTES
