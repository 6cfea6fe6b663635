# SPDX-License-Identifier: Apache-2.0
"""What rmw_zenoh attaches to every message: its number, when it was sent, and who sent it. 33 bytes."""

from __future__ import annotations

import struct
from typing import NamedTuple

from runtime.messages.errors import MessageError

_LAYOUT = struct.Struct("<qqB16s")
GID_BYTES = 16


class Attachment(NamedTuple):
    """The attachment of a message.

    Attributes:
        sequence: number of the message among those of its publisher.
        sent_ns: unix time.
        gid: of the publisher, 16 bytes.
    """

    sequence: int
    sent_ns: int
    gid: bytes

    def to_bytes(self) -> bytes:
        """As it travels."""
        return _LAYOUT.pack(self.sequence, self.sent_ns, GID_BYTES, self.gid)

    @property
    def source(self) -> int:
        """The publisher as a number of 63 bits."""
        return int.from_bytes(self.gid[:8], "little") & (1 << 63) - 1


def parse_attachment(data: bytes) -> Attachment:
    """Read an attachment.

    Raises:
        MessageError: if this is none.
    """
    if len(data) != _LAYOUT.size:
        raise MessageError("the attachment has another length than rmw_zenoh's")
    sequence, sent_ns, length, gid = _LAYOUT.unpack(data)
    if length != GID_BYTES:
        raise MessageError("the attachment names its sender in another way than rmw_zenoh")
    return Attachment(sequence, sent_ns, gid)
