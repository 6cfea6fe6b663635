# SPDX-License-Identifier: Apache-2.0
"""How long a thread that wants the interpreter waits for one that computes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


def set_switch_interval(microseconds: int) -> None:
    """Set it until it is set again; it holds for who waits, not for who computes."""
    sys.setswitchinterval((microseconds + 0.5) * 1e-6)  # it is cut to whole microseconds


@contextmanager
def switch_interval(microseconds: int) -> Iterator[None]:
    """Set it for a while; below 50 us, real-time threads on one processor can starve each other for good."""
    before = sys.getswitchinterval()
    set_switch_interval(microseconds)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
