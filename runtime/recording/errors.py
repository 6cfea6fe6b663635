# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with a log; every message is one sentence that names what and where."""

from __future__ import annotations

from runtime.errors import OutputError, UgvError


class RecordingError(OutputError):
    """The log cannot be written any further; what was written before it stays readable."""


class LogError(UgvError):
    """A log cannot be read, or does not belong to this robot or this code."""
