# SPDX-License-Identifier: Apache-2.0
"""The tasks at both ends of a fast loop: frames to joint state, joint command to frames."""

from __future__ import annotations

import numpy as np

from drivers.can_frame import FRAME_SIZE, as_frames
from drivers.joint_group import REJECTED, Counter, JointGroup, Readings
from runtime.records import Record, uint32, uint32_array
from runtime.robots.fresh_frames import NEVER_OLD_NS
from runtime.signals import CanFrames, JointCommand, JointState, Mode, OperatorRequest, SafetyStatus
from runtime.tasks import Task

COUNTERS = len(Counter)
DAMPED_EVERY = 4
"""Of the ticks in which a robot that is off switches its drives on, the first and every so many more: what a drive was
told before it let go is not to come to life again. In each, frames and replies would be more than a bus can carry."""


class CounterMemory(Record):
    """A joint group's counters, indexed by `drivers.joint_group.Counter`."""

    counters = uint32_array(COUNTERS)


class EncodeMemory(CounterMemory):
    """What the encoder must remember."""

    enabling = uint32("", "ticks in a row in which the drives were switched on")


class DecodeTask(Task):
    """Turns the frames that arrived since the last tick into the joint state.

    Args:
        group: the joints; counts in this task's state.
        frames: record read.
        output: record written.
    """

    name = "decode"

    def __init__(self, group: JointGroup, frames: CanFrames, output: JointState) -> None:
        self._group, self._frames, self._output = group, frames, output
        self.reads, self.writes = (frames,), (output,)
        self.state: CounterMemory = CounterMemory("/ugv/state/decode")
        group.counters = self.state.counters
        output.temperature = np.nan
        self._readings = Readings(
            output.position, output.velocity, output.effort, output.temperature, output.error, output.reply_ns
        )

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        frames, output = self._frames, self._output
        if frames.count and frames.stamp_ns == now_ns:
            self._group.decode(as_frames(frames.data), frames.bus, frames.arrival_ns, frames.count, self._readings)
        output.stamp_ns = max(output.reply_ns.tolist())
        output.rejected = sum(self.state.counters[REJECTED].tolist())


class EncodeTask(Task):
    """Turns the safe joint command into frames; switches the drives on while the robot is off or a reset is asked for.

    A fit robot leaves DAMPED with the tick that hears of the reset, and its drives may have been off meanwhile, which
    not every dialect tells: they are switched on in STANDBY, too.

    Args:
        group: the joints; counts in this task's state.
        command, status, operator: records read.
        output: record written.
    """

    name = "encode"

    def __init__(
        self,
        group: JointGroup,
        command: JointCommand,
        status: SafetyStatus,
        operator: OperatorRequest,
        output: CanFrames,
    ) -> None:
        self._group, self._command, self._status, self._operator = group, command, status, operator
        self._output = output
        self.reads, self.writes = (command, status, operator), (output,)
        self.state: EncodeMemory = EncodeMemory("/ugv/state/encode")
        group.counters = self.state.counters
        output.bus[: 2 * group.bus.size] = np.tile(group.bus, 2)

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        group, command, output, memory = self._group, self._command, self._output, self.state
        mode = self._status.mode
        if mode == Mode.OFF or (mode in (Mode.DAMPED, Mode.STANDBY) and self._operator.reset):
            data = group.enable_frames().view(np.uint8)
            if memory.enabling % DAMPED_EVERY == 0:
                data = np.concatenate([group.encode_damping().view(np.uint8), data])
            memory.enabling += 1
        else:
            memory.enabling = 0
            group.encode(
                command.position,
                command.velocity,
                command.effort,
                command.stiffness,
                command.damping,
                command.stamp_ns,
                now_ns,
            )
            data = group.data
        output.stamp_ns, output.count = now_ns, data.size // FRAME_SIZE
        output.data[: data.shape[0]] = data


def damping_frames(group: JointGroup, frames: CanFrames) -> CanFrames:
    """The record filled with damping for every joint: what the drives are to be told last."""
    data = group.encode_damping().view(np.uint8)
    frames.stamp_ns, frames.count = NEVER_OLD_NS, len(group.joints)
    frames.bus[: frames.count] = group.bus
    frames.data[: data.shape[0]] = data
    return frames
