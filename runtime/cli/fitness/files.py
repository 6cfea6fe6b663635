# SPDX-License-Identifier: Apache-2.0
"""Directories that the processes write to, and the room in them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from runtime.cli.fitness.finding import Finding, fail, ok, warn

GIGABYTE = 10**9
LEAST_BYTES, PLENTY_BYTES = GIGABYTE, 10 * GIGABYTE
SERVICE_USER = "ugv"


class Directory(NamedTuple):
    """A directory, or where it would be made.

    Attributes:
        path: of it.
        writable: by the caller or by the user of the units.
        free_bytes: of the file system.
    """

    path: Path
    writable: bool
    free_bytes: int


def read_directory(path: Path) -> Directory:
    """Look at a directory, or at the nearest one above it that exists, without writing."""
    nearest = next(place for place in (path.absolute(), *path.absolute().parents) if place.exists())
    room = os.statvfs(nearest)
    permitted = os.access(nearest, os.W_OK) or _of_service(nearest)
    writable = nearest.is_dir() and permitted and not room.f_flag & os.ST_RDONLY
    return Directory(path, writable, room.f_bavail * room.f_frsize)


def _of_service(directory: Path) -> bool:
    try:
        return directory.owner() == SERVICE_USER
    except KeyError:
        return False


def check_writable(name: str, directory: Directory, option: str) -> Finding:
    """Something can be written there."""
    if directory.writable:
        return ok(name, f"{directory.path} can be written to")
    return fail(
        name,
        f"{directory.path} cannot be written to",
        f"give it to the user who runs the robot, or name another one with {option}",
    )


def check_room(directory: Directory) -> Finding:
    """There is room for a log."""
    sentence = f"{directory.free_bytes / GIGABYTE:.1f} GB are free for logs in {directory.path}"
    if directory.free_bytes < LEAST_BYTES:
        return fail("disk", sentence, "remove old logs")
    if directory.free_bytes < PLENTY_BYTES:
        return warn("disk", sentence, "remove old logs soon")
    return ok("disk", sentence)
