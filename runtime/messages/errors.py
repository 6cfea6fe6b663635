# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a message."""

from __future__ import annotations

from runtime.errors import UgvError


class MessageError(UgvError):
    """Bytes that are not the message they should be, or a message that cannot be used.

    The text is one of few, without anything that the sender chose, so that rejections can be counted by it.
    """
