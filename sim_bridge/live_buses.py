# SPDX-License-Identifier: Apache-2.0
"""The buses of a run against the wall clock: interfaces of the kernel where it gives any, hubs of sockets elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
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


@contextmanager
def live_buses(count: int, directory: Path) -> Iterator[Buses]:
    """So many buses for as long as this is entered; hubs have their files in the runtime directory."""
    with ExitStack() as stack:
        try:
            names = stack.enter_context(virtual_links(count))
            buses = Buses(SOCKETCAN, names, f"the buses are {', '.join(names)}, CAN interfaces of the kernel (vcan)")
        except LinkError as error:
            channels = tuple(str(directory / f"can{bus}") for bus in range(count))
            buses = Buses(UNIX, channels, f"the buses are sockets, since here no CAN interface can be made ({error})")
        yield buses
