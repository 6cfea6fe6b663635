# SPDX-License-Identifier: Apache-2.0
"""std_msgs: Bool, String, Empty and Float64."""

from __future__ import annotations

from runtime.messages.cdr import CdrTemplate
from runtime.messages.cdr_reader import CdrReader


def decode_bool(payload: bytes) -> bool:
    """The value of a std_msgs/Bool; MessageError if it is none."""
    reader = CdrReader(payload)
    value = reader.boolean()
    reader.finish()
    return value


def decode_string(payload: bytes) -> str:
    """The text of a std_msgs/String; MessageError if it is none."""
    reader = CdrReader(payload)
    text = reader.string()
    reader.finish()
    return text


def decode_empty(payload: bytes) -> None:
    """See that this is a std_msgs/Empty, which most writers give one byte; MessageError if it is none."""
    reader = CdrReader(payload)
    reader.numbers("B", min(reader.remaining, 1))
    reader.finish()


def decode_float64(payload: bytes) -> float:
    """The value of a std_msgs/Float64; MessageError if it is none."""
    reader = CdrReader(payload)
    value: float = reader.numbers("d")[0]
    reader.finish()
    return value


def encode_bool(value: bool) -> bytes:
    """A std_msgs/Bool."""
    template = CdrTemplate()
    template.uint8(value)
    return template.to_bytes()


def encode_empty() -> bytes:
    """A std_msgs/Empty, which has one byte on the wire."""
    template = CdrTemplate()
    template.uint8(0)
    return template.to_bytes()


def encode_float64(value: float) -> bytes:
    """A std_msgs/Float64."""
    template = CdrTemplate()
    slot = template.float64(1)
    template.view(slot, 1)[0] = value
    return template.to_bytes()


def encode_string(text: str) -> bytes:
    """A std_msgs/String."""
    template = CdrTemplate()
    template.string(text)
    return template.to_bytes()
