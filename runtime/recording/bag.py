# SPDX-License-Identifier: Apache-2.0
"""A run as a rosbag2 directory: `<run>/<run>_0.mcap` and `metadata.yaml`, written datagram by datagram."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from runtime.executors.tick import ENTRY
from runtime.messages import definitions
from runtime.recording.bag_metadata import TopicCount, bag_metadata
from runtime.recording.errors import RecordingError
from runtime.recording.layout import ChannelSpec, camel_case, package_name
from runtime.recording.mcap_file import McapFile, open_output, reserve_space
from runtime.recording.setup import RecordingSetup
from runtime.recording.standard_topics import StandardTopic, standard_topics
from runtime.recording.syncer import Syncer

CHECKSUM_TOPIC_PREFIX = "/ugv/checksum/"
RESERVE_BYTES = 1 << 20
"""Room held back for the summary and metadata.yaml, should the disk be full."""


@dataclass(frozen=True)
class BagOptions:
    """How the log reaches the disk.

    Attributes:
        chunk_bytes: a chunk is closed at the end of the tick in which it grows to this size,
        chunk_span_ns: or in which it spans this time.
        sync_ns: time between two fdatasync; 0 for none.
        compression: "zstd" or "".
    """

    chunk_bytes: int
    chunk_span_ns: int
    sync_ns: int
    compression: str


REALTIME = BagOptions(chunk_bytes=64 << 10, chunk_span_ns=5_000_000, sync_ns=1_000_000_000, compression="")
"""A kill or a power cut must lose next to nothing."""
LOCKSTEP = BagOptions(chunk_bytes=256 << 10, chunk_span_ns=100_000_000, sync_ns=0, compression="zstd")
"""A simulation that is killed still has its recorder, which closes the log; only if the recorder itself is killed, at
most 0.1 s of virtual time is lost. Larger chunks compress no better."""


class BagWriter:
    """Writes the datagrams of one run.

    Args:
        directory: the run directory; made if missing.
        setup: what is to be recorded.
        options: how.

    Attributes:
        path: of the .mcap file.
        pending: datagrams that were not handed to the operating system yet.

    Raises:
        RecordingError: if the directory cannot be written, or already holds a log.
    """

    def __init__(self, directory: Path, setup: RecordingSetup, options: BagOptions) -> None:
        self.directory = directory
        self.path = directory / f"{directory.resolve().name}_0.mcap"
        self.pending = 0
        self._options = options
        self._topics: list[TopicCount] = []
        with ExitStack() as undo:
            try:
                directory.mkdir(parents=True, exist_ok=True)
                self._reserve = reserve_space(directory, RESERVE_BYTES)
                if self._reserve is not None:
                    undo.callback(os.close, self._reserve)
                self._output, self._descriptor = open_output(self.path)
                undo.callback(self._release)
                self._file = McapFile(self._output, options.compression, directory=directory)
                self._declare(setup)
            except FileExistsError:
                if not directory.is_dir():
                    raise RecordingError(f"{directory} is not a directory, so nothing can be recorded in it") from None
                raise RecordingError(f"{directory} already holds a log ({self.path.name})") from None
            except OSError as error:
                raise RecordingError(f"cannot write a log in {directory}: {_reason(error)}") from error
            undo.pop_all()
        self._syncer = Syncer(self._descriptor) if options.sync_ns else None
        self._synced_ns = 0
        self._closed = False

    def _declare(self, setup: RecordingSetup) -> None:
        """Write everything that stands before the first message."""
        self._file.add_metadata("ugv", {"robot": setup.robot})
        for attachment in setup.attachments:
            self._file.add_attachment(attachment.name, attachment.media_type, attachment.data)
        schemas: dict[str, int] = {}
        self._channel_of: dict[int, int] = {}
        self._loop_of: dict[int, str] = {}
        for spec in setup.channels:
            self._channel_of[spec.number] = self._declare_topic(schemas, spec.topic, spec.type_name, spec.definition)
            self._loop_of[spec.number] = spec.loop
        self._standard: dict[int, list[tuple[int, StandardTopic]]] = {}
        for topic in standard_topics(setup.channels, setup.joint_names):
            text = definitions.definition(topic.type_name)
            channel = self._declare_topic(schemas, topic.topic, topic.type_name, text, standard=True)
            self._standard.setdefault(topic.source, []).append((channel, topic))
        self._checksums: dict[int, tuple[int, int, bytearray]] = {}
        if setup.checksums:
            self._declare_checksums(schemas, setup)

    def _declare_checksums(self, schemas: dict[str, int], setup: RecordingSetup) -> None:
        for tick, first, count in _checksummed(setup):
            type_name, text = _checksum_type(setup.robot, tick.loop, count)
            channel = self._declare_topic(schemas, CHECKSUM_TOPIC_PREFIX + tick.loop, type_name, text)
            self._checksums[tick.number] = (channel, first, bytearray(4 * count))

    def _declare_topic(
        self, schemas: dict[str, int], topic: str, type_name: str, text: str, standard: bool = False
    ) -> int:
        if type_name not in schemas:
            schemas[type_name] = self._file.add_schema(type_name, text)
        type_hash = _type_hash(type_name, None if standard else text)
        self._topics.append(TopicCount(topic, type_name, type_hash))
        return self._file.add_channel(topic, schemas[type_name], {"offered_qos_profiles": "[]"})

    def write(self, datagram: bytes) -> None:
        """Record one tick.

        Raises:
            RecordingError: if the disk takes no more; what was recorded so far is closed and readable.
        """
        self.pending += 1
        file, position, size = self._file, ENTRY.size, len(datagram)
        unpack = ENTRY.unpack_from
        view = memoryview(datagram)
        tick_number, length = unpack(datagram, 0)
        index = int.from_bytes(view[position : position + 8], "little")
        release_ns = int.from_bytes(view[position + 8 : position + 16], "little")
        checksum_channel, first, checksums = self._checksums.get(tick_number, (0, 0, None))
        number = tick_number
        while True:
            body = view[position : position + length]
            file.add_body(self._channel_of[number], index, release_ns, body)
            if checksums is not None:
                slot = 4 * (number - first)
                checksums[slot : slot + 4] = zlib.crc32(body).to_bytes(4, "little")
            if number in self._standard:
                for channel, topic in self._standard[number]:
                    message = topic.message(body, release_ns)
                    if message is not None:
                        file.add_message(channel, index, release_ns, message)
            position += length
            if position >= size:
                break
            number, length = unpack(datagram, position)
            position += ENTRY.size
        if checksums is not None:
            file.add_body(checksum_channel, index, release_ns, bytes(checksums))
            checksums[:] = bytes(len(checksums))
        options = self._options
        if file.open_bytes >= options.chunk_bytes or file.open_span_ns >= options.chunk_span_ns:
            self.flush()

    def flush(self) -> None:
        """Hand what was recorded so far to the operating system.

        Raises:
            RecordingError: if the disk takes no more; what was recorded so far is closed and readable.
        """
        try:
            self._file.close_chunk()
            self.pending = 0
            if self._syncer is not None and self._file.end_ns - self._synced_ns >= self._options.sync_ns:
                self._syncer.ask()
                self._synced_ns = self._file.end_ns
        except OSError as error:
            raise self._given_up(error) from error

    def note(self, name: str, entries: dict[str, str]) -> None:
        """Write a metadata record.

        Raises:
            RecordingError: if the disk takes no more; what was recorded so far is closed and readable.
        """
        try:
            self._file.add_metadata(name, entries)
        except OSError as error:
            raise self._given_up(error) from error

    @property
    def is_in_place(self) -> bool:
        """Whether the file is still found under its name."""
        try:
            return os.path.samestat(os.stat(self.path), os.fstat(self._descriptor))
        except OSError:
            return False

    @property
    def is_empty(self) -> bool:
        """Whether no message has reached the file yet."""
        return not any(self._file.message_counts)

    def _given_up(self, error: OSError) -> RecordingError:
        """Close what was recorded so far, and say why it goes no further."""
        sentence = f"cannot record any more in {self.path}: {_reason(error)}"
        until = f"; the log is whole up to {self._file.end_ns / 1e9:.2f} s"
        with suppress(RecordingError):
            self.close()
        return RecordingError(sentence + until)

    def _release(self) -> None:
        close = getattr(self._output, "close", None)
        if close is not None:
            close()

    def close(self) -> None:
        """Write the summary and metadata.yaml. Calling it again does nothing.

        Raises:
            RecordingError: if the disk takes no more, or did not take what was to be synced; the chunks written before
                stay readable.
        """
        if self._closed:
            return
        self._closed = True
        failure = None if self._syncer is None else self._syncer.close()
        if self._reserve is not None:
            os.close(self._reserve)
        try:
            try:
                self._file.finish()
                self.pending = 0
                if self._options.sync_ns:
                    os.fdatasync(self._descriptor)
            finally:
                self._release()
            counts = self._file.message_counts
            for channel, topic in enumerate(self._topics, start=1):
                topic.count = counts[channel]
            text = bag_metadata(self.path.name, self._file.start_ns, self._file.end_ns, self._topics)
            (self.directory / "metadata.yaml").write_text(text)
            if failure is not None:
                raise failure
        except OSError as error:
            raise RecordingError(f"cannot close the log {self.path}: {_reason(error)}") from error


class BagSink:
    """Records in this process: takes datagrams as a `RecorderProcess` does.

    Attributes:
        dropped: none ever.
    """

    dropped = 0

    def __init__(self, directory: Path, setup: RecordingSetup, options: BagOptions = LOCKSTEP) -> None:
        self._writer = BagWriter(directory, setup, options)
        self.path = self._writer.path

    def write(self, datagram: bytes) -> None:
        """Record one tick."""
        self._writer.write(datagram)

    def close(self) -> None:
        """Close the log."""
        self._writer.close()


def _checksummed(setup: RecordingSetup) -> Iterator[tuple[ChannelSpec, int, int]]:
    """The tick channel of each loop, the number of its first channel, and how many it has."""
    for tick in (spec for spec in setup.channels if spec.role == "tick"):
        numbers = [spec.number for spec in setup.channels if spec.loop == tick.loop]
        yield tick, min(numbers), max(numbers) - min(numbers) + 1


def _checksum_type(robot: str, loop: str, count: int) -> tuple[str, str]:
    """Name and text of the message that holds the checksums of a loop's channels."""
    text = f"uint32[{count}] entry  # CRC-32 of the body of each of the loop's channels, 0 where not logged\n"
    return f"ugv_{package_name(robot)}_msgs/msg/Checksum{camel_case(loop)}", text


def prepare(setup: RecordingSetup) -> None:
    """Compute what every bag of a setup needs; the first one is then begun as fast as the later ones."""
    for spec in setup.channels:
        _type_hash(spec.type_name, spec.definition)
    for tick, _, count in _checksummed(setup):
        _type_hash(*_checksum_type(setup.robot, tick.loop, count))
    for topic in standard_topics(setup.channels, setup.joint_names):
        _type_hash(topic.type_name, None)


_type_hash = cache(definitions.type_hash)
"""It takes milliseconds, and datagrams wait while a bag is begun."""


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
