# SPDX-License-Identifier: Apache-2.0
"""CAN interfaces of the kernel (vcan) that are there for one run, and gone after it.

Their names are like none that a robot has. They go with the process that made them; should that one be killed, they are
removed by `remove_orphaned_links` in a process that outlives it, or by the next run. Who lives is seen by an abstract
socket: like the interfaces it belongs to the network name space, and it ends with its process.
"""

from __future__ import annotations

import re
import secrets
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from drivers.errors import DriverConfigError
from drivers.opening import SOCKETCAN, open_bus
from runtime.errors import UgvError

_NAME = re.compile(r"ugv([0-9a-f]{8})-\d+")
"""What a run calls its interfaces; 8 digits tell whose they are. A name has at most 15 characters."""


class LinkError(UgvError):
    """An interface that cannot be made."""


@contextmanager
def virtual_links(count: int) -> Iterator[tuple[str, ...]]:
    """Make interfaces, remove those whose makers are gone, and give their names.

    Raises:
        LinkError: if one cannot be made or used; then none is left.
    """
    remove_orphaned_links()
    owner = secrets.token_hex(4)
    names = tuple(f"ugv{owner}-{bus}" for bus in range(count))
    with _held(owner), ExitStack() as stack:
        for name in names:
            _ip("add", name, "up", "type", "vcan")
            stack.callback(_remove, name)
            _try_out(name)
        yield names


def remove_orphaned_links() -> None:
    """Remove the interfaces of runs whose processes were killed."""
    for _, name in socket.if_nameindex():
        made = _NAME.fullmatch(name)
        if made:
            with suppress(LinkError), _held(made[1]):
                _remove(name)


@contextmanager
def _held(owner: str) -> Iterator[None]:
    """Be the owner of interfaces.

    Raises:
        LinkError: if somebody else is.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sign:
        try:
            sign.bind(f"\0ugv-links-{owner}")
        except OSError as error:
            raise LinkError(f"the interfaces of {owner} are in use: {error.strerror}") from None
        yield


def _try_out(name: str) -> None:
    try:
        open_bus(SOCKETCAN, name).shutdown()
    except DriverConfigError as error:
        raise LinkError(str(error)) from None


def _remove(name: str) -> None:
    with suppress(LinkError):  # gone already, or made by another user
        _ip("delete", name)


def _ip(*arguments: str) -> None:
    try:
        done = subprocess.run(["ip", "link", *arguments], capture_output=True, text=True, check=False)
    except OSError as error:
        raise LinkError(f"the program ip, of iproute2: {(error.strerror or str(error)).lower()}") from None
    if done.returncode:
        raise LinkError(" ".join(done.stderr.split()).rstrip("."))
