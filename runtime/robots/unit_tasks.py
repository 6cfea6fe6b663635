# SPDX-License-Identifier: Apache-2.0
"""The tasks at both ends of a vehicle's loop: frames of its control unit to wheel state, wheel command to frames."""

from __future__ import annotations

import numpy as np

from drivers.can_frame import as_frames
from drivers.vcu import COMMAND_FRAMES, REJECTED, STATE_FRAMES, UNIT_STATE, Counter, UnitReadings, VehicleUnit
from runtime.records import Record, float64_array, uint8_array, uint32_array
from runtime.robots.fresh_frames import NEVER_OLD_NS
from runtime.signals import Battery, CanFrames
from runtime.tasks import Task
from runtime.vehicle_signals import WheelCommand, WheelState

COUNTERS = len(Counter)


class UnitMemory(Record):
    """What the control unit's decoder remembers; the counters are indexed by `drivers.vcu.Counter`."""

    counters = uint32_array(COUNTERS)
    alive = uint32_array(STATE_FRAMES, "", "one more than the alive counter of each kind's last frame, 0 for none")
    status = uint8_array(2, "", "mode of the unit, and whether it is enabled")
    battery = float64_array(3, "V, A, 1")


class DecodeUnitTask(Task):
    """Turns the frames that arrived since the last tick into the state of wheels and battery.

    Args:
        unit: the control unit; counts in this task's state.
        frames: record read.
        output, battery: records written.
    """

    name = "decode"

    def __init__(self, unit: VehicleUnit, frames: CanFrames, output: WheelState, battery: Battery) -> None:
        self._unit, self._frames, self._output, self._battery = unit, frames, output, battery
        self.reads, self.writes = (frames,), (output, battery)
        self.state: UnitMemory = UnitMemory("/ugv/state/decode")
        unit.counters = self.state.counters
        output.temperature = np.nan
        self._readings = UnitReadings(
            output.steering,
            output.speed,
            output.current,
            output.temperature,
            output.fault,
            output.reply_ns,
            self.state.alive,
            self.state.status,
            self.state.battery,
        )

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        frames, output, memory = self._frames, self._output, self.state
        if frames.count and frames.stamp_ns == now_ns:
            self._unit.decode(as_frames(frames.data), frames.bus, frames.arrival_ns, frames.count, self._readings)
        replies = output.reply_ns.tolist()
        output.stamp_ns = max(replies)
        output.mode, output.enabled = memory.status.tolist()
        counted = memory.counters
        output.corrupt, output.stalled = int(counted[Counter.CHECKSUM]), int(counted[Counter.STALLED])
        output.rejected = sum(counted[REJECTED].tolist())
        battery = self._battery
        battery.stamp_ns = replies[UNIT_STATE]
        battery.voltage, battery.current, battery.charge = memory.battery.tolist()


class SentMemory(Record):
    """The encoder's counters, indexed by `drivers.vcu.Counter`."""

    counters = uint32_array(COUNTERS)


class EncodeUnitTask(Task):
    """Turns the safe wheel command into frames.

    Args:
        unit: the control unit; counts in this task's state.
        command: record read.
        output: record written.
    """

    name = "encode"

    def __init__(self, unit: VehicleUnit, command: WheelCommand, output: CanFrames) -> None:
        self._unit, self._command, self._output = unit, command, output
        self.reads, self.writes = (command,), (output,)
        self.state: SentMemory = SentMemory("/ugv/state/encode")
        unit.counters = self.state.counters
        output.bus[:COMMAND_FRAMES] = unit.bus

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        unit, command, output = self._unit, self._command, self._output
        unit.encode(command.mode, bool(command.enable), command.steering, command.speed, command.stamp_ns, now_ns)
        output.stamp_ns, output.count = now_ns, COMMAND_FRAMES
        output.data[: unit.data.shape[0]] = unit.data


def braking_frames(unit: VehicleUnit, frames: CanFrames) -> CanFrames:
    """The record filled with what the unit is to be told last: to brake, without power for its motors.

    The set is there twice, with two alive counters, of which one at least is not that of the last command.
    """
    sets = [unit.encode_braking(enable=False).tobytes() for _ in range(2)]
    frames.stamp_ns, frames.count = NEVER_OLD_NS, len(sets) * COMMAND_FRAMES
    frames.bus[: frames.count] = unit.bus[0]
    data = np.frombuffer(b"".join(sets), np.uint8)
    frames.data[: data.shape[0]] = data
    return frames
