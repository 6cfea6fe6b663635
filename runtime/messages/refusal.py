# SPDX-License-Identifier: Apache-2.0
"""Why zenoh refuses something, in one sentence and without the values of a configuration: some are passwords."""

from __future__ import annotations

import re

_PLACE_IN_SOURCE = re.compile(r" at /\S+\.rs:\d+\.?")
_PLACE_IN_FILE = re.compile(r"(?:line: |--> )(\d+)(?:, column: |:)(\d+)")
_UNKNOWN = re.compile(r"unknown field `[^`]*`")
_EXPECTED = re.compile(r".*[,=] (expected [^\"\n]+)", re.DOTALL)


def reason(error: Exception) -> str:
    """What zenoh says of a session."""
    text = str(error).strip().split("\n")[0]
    return _PLACE_IN_SOURCE.sub("", text.partition(": {")[0])  # what follows may be a whole configuration


def reason_of_file(error: Exception) -> str:
    """What zenoh says of a configuration file: what it expected and where, but not what it found there."""
    text = _PLACE_IN_SOURCE.sub("", str(error))
    place = _PLACE_IN_FILE.search(text)
    if place is None:
        return reason(error)
    told = [found[0] for found in (_UNKNOWN.search(text),) if found]
    told += [found[1] for found in (_EXPECTED.match(text),) if found]
    return f"{', '.join(told) or 'it is not understood'} at line {place[1]}, column {place[2]}"
