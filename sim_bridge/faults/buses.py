# SPDX-License-Identifier: Apache-2.0
"""Faults of the drives, of what they report, and of the buses that carry it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from drivers.can_frame import CAN_ERR_FLAG, FRAME_SIZE, MAX_DATA_LENGTH, Frames, make_frames
from drivers.memory_bus import End
from runtime.robots import topics
from sim_bridge.faults.wires import Wires

BUS_OFF, RESTARTED = 0x040, 0x100
"""Classes of error frames: linux/can/error.h."""
_DATA = FRAME_SIZE - MAX_DATA_LENGTH
"""Where the data begin in a `struct can_frame`."""
_DRIVE, _POSITION, _EFFORT, _TEMPERATURE, _ERROR = 0, (1, 2), (4, 5), 6, 7
"""Bytes of a drive's reply; the effort has the lower half of its first."""
_FAR_OFF = 0xB0
"""In both bytes of a position: 4.8 rad at the drive, beyond every joint's limits."""


def _a_joint(wires: Wires) -> int:
    return int(wires.rng.integers(len(wires.config.drives.bus)))


def _a_bus(wires: Wires) -> int:
    return int(wires.rng.integers(wires.config.drives.buses))


def _alter_replies(wires: Wires, begin_ns: int, end_ns: int, alter: Callable[[memoryview], bool]) -> None:
    """Alter or destroy the replies of one drive."""
    joint, drives = _a_joint(wires), wires.config.drives
    bus, drive = drives.bus[joint], drives.can_id[joint]

    def change(sender: End, on_bus: int, arrival_ns: int, frame: bytearray) -> bool:
        reply = memoryview(frame)[_DATA:]
        of_drive = sender == End.DEVICE and on_bus == bus and reply[_DRIVE] == drive
        return not (of_drive and begin_ns <= arrival_ns < end_ns) or alter(reply)

    wires.tamper(change)


def no_replies(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """One drive's replies are lost."""
    _alter_replies(wires, begin_ns, end_ns, lambda reply: False)


def drive_error(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """A drive reports an error and gives no torque."""
    joint, code = _a_joint(wires), int(wires.rng.integers(1, 7))
    wires.once(begin_ns, lambda: wires.world.drives.force_error(joint, code))
    wires.once(end_ns, lambda: wires.world.drives.force_error(joint, 0))


def reported_error(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """A drive reports an error, but goes on."""
    code = int(wires.rng.integers(1, 7))
    _alter_replies(wires, begin_ns, end_ns, lambda reply: _put(reply, _ERROR, code))


def _put(reply: memoryview, place: int, value: int) -> bool:
    reply[place] = value
    return True


def hot_drive(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """A drive reports a temperature above its limit."""
    value = int(wires.config.safety.temperature_max_degc) + 5
    _alter_replies(wires, begin_ns, end_ns, lambda reply: _put(reply, _TEMPERATURE, value))


def saturated_drive(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """A drive reports the largest torque that its replies can hold."""

    def alter(reply: memoryview) -> bool:
        reply[_EFFORT[0]] |= 0x0F
        reply[_EFFORT[1]] = 0xFF
        return True

    _alter_replies(wires, begin_ns, end_ns, alter)


def joint_out_of_range(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """A drive reports a position far beyond its joint's limits."""

    def alter(reply: memoryview) -> bool:
        for place in _POSITION:
            reply[place] = _FAR_OFF
        return True

    _alter_replies(wires, begin_ns, end_ns, alter)


def bus_down(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """The link of a bus is lost."""
    bus = _a_bus(wires)
    wires.once(begin_ns, lambda: wires.bus.take_down(bus))
    wires.once(end_ns, lambda: wires.bus.bring_up(bus))


def bus_off(wires: Wires, begin_ns: int, end_ns: int) -> None:
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


def bus_flooded(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """A babbling node fills a bus with frames of the highest priority."""
    bus, burst = _a_bus(wires), make_frames([0] * 32, 8)

    def babble(now_ns: int) -> None:
        if begin_ns <= now_ns < end_ns:
            wires.bus.send(End.DEVICE, np.full(len(burst), bus, np.uint8), burst, now_ns)

    wires.events.append(babble)


def bus_full(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """The queue of frames to be sent on a bus has no room left."""
    bus, stuck = _a_bus(wires), make_frames([0x7FF] * 128, 8)

    def fill() -> None:
        later_ns = min(end_ns, begin_ns + 10_000_000_000)
        wires.bus.send(End.HOST, np.full(len(stuck), bus, np.uint8), stuck, later_ns)

    wires.once(begin_ns, fill)


def malformed_frames(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """Frames of unknown drives, of wrong lengths and of no meaning among the replies."""

    def babble(now_ns: int) -> None:
        if begin_ns <= now_ns < end_ns:
            frames = make_frames([int(wires.rng.integers(0x700))], int(wires.rng.integers(9)), wires.rng.bytes(8))
            wires.bus.send(End.DEVICE, np.full(1, _a_bus(wires), np.uint8), frames, now_ns)

    wires.events.append(babble)


def low_battery(wires: Wires, begin_ns: int, end_ns: int) -> None:
    """The battery's voltage is too low."""

    def change(battery: Any, now_ns: int) -> bool:
        if begin_ns <= now_ns < end_ns:
            battery.voltage = wires.config.safety.voltage_min_v - 0.5
        return True

    wires.filter(topics.BATTERY, change)
