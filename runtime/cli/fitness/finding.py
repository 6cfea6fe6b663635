# SPDX-License-Identifier: Apache-2.0
"""What an examination of the host has found: one sentence, and what to do about it."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Verdict(str, Enum):
    """Whether the robot may run: yes, yes but worse than it could, no."""

    OK = "ok"
    WARN = "warn"
    FAIL = "fail"


class Finding(NamedTuple):
    """One thing that was looked at.

    Attributes:
        name: of what was looked at.
        verdict: on it.
        sentence: what was found.
        remedy: what to do; empty where nothing needs to be done.
    """

    name: str
    verdict: Verdict
    sentence: str
    remedy: str = ""


def ok(name: str, sentence: str) -> Finding:
    """Nothing is wrong."""
    return Finding(name, Verdict.OK, sentence)


def warn(name: str, sentence: str, remedy: str) -> Finding:
    """The robot can run, worse than it could."""
    return Finding(name, Verdict.WARN, sentence, remedy)


def fail(name: str, sentence: str, remedy: str) -> Finding:
    """The robot must not run."""
    return Finding(name, Verdict.FAIL, sentence, remedy)
