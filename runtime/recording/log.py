# SPDX-License-Identifier: Apache-2.0
"""A log, open for reading: a run directory, or the .mcap file in it."""

from __future__ import annotations

import json
import mmap
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.executors.tick import Manifest
from runtime.recording import layout, mcap_scan, setup
from runtime.recording.errors import LogError
from runtime.recording.setup import BEGINNING
from runtime.records import CDR_LITTLE_ENDIAN

_HEADER = len(CDR_LITTLE_ENDIAN)


class Signal(NamedTuple):
    """Every logged value of one topic: log times, and values in the record's layout."""

    log_ns: npt.NDArray[np.int64]
    values: npt.NDArray[Any]


class Message(NamedTuple):
    """One message of the log; the body is a CDR body."""

    topic: str
    sequence: int
    log_ns: int
    body: memoryview


@dataclass(frozen=True)
class LogChannel:
    """A topic of the log: its number in the file, its ROS type and the text that defines it."""

    number: int
    topic: str
    type_name: str
    definition: str


class Log:
    """A log, read as far as it is whole.

    Attributes:
        path: of the .mcap file.
        channels: by topic.
        truncated: the log was not closed; everything up to the last whole chunk is there.
        robot: whose log it is, "" if it does not say.

    Raises:
        LogError: if there is no readable log, saying why in one sentence.
    """

    def __init__(self, path: Path) -> None:
        self.path = _log_file(path)
        self._scan = mcap_scan.scan(_content(self.path))
        if not self._scan.channels and self._scan.chunks:
            for message in mcap_scan.messages(self._scan, mcap_scan.content(self._scan, self._scan.chunks[0])):
                del message
        self.truncated = not self._scan.closed
        if self.truncated and not self._scan.chunks:
            raise LogError(f"{self.path} was cut off before its first message")
        if not self._scan.channels:
            raise LogError(f"{self.path} holds no topic")
        self.channels = {channel.topic: self._channel(channel.id) for channel in self._scan.channels.values()}
        self._topic_of = {channel.number: topic for topic, channel in self.channels.items()}
        self.robot = self._scan.metadata.get("ugv", {}).get("robot", "")

    def _channel(self, number: int) -> LogChannel:
        channel = self._scan.channels[number]
        schema = self._scan.schemas.get(channel.schema_id)
        if schema is None:
            raise LogError(f"{self.path}: {channel.topic} has no message definition")
        return LogChannel(number, channel.topic, schema.name, schema.data.decode(errors="replace"))

    @property
    def damage(self) -> list[str]:
        """A phrase for each damaged place that was met so far."""
        return self._scan.damage

    def note_damage(self, phrase: str) -> None:
        """Add to `damage` what a reader of the messages found."""
        if phrase not in self._scan.damage:
            self._scan.damage.append(phrase)

    @property
    def attachments(self) -> dict[str, bytes]:
        """The files within the log."""
        return self._scan.attachments

    @property
    def media_types(self) -> dict[str, str]:
        """The media types of the attachments."""
        return self._scan.media_types

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records, by name."""
        return self._scan.metadata

    @property
    def start_ns(self) -> int:
        """Log time of the earliest message."""
        return min((chunk.start_ns for chunk in self._scan.chunks), default=0)

    @property
    def origin_ns(self) -> int:
        """Log time from which seconds are counted: 0 of virtual time; on the clock of a machine, the beginning."""
        return self.start_ns if BEGINNING in self.metadata else 0

    @property
    def end_ns(self) -> int:
        """Log time of the latest message."""
        return max((chunk.end_ns for chunk in self._scan.chunks), default=0)

    def text(self, name: str) -> str:
        """An attachment as text.

        Raises:
            LogError: if the log does not have it.
        """
        try:
            return self.attachments[name].decode()
        except KeyError:
            raise LogError(f"{self.path} carries no {name}") from None
        except UnicodeDecodeError:
            raise LogError(f"{self.path}: {name} is not text") from None

    @property
    def config(self) -> str:
        """The resolved configuration of the run."""
        return self.text(setup.CONFIG)

    @property
    def seed(self) -> int:
        """The seed of the run."""
        text = self.text(setup.SEED)
        try:
            return int(text)
        except ValueError:
            raise LogError(f"{self.path}: {setup.SEED} holds {text.strip()!r}, not a number") from None

    def json(self, name: str) -> Any:
        """An attachment that is JSON."""
        try:
            return json.loads(self.text(name))
        except json.JSONDecodeError as error:
            raise LogError(f"{self.path}: {name} is not JSON ({error})") from None

    def messages(self, topics: Collection[str] | None = None, from_ns: int = 0) -> Iterator[Message]:
        """Every message in the order of the file, or those of some topics.

        Args:
            topics: their names; None for all.
            from_ns: chunks that end before this log time are passed over.
        """
        wanted = {n: topic for n, topic in self._topic_of.items() if topics is None or topic in topics}
        for place in self._scan.chunks:
            if place.end_ns < from_ns:
                continue
            for number, sequence, log_ns, payload in mcap_scan.messages(
                self._scan, mcap_scan.content(self._scan, place)
            ):
                topic = wanted.get(number)
                if topic is not None:
                    yield Message(topic, sequence, log_ns, payload[_HEADER:])

    def counts(self) -> dict[str, int]:
        """Number of messages by topic; reads the whole log."""
        counts = dict.fromkeys(self.channels, 0)
        for message in self.messages():
            counts[message.topic] += 1
        return counts

    def read_signal(self, topic: str) -> Signal:
        """Every value of one of the robot's own signals.

        Raises:
            LogError: if the log has no such topic, or its messages do not have the size that its definition says.
        """
        return self.read_signals([topic])[topic]

    def read_signals(self, topics: Sequence[str]) -> dict[str, Signal]:
        """Every value of several of the robot's own signals, in one pass through the log."""
        for topic in topics:
            if topic not in self.channels:
                raise LogError(f"{self.path} has no topic {topic}")
        dtypes = {topic: layout.dtype_of(self.channels[topic].definition) for topic in topics}
        sizes = {topic: layout.body_size(dtype) for topic, dtype in dtypes.items()}
        padding = {topic: bytes(dtype.itemsize - sizes[topic]) for topic, dtype in dtypes.items()}
        times: dict[str, list[int]] = {topic: [] for topic in topics}
        bodies: dict[str, list[bytes | memoryview]] = {topic: [] for topic in topics}
        for topic, _, log_ns, body in self.messages(frozenset(topics)):
            if len(body) != sizes[topic]:
                raise LogError(
                    f"{self.path}: {topic} at {log_ns / 1e9:.3f} s has {len(body)} bytes, its definition {sizes[topic]}"
                )
            times[topic].append(log_ns)
            bodies[topic] += (body, padding[topic])
        return {
            topic: Signal(np.array(times[topic], dtype=np.int64), np.frombuffer(b"".join(bodies[topic]), dtypes[topic]))
            for topic in topics
        }

    def check(self, robot: str, manifest: Manifest) -> None:
        """Refuse a log of another robot, or one whose records this code lays out differently.

        Raises:
            LogError: naming the robot, or the first topic and field that differ.
        """
        if self.robot and self.robot != robot:
            raise LogError(f"{self.path} is a log of {self.robot}, not of {robot}")
        for channel in manifest.channels:
            topic = channel.record.topic
            logged = self.channels.get(topic)
            if logged is None:
                raise LogError(f"{self.path} has no topic {topic}, which the loop {channel.loop} of this code logs")
            difference = layout.first_difference(logged.definition, channel.record.ros_definition())
            if difference is not None:
                raise LogError(f"{self.path}: {topic}: {difference}")


def _log_file(path: Path) -> Path:
    if not path.exists():
        raise LogError(f"{path} does not exist")
    if not path.is_dir():
        return path
    files = sorted(path.glob("*.mcap"))
    if not files:
        raise LogError(f"{path} holds no .mcap file")
    if len(files) > 1:
        raise LogError(f"{path} holds {len(files)} .mcap files; name one of them")
    return files[0]


def _content(path: Path) -> memoryview:
    """The file, mapped."""
    try:
        with open(path, "rb") as stream:
            if path.stat().st_size == 0:
                raise LogError(f"{path} is empty")
            data = memoryview(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))
    except OSError as error:
        raise LogError(f"{path} cannot be read: {(error.strerror or str(error)).lower()}") from None
    if not mcap_scan.is_mcap(data):
        raise LogError(f"{path} is not an MCAP file")
    return data
