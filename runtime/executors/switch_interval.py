# SPDX-License-Identifier: Apache-2.0
"""How long a thread that wants the interpreter waits for one that computes."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def switch_interval(microseconds: int) -> Iterator[None]:
    """Set it for a while; below 50 us, real-time threads on one processor can starve each other for good."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(microseconds * 1e-6)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
