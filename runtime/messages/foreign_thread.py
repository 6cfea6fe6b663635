# SPDX-License-Identifier: Apache-2.0
"""Threads that Python did not start and that call it again and again, as those in which zenoh reads the network.

For each call the interpreter makes such a thread a state of its own, and drops it afterwards. It lies in memory that is
mapped and unmapped, hundreds of times a second, which interrupts the other processors.
"""

from __future__ import annotations

import ctypes
import threading

_hold = ctypes.pythonapi.PyGILState_Ensure
_hold.restype = ctypes.c_int
_held = threading.local()


def keep_thread_state() -> None:
    """Let the calling thread keep its state until the interpreter ends."""
    if not hasattr(_held, "state"):
        _held.state = _hold()
