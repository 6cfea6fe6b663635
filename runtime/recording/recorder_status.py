# SPDX-License-Identifier: Apache-2.0
"""What the recorder tells the other processes of itself: a small JSON file, replaced whole."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

STATUS_FILE = "recorder.status"


@dataclass
class RecorderStatus:
    """How the recorder fares; all counts are since its start.

    Attributes:
        recording: path of the log that is written; "" while there is none.
        bag: name of the present or last bag.
        since_ns: since when that is so, in UTC.
        bags: bags that were begun.
        recorded: datagrams that were taken into a bag.
        gaps: places where ticks are missing, or where a bag begins after the first tick.
        dropped: ticks that are missing there, at most.
        failed: datagrams that could not be written.
        rejected: datagrams that are not of this robot's loops.
        error: the last failure, as a sentence; it stays when recording goes on.
        backlog_bytes: received and not yet written.
        overflowed: datagrams for which the backlog had no room.
        updated_ns: when this was written, on the monotonic clock.
    """

    recording: str = ""
    bag: str = ""
    since_ns: int = 0
    bags: int = 0
    recorded: int = 0
    gaps: int = 0
    dropped: int = 0
    failed: int = 0
    rejected: int = 0
    error: str = ""
    backlog_bytes: int = 0
    overflowed: int = 0
    updated_ns: int = 0

    def write(self, directory: Path) -> None:
        """Replace the file in a runtime directory."""
        path = directory / STATUS_FILE
        fresh = path.with_name(f".{STATUS_FILE}.new")
        fresh.write_text(json.dumps(asdict(self), indent=1))
        os.replace(fresh, path)


def read_status(directory: Path) -> RecorderStatus | None:
    """What the last recorder wrote into a runtime directory; None if there is nothing that can be read."""
    try:
        content = json.loads((directory / STATUS_FILE).read_text())
    except (OSError, ValueError):
        return None
    if not isinstance(content, dict):
        return None
    kinds = {name: type(value) for name, value in asdict(RecorderStatus()).items()}
    return RecorderStatus(**{k: v for k, v in content.items() if k in kinds and type(v) is kinds[k]})
