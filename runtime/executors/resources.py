# SPDX-License-Identifier: Apache-2.0
"""What a process holds of the system: memory, open files, mapped files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

_PAGE = os.sysconf("SC_PAGE_SIZE")
FILES_HELD = {"open_files": "open files", "mapped_files": "mapped files"}
"""Of `Resources`, what a process that keeps none has no more of later, and how it is called."""


class Resources(NamedTuple):
    """Held by one process at one time.

    Attributes:
        resident_bytes: of memory.
        data_bytes: of memory of its own, whether or not it was used yet.
        open_files: descriptors.
        mapped_files: mappings that have a file.
    """

    resident_bytes: int
    data_bytes: int
    open_files: int
    mapped_files: int


def resources_of(pid: int) -> Resources | None:
    """What a process holds now; None if it is gone or another user's."""
    process = Path("/proc") / str(pid)
    try:
        pages = (process / "statm").read_text().split()
        resident, data = int(pages[1]) * _PAGE, int(pages[5]) * _PAGE
        mapped = sum(" /" in line for line in (process / "maps").read_text().splitlines())
        return Resources(resident, data, len(os.listdir(process / "fd")), mapped)
    except OSError:
        return None
