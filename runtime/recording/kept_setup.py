# SPDX-License-Identifier: Apache-2.0
"""The setup of a recorder, kept for the one that is started in its place.

A setup names the channels of an assembled robot, and assembling one takes seconds, of which the log would lack every
tick. One that was made from the same code, packages and configuration is as good.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec

from runtime.recording.fingerprint import fingerprint, package_versions
from runtime.recording.setup import RecordingSetup

SETUP_FILE = "recorder.setup"
_PACKAGES = Path(__file__).resolve().parents[2]
_ROOMS, _SUFFIXES = ("runtime", "drivers"), (".py", ".toml")


class Prepared(msgspec.Struct):
    """What a recorder needs of a robot.

    Attributes:
        setup: what is to be recorded.
        priority: of the recorder's threads.
    """

    setup: RecordingSetup
    priority: int


class _Kept(msgspec.Struct):
    origin: str
    prepared: Prepared


def origin(*chosen: bytes) -> str:
    """A digest of all that a setup follows from: the code, the packages, the processor, and what the user chose."""
    digest = hashlib.sha256(json.dumps([package_versions(), fingerprint()]).encode())
    sources = (file for room in _ROOMS for file in (_PACKAGES / room).rglob("*") if file.suffix in _SUFFIXES)
    parts = [part for file in sorted(sources) for part in (str(file).encode(), file.read_bytes())]
    for part in (*parts, *chosen):
        digest.update(hashlib.sha256(part).digest())
    return digest.hexdigest()


def kept_setup(directory: Path, made_from: str, make: Callable[[], Prepared]) -> Prepared:
    """The setup that the recorder before this one kept, or a new one, which is kept.

    Args:
        directory: runtime directory.
        made_from: its `origin`; one of another is not taken up.
        make: makes a new one.
    """
    file = directory / SETUP_FILE
    with suppress(OSError, ValueError, msgspec.MsgspecError):  # ValueError: text that is not UTF-8
        kept = msgspec.msgpack.decode(file.read_bytes(), type=_Kept)
        if kept.origin == made_from:
            return kept.prepared
    prepared = make()
    fresh = file.with_name(f".{SETUP_FILE}.new")
    with suppress(OSError):  # then the next one makes its own
        fresh.write_bytes(msgspec.msgpack.encode(_Kept(made_from, prepared)))
        os.replace(fresh, file)
    return prepared
