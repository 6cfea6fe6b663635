# SPDX-License-Identifier: Apache-2.0
"""What a real-time thread asks of Linux: a priority, its processors, memory that stays, to wake and send on time."""

from __future__ import annotations

import ctypes
import os
import socket
import struct
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_TIMER_ABSTIME = 1
_NS_PER_SECOND = 1_000_000_000
LATENCY_REQUEST = Path("/dev/cpu_dma_latency")
"""Holds, as long as it is open, the latency that is written into it (the kernel's PM QoS interface)."""
_LIBC = ctypes.CDLL(None, use_errno=True)
_send = ctypes.PyDLL(None, use_errno=True).send
_send.argtypes, _send.restype = (ctypes.c_int, ctypes.c_char_p, ctypes.c_size_t, ctypes.c_int), ctypes.c_ssize_t


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


class Alarm:
    """Lets its thread sleep until a time of the monotonic clock (`time.monotonic_ns`), without holding the GIL."""

    def __init__(self) -> None:
        self._until = _Timespec()
        self._pointer = ctypes.byref(self._until)
        self._sleep = _LIBC.clock_nanosleep

    def sleep_until(self, monotonic_ns: int) -> None:
        """Return at the time, or at once if it has passed; signals do not cut it short."""
        self._until.seconds, self._until.nanoseconds = divmod(monotonic_ns, _NS_PER_SECOND)
        while self._sleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, self._pointer, None):
            pass


def run_first(priority: int) -> str:
    """Put the calling thread under SCHED_FIFO; returns why that was refused, or nothing."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return f"no SCHED_FIFO at priority {priority}, so threads run at normal priority ({error.strerror})"
    return ""


def stay_on(processors: Collection[int]) -> str:
    """Keep the calling thread on some processors; returns why that was refused, or nothing."""
    try:
        os.sched_setaffinity(0, processors)
    except OSError as error:
        return f"no affinity to the processors {sorted(processors)} ({error.strerror})"
    return ""


def lock_memory() -> str:
    """Keep all memory of this process, now and later, in RAM; returns why that was refused, or nothing."""
    if _LIBC.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0:
        return ""
    return f"memory is not locked, so page faults may delay a loop ({os.strerror(ctypes.get_errno())})"


def unlock_memory() -> None:
    """Let the system move this process's memory again."""
    _LIBC.munlockall()


@contextmanager
def processors_awake(exit_latency_us: int, request: Path = LATENCY_REQUEST) -> Iterator[str]:
    """Keep every processor from sleeping so deeply that it needs longer than this to wake.

    Gives why that was refused, or nothing.
    """
    try:
        descriptor = os.open(request, os.O_WRONLY)
    except OSError as error:
        yield f"processors may sleep deeply between ticks, and wake later for it ({request}: {error.strerror})"
        return
    try:
        os.write(descriptor, struct.pack("=i", exit_latency_us))
        yield ""
    finally:
        os.close(descriptor)


def send_at_once(descriptor: int, datagram: bytes) -> int:
    """Send on a socket without waiting; returns 0, or the error's number.

    `socket.send` gives the GIL away, and a thread that has to win it back waits for the switch interval; this keeps it.
    """
    if _send(descriptor, datagram, len(datagram), socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL) >= 0:
        return 0
    return ctypes.get_errno()
