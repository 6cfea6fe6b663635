# SPDX-License-Identifier: Apache-2.0
"""The buses of a run against the wall clock: interfaces of the kernel where it gives any, hubs of sockets elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from drivers.opening import SOCKETCAN, UNIX
from sim_bridge.virtual_links import LinkError, virtual_links


class Buses(NamedTuple):
    """What both ends of each bus open.

    Attributes:
        interface: of python-can.
        channels: of that interface, one a bus.
        note: which buses these are and why, as a sentence.
    """

    interface: str
    channels: tuple[str, ...]
    note: str


MakeBuses = Callable[[int, Path], AbstractContextManager[Buses]]
"""Makes so many buses for as long as it is entered; what they need of files is in the runtime directory."""


@contextmanager
def live_buses(count: int, directory: Path) -> Iterator[Buses]:
    """Interfaces of the kernel, or else hubs."""
    with ExitStack() as stack:
        try:
            names = stack.enter_context(virtual_links(count))
            buses = Buses(SOCKETCAN, names, f"the buses are {', '.join(names)}, CAN interfaces of the kernel (vcan)")
        except LinkError as error:
            note = f"the buses are sockets, since here no CAN interface can be made ({error})"
            buses = stack.enter_context(hub_buses(count, directory))._replace(note=note)
        yield buses


@contextmanager
def hub_buses(count: int, directory: Path) -> Iterator[Buses]:
    """Hubs, also where the kernel has interfaces: their owner can break them."""
    yield Buses(UNIX, tuple(str(directory / f"can{bus}") for bus in range(count)), "the buses are sockets")
