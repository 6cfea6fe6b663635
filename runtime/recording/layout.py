# SPDX-License-Identifier: Apache-2.0
"""Channels as plain data: what the recorder process is told, what the log carries, what a reader compares.

The ROS message text of a channel is its layout: a numpy record type follows from it, so a log is read without the code
that wrote it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from runtime.executors.tick import Manifest
from runtime.recording.errors import LogError

_LINE = re.compile(r"^(float64|int64|uint32|uint8|bool)(?:\[(\d+)\])? (\w+)\s*(?:#.*)?$")
_FORMATS = {"float64": "<f8", "int64": "<i8", "uint32": "<u4", "uint8": "u1", "bool": "?"}

FieldLayout = tuple[str, str]
"""Name and type of a field, as `("position", "float64[12]")`."""


@dataclass(frozen=True)
class ChannelSpec:
    """One channel of the log.

    Attributes:
        number: its number in datagrams.
        topic: its name.
        loop: the loop whose ticks carry it.
        role: "tick", "input", "output" or "state".
        on_change: logged only when it changed.
        record: name of the record class.
        sizes: what the record's symbolic lengths stand for.
        type_name: ROS name of the message type.
        definition: ROS message text.
    """

    number: int
    topic: str
    loop: str
    role: str
    on_change: bool
    record: str
    sizes: dict[str, int]
    type_name: str
    definition: str


def channel_specs(manifest: Manifest, robot: str) -> tuple[ChannelSpec, ...]:
    """Describe every channel of a robot.

    Type names carry the robot, since array sizes differ by robot; where two channels of one class differ in layout,
    they carry the last part of the topic too.
    """
    layouts: dict[str, set[str]] = {}
    for channel in manifest.channels:
        layouts.setdefault(type(channel.record).__name__, set()).add(channel.record.ros_definition())
    specs = []
    for channel in manifest.channels:
        record = channel.record
        name = type(record).__name__.lstrip("_")
        if len(layouts[type(record).__name__]) > 1:
            name += camel_case(record.topic.rsplit("/", 1)[-1])
        specs.append(
            ChannelSpec(
                number=channel.number,
                topic=record.topic,
                loop=channel.loop,
                role=channel.role,
                on_change=record.on_change,
                record=type(record).__name__,
                sizes=record.sizes,
                type_name=f"ugv_{package_name(robot)}_msgs/msg/{name}",
                definition=record.ros_definition(),
            )
        )
    repeated = [topic for topic, number in Counter(spec.topic for spec in specs).items() if number > 1]
    if repeated:
        raise ValueError(f"more than one channel is called {repeated[0]}")
    return tuple(specs)


def package_name(robot: str) -> str:
    """A robot's name as part of a ROS package name."""
    return re.sub(r"[^a-z0-9]+", "_", robot.lower()).strip("_")


def camel_case(text: str) -> str:
    """`whole_body` as `WholeBody`."""
    return "".join(part.capitalize() for part in re.split(r"[^A-Za-z0-9]+", text))


def fields_of(definition: str) -> tuple[FieldLayout, ...]:
    """Names and types of a flat message.

    Raises:
        LogError: if the text is not a flat message of numbers, naming the line.
    """
    fields: list[FieldLayout] = []
    for line in definition.splitlines():
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        match = _LINE.match(line.strip())
        if match is None:
            raise LogError(f"the message definition line {line!r} is not a flat field of numbers")
        kind, length, name = match.groups()
        fields.append((name, kind if length is None else f"{kind}[{length}]"))
    return tuple(fields)


def dtype_of(definition: str) -> np.dtype[Any]:
    """The aligned little-endian numpy record type of a flat message."""
    parts: list[Any] = []
    for name, kind in fields_of(definition):
        base, _, length = kind.partition("[")
        parts.append((name, _FORMATS[base], (int(length[:-1]),)) if length else (name, _FORMATS[base]))
    return np.dtype(parts, align=True)


def body_size(dtype: np.dtype[Any]) -> int:
    """Bytes of the CDR body: up to the end of the last field, without trailing padding."""
    fields: Mapping[str, Any] = dtype.fields or {}
    return max((int(offset) + part.itemsize for part, offset, *_ in fields.values()), default=0)


def first_difference(logged: str, ours: str) -> str | None:
    """How two layouts differ, by field name, or None; comments do not count."""
    theirs, own = dict(fields_of(logged)), dict(fields_of(ours))
    for name, kind in theirs.items():
        if name not in own:
            return f"field `{name}` ({kind}) is in the log but not in this code"
        if own[name] != kind:
            return f"field `{name}` is {kind} in the log and {own[name]} in this code"
    for name, kind in own.items():
        if name not in theirs:
            return f"field `{name}` ({kind}) is in this code but not in the log"
    for (name, _), (other, _) in zip(fields_of(logged), fields_of(ours), strict=True):
        if name != other:
            return f"field `{name}` of the log stands where this code has `{other}`"
    return None
