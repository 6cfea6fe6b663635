# SPDX-License-Identifier: Apache-2.0
"""Faults of the buses that carry frames."""

from __future__ import annotations

from functools import partial

import numpy as np

from drivers.can_frame import CAN_ERR_FLAG, Frames, make_frames
from drivers.memory_bus import End
from sim_bridge.faults.wires import AnyWires, Inject

BUS_OFF, RESTARTED = 0x040, 0x100
"""Classes of error frames: linux/can/error.h."""


def _a_bus(wires: AnyWires) -> int:
    return int(wires.rng.integers(wires.config.drives.buses))


def bus_down(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """The link of a bus is lost."""
    bus = _a_bus(wires)
    wires.once(begin_ns, lambda: wires.bus.take_down(bus))
    wires.once(end_ns, lambda: wires.bus.bring_up(bus))


def bus_off(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """A bus's controller reports that it has switched itself off; nothing passes until it reports that it is back."""
    bus = _a_bus(wires)
    reports = [make_frames([CAN_ERR_FLAG | what], 8) for what in (BUS_OFF, RESTARTED)]

    def change(sender: End, on_bus: int, arrival_ns: int, frame: bytearray) -> bool:
        is_report = frame in [report.tobytes() for report in reports]
        return is_report or on_bus != bus or not begin_ns <= arrival_ns < end_ns

    def tell(report: Frames, at_ns: int) -> None:
        wires.bus.send(End.DEVICE, np.full(1, bus, np.uint8), report, at_ns)

    wires.tamper(change)
    for report, at_ns in zip(reports, (begin_ns, end_ns), strict=True):
        wires.once(at_ns, partial(tell, report, at_ns))


def flooded(frames: int) -> Inject:
    """A babbling node fills a bus with frames of the highest priority, so many a tick."""

    def inject(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
        bus, burst = _a_bus(wires), make_frames([0] * frames, 8)

        def babble(now_ns: int) -> None:
            if begin_ns <= now_ns < end_ns:
                wires.bus.send(End.DEVICE, np.full(len(burst), bus, np.uint8), burst, now_ns)

        wires.events.append(babble)

    return inject


def bus_full(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """The queue of frames to be sent on a bus has no room left."""
    bus, stuck = _a_bus(wires), make_frames([0x7FF] * 128, 8)

    def fill() -> None:
        later_ns = min(end_ns, begin_ns + 10_000_000_000)
        wires.bus.send(End.HOST, np.full(len(stuck), bus, np.uint8), stuck, later_ns)

    wires.once(begin_ns, fill)


def malformed_frames(wires: AnyWires, begin_ns: int, end_ns: int) -> None:
    """Frames of unknown drives, of wrong lengths and of no meaning among the replies."""

    def babble(now_ns: int) -> None:
        if begin_ns <= now_ns < end_ns:
            frames = make_frames([int(wires.rng.integers(0x700))], int(wires.rng.integers(9)), wires.rng.bytes(8))
            wires.bus.send(End.DEVICE, np.full(1, _a_bus(wires), np.uint8), frames, now_ns)

    wires.events.append(babble)
