# SPDX-License-Identifier: Apache-2.0
"""Faults of a vehicle's control unit, of what it reports, and of what it drives."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
import numpy.typing as npt

from drivers.can_frame import FRAME_SIZE, MAX_DATA_LENGTH, Frames
from drivers.memory_bus import End
from drivers.vcu import STATE_FRAMES, TEMPERATURES, UNIT_STATE, WHEELS, UnitMode, WheelFault
from drivers.vcu_database import COUNTER, WHEEL_NAMES
from sim_bridge.faults import buses
from sim_bridge.faults.wires import Inject, VehicleWires

_DATA = FRAME_SIZE - MAX_DATA_LENGTH
"""Where the data begin in a `struct can_frame`."""
TOO_HOT_DEGC, TOO_LOW_V, TOO_FAST_MPS = 5.0, 0.5, 0.5
"""By how much a reading is beyond its bound."""
FLOOD = 80
"""Frames a tick, twice what the bus can carry."""
Values = dict[str, float]
Array = npt.NDArray[np.float64]


def _a_wheel(wires: VehicleWires) -> int:
    return int(wires.rng.integers(WHEELS))


def _frames_of(
    wires: VehicleWires, sender: End, begin_ns: int, end_ns: int, alter: Callable[[int, memoryview], bool]
) -> None:
    """Alter the data of one end's frames, or destroy them where that is false; the frame's identifier is given too."""

    def change(by: End, bus: int, arrival_ns: int, frame: bytearray) -> bool:
        if by != sender or not begin_ns <= arrival_ns < end_ns:
            return True
        return alter(int.from_bytes(frame[:4], "little"), memoryview(frame)[_DATA:])

    wires.tamper(change)


def _lost(wires: VehicleWires, kinds: Collection[int], begin_ns: int, end_ns: int) -> None:
    states = wires.config.drives.unit().database.states
    lost = {states[kind].can_id for kind in kinds}
    _frames_of(wires, End.DEVICE, begin_ns, end_ns, lambda can_id, data: can_id not in lost)


def _reported(wires: VehicleWires, kind: int, begin_ns: int, end_ns: int, report: Callable[[Values], Values]) -> None:
    """Have state frames of a kind report something else, with a counter and a checksum that are right."""
    message = wires.config.drives.unit().database.states[kind]

    def alter(can_id: int, data: memoryview) -> bool:
        if can_id == message.can_id:
            values = message.decode(bytes(data[: message.length]))
            data[: message.length] = message.encode(values | report(values), int(values[COUNTER]))
        return True

    _frames_of(wires, End.DEVICE, begin_ns, end_ns, alter)


def silent_wheel(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """Nothing is heard of one wheel."""
    _lost(wires, [_a_wheel(wires)], begin_ns, end_ns)


def silent_unit(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """Nothing is heard of the unit, though it obeys."""
    _lost(wires, range(STATE_FRAMES), begin_ns, end_ns)


def flooded_bus(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """A babbling node fills the bus; the unit's frames find no room on it, and do not wait for any."""
    buses.flooded(FLOOD)(wires, begin_ns, end_ns)
    unit = wires.world.unit
    report = unit.report

    def in_vain(position: Array, velocity: Array, now_ns: int) -> Frames:
        frames = report(position, velocity, now_ns)
        return frames[:0] if begin_ns <= now_ns < end_ns else frames

    unit.report = in_vain  # type: ignore[method-assign]


def damaged(sender: End) -> Inject:
    """A bit of every frame that one end sends is wrong."""

    def inject(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
        def alter(can_id: int, data: memoryview) -> bool:
            data[2] ^= 1 << int(wires.rng.integers(8))
            return True

        _frames_of(wires, sender, begin_ns, end_ns, alter)

    return inject


def repeated_states(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """The unit sends the same frames again and again."""
    first: dict[int, bytes] = {}

    def alter(can_id: int, data: memoryview) -> bool:
        data[:] = first.setdefault(can_id, bytes(data))
        return True

    _frames_of(wires, End.DEVICE, begin_ns, end_ns, alter)


def driving_fault(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """A driving motor has a fault and gives no torque."""
    _forced(wires, WHEELS + _a_wheel(wires), begin_ns, end_ns)


def steering_fault(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """A steering motor has a fault and gives no torque."""
    _forced(wires, _a_wheel(wires), begin_ns, end_ns)


def _forced(wires: VehicleWires, motor: int, begin_ns: int, end_ns: int) -> None:
    code = int(wires.rng.choice([fault for fault in WheelFault if fault != WheelFault.NONE]))
    wires.once(begin_ns, lambda: wires.world.unit.force_fault(motor, code))
    wires.once(end_ns, lambda: wires.world.unit.force_fault(motor, 0))


def jammed_steering(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """The steering axis of a wheel is stuck."""
    wheel = _a_wheel(wires)
    wires.once(begin_ns, lambda: wires.world.unit.jam(wheel))


def hot_motor(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """The unit reports a motor that is too hot."""
    name = f"MotorTemperature_{WHEEL_NAMES[_a_wheel(wires)]}"
    degrees = wires.config.safety.temperature_max_degc + TOO_HOT_DEGC
    _reported(wires, TEMPERATURES, begin_ns, end_ns, lambda values: {name: degrees})


def low_battery(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """The unit reports a voltage that is too low."""
    voltage = wires.config.safety.voltage_min_v - TOO_LOW_V
    _reported(wires, UNIT_STATE, begin_ns, end_ns, lambda values: {"BatteryVoltage": voltage})


def refusing(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """The unit reports that it brakes, though it is told to drive."""
    _reported(wires, UNIT_STATE, begin_ns, end_ns, lambda values: {"UnitMode": UnitMode.BRAKED})


def fast_wheel(wires: VehicleWires, begin_ns: int, end_ns: int) -> None:
    """The unit reports a wheel that turns too fast."""
    safety = wires.config.safety
    fastest_mps = safety.speed_max_mps + safety.speed_margin_mps + TOO_FAST_MPS
    speed = fastest_mps / wires.config.vehicle.wheel_radius_m
    _reported(wires, _a_wheel(wires), begin_ns, end_ns, lambda values: {"WheelSpeed": speed})
