# SPDX-License-Identifier: Apache-2.0
"""Faults of the drives of joints, and of what they report."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drivers.can_frame import FRAME_SIZE, MAX_DATA_LENGTH
from drivers.memory_bus import End
from runtime.records import Record
from runtime.signals import JointCommand
from sim_bridge.faults.wires import QuadrupedWires

_DATA = FRAME_SIZE - MAX_DATA_LENGTH
"""Where the data begin in a `struct can_frame`."""
_DRIVE, _POSITION, _EFFORT, _TEMPERATURE, _ERROR = 0, (1, 2), (4, 5), 6, 7
"""Bytes of a drive's reply; the effort has the lower half of its first."""
_FAR_OFF = 0xB0
"""In both bytes of a position: 4.8 rad at the drive, beyond every joint's limits."""


def _a_joint(wires: QuadrupedWires) -> int:
    return int(wires.rng.integers(len(wires.config.drives.bus)))


def _alter_replies(wires: QuadrupedWires, begin_ns: int, end_ns: int, alter: Callable[[memoryview], bool]) -> None:
    """Alter or destroy the replies of one drive."""
    joint, drives = _a_joint(wires), wires.config.drives
    bus, drive = drives.bus[joint], drives.can_id[joint]

    def change(sender: End, on_bus: int, arrival_ns: int, frame: bytearray) -> bool:
        reply = memoryview(frame)[_DATA:]
        of_drive = sender == End.DEVICE and on_bus == bus and reply[_DRIVE] == drive
        return not (of_drive and begin_ns <= arrival_ns < end_ns) or alter(reply)

    wires.tamper(change)


def no_replies(wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """One drive's replies are lost."""
    _alter_replies(wires, begin_ns, end_ns, lambda reply: False)


def drive_error(wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """A drive reports an error and gives no torque."""
    joint, code = _a_joint(wires), int(wires.rng.integers(1, 7))
    wires.once(begin_ns, lambda: wires.world.drives.force_error(joint, code))
    wires.once(end_ns, lambda: wires.world.drives.force_error(joint, 0))


def reported_error(wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """A drive reports an error, but goes on."""
    code = int(wires.rng.integers(1, 7))
    _alter_replies(wires, begin_ns, end_ns, lambda reply: _put(reply, _ERROR, code))


def _put(reply: memoryview, place: int, value: int) -> bool:
    reply[place] = value
    return True


def hot_drive(wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """A drive reports a temperature above its limit."""
    value = int(wires.config.safety.temperature_max_degc) + 5
    _alter_replies(wires, begin_ns, end_ns, lambda reply: _put(reply, _TEMPERATURE, value))


def saturated_drive(wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """A drive reports the largest torque that its replies can hold."""

    def alter(reply: memoryview) -> bool:
        reply[_EFFORT[0]] |= 0x0F
        reply[_EFFORT[1]] = 0xFF
        return True

    _alter_replies(wires, begin_ns, end_ns, alter)


def joint_out_of_range(wires: QuadrupedWires, begin_ns: int, end_ns: int) -> None:
    """A drive reports a position far beyond its joint's limits."""

    def alter(reply: memoryview) -> bool:
        for place in _POSITION:
            reply[place] = _FAR_OFF
        return True

    _alter_replies(wires, begin_ns, end_ns, alter)


def bad_torque(wires: QuadrupedWires, command: Record) -> None:
    """The control law computes a torque that is no number."""
    assert isinstance(command, JointCommand)
    command.effort[_a_joint(wires)] = np.nan
