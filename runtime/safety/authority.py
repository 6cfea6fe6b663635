# SPDX-License-Identifier: Apache-2.0
"""Who may command the robot: one holder of a lease at a time, and anyone to stop it.

A sender takes the lease with any request but a release or an emergency stop, if it is free or held with lower priority:
the highest that its holder has shown since it took it. It keeps it by signs of life, which every event is. Whoever the
lease passes to finds a robot that is asked to stand, and must ask it to walk anew. All requests of others are refused
and counted, except the emergency stop, which is latched until a holder resets it with the arm withdrawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Annotated

import msgspec
import numpy as np

from runtime.compiled import compiled, table_of
from runtime.records import Record, boolean, float64_array, int64, uint8, uint32
from runtime.signals import Motion, OperatorEvent, OperatorRequest, Request, Steering
from runtime.tasks import Task

Age = Annotated[int, msgspec.Meta(ge=10_000_000, le=5_000_000_000)]

_LAST_REQUEST, _LAST_MOTION = max(Request).value, max(Motion).value


class AuthorityConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bounds of the authority to command.

    Attributes:
        lease_ns: the lease is lost without a sign of life for longer.
        event_age_max_ns: an older event (or one so far ahead) is rejected, unless it is an emergency stop.
        reset_ns: how long a reset asks for leaving DAMPED.
    """

    lease_ns: Age = 500_000_000
    event_age_max_ns: Age = 500_000_000
    reset_ns: Age = 500_000_000


class AuthorityMemory(Record):
    """What the authority must remember: all that it has granted, and which event it saw last."""

    held = boolean()
    arm = boolean()
    emergency_stop = boolean()
    priority = uint8("", "highest that the holder has shown")
    motion = uint8()
    steering = uint8()
    holder = int64()
    life_ns = int64("ns", "last sign of life of the holder")
    reset_ns = int64("ns", "when a reset was asked for, 0 if none is")
    velocity = float64_array(3, "m/s, m/s, rad/s")
    velocity_ns = int64("ns")
    event_stamp_ns = int64("ns", "of the last event")
    event_sequence = int64("", "of the last event")
    leases = uint32()
    refused = uint32()
    malformed = uint32()


class AuthorityTask(Task):
    """Grants the lease, and says what its holder asks for.

    Args:
        config: bounds.
        event: record read, one event a tick.
        output: record written.
    """

    name = "authority"

    def __init__(self, config: AuthorityConfig, event: OperatorEvent, output: OperatorRequest) -> None:
        self.reads, self.writes = (event,), (output,)
        self.state: AuthorityMemory = AuthorityMemory("/ugv/state/authority")
        self._grant = partial(_grant, table_of(config), event.table, self.state.table, output.table)

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        self._grant(now_ns)


@compiled
def _grant(
    configs: Sequence[AuthorityConfig],
    events: Sequence[OperatorEvent],
    memories: Sequence[AuthorityMemory],
    outputs: Sequence[OperatorRequest],
    now_ns: int,
) -> None:
    """Let a lease run out, take up a new event, and say what is asked for."""
    config, event, memory = configs[0], events[0], memories[0]
    if memory.held and now_ns - memory.life_ns > config.lease_ns:
        _take_away(memory)
    if event.stamp_ns != memory.event_stamp_ns or event.sequence != memory.event_sequence:
        memory.event_stamp_ns, memory.event_sequence = event.stamp_ns, event.sequence
        if not is_well_formed(event, now_ns, config.event_age_max_ns):
            memory.malformed += 1
        elif event.request == Request.EMERGENCY_STOP:
            memory.emergency_stop = True
        elif not _may_command(memory, event) or not _obey(memory, event, now_ns):
            memory.refused += 1
    if memory.reset_ns != 0 and (memory.arm or now_ns - memory.reset_ns > config.reset_ns):
        memory.reset_ns = 0
    _publish(memory, outputs[0])


@compiled
def is_well_formed(event: OperatorEvent, now_ns: int, age_max_ns: int) -> bool:
    """Whether an event can be understood, and is of the present; an emergency stop may be of any age."""
    if event.request == Request.EMERGENCY_STOP:
        return True
    known = event.request <= _LAST_REQUEST and event.motion <= _LAST_MOTION
    return bool(known and np.isfinite(event.velocity).all() and abs(now_ns - event.stamp_ns) <= age_max_ns)


@compiled
def _may_command(memory: AuthorityMemory, event: OperatorEvent) -> bool:
    """Whether the sender holds the lease, be it by this event."""
    if memory.held and event.source == memory.holder:
        memory.priority = max(memory.priority, event.priority)
        return True
    if (memory.held and event.priority <= memory.priority) or event.request == Request.RELEASE:
        return False
    _take_away(memory)
    memory.held, memory.holder, memory.priority = True, event.source, event.priority
    memory.leases += 1
    return True


@compiled
def _take_away(memory: AuthorityMemory) -> None:
    """Nobody holds the lease, and a robot that walked is to stand; it stays armed, since it needs its torque."""
    memory.held, memory.steering = False, Steering.PATH.value
    memory.velocity[:] = 0.0
    memory.velocity_ns, memory.reset_ns = 0, 0
    if memory.motion == Motion.WALK:
        memory.motion = Motion.STAND.value


@compiled
def _obey(memory: AuthorityMemory, event: OperatorEvent, now_ns: int) -> bool:
    """Take up a request of the holder; false if the robot is in no state for it."""
    memory.life_ns = min(event.stamp_ns, now_ns)
    if event.request == Request.RELEASE:
        _take_away(memory)
    elif event.request == Request.ARM:
        if memory.emergency_stop:
            return False
        memory.arm = True
    elif event.request == Request.DISARM:
        memory.arm = False
    elif event.request == Request.MOTION:
        if event.motion != memory.motion:
            memory.motion, memory.steering = event.motion, Steering.PATH.value
    elif event.request == Request.VELOCITY:
        memory.steering, memory.velocity_ns = Steering.VELOCITY.value, event.stamp_ns
        memory.velocity[:] = event.velocity
    elif event.request == Request.RESET:
        if memory.arm:
            return False
        memory.emergency_stop, memory.reset_ns, memory.motion = False, now_ns, Motion.REST.value
    return True


@compiled
def _publish(memory: AuthorityMemory, output: OperatorRequest) -> None:
    output.stamp_ns, output.motion, output.arm = memory.life_ns, memory.motion, memory.arm
    output.reset, output.emergency_stop = memory.reset_ns > 0, memory.emergency_stop
    output.held, output.holder, output.priority = memory.held, memory.holder, memory.priority
    output.steering, output.velocity_ns = memory.steering, memory.velocity_ns
    output.velocity[:] = memory.velocity
    output.leases, output.refused, output.malformed = memory.leases, memory.refused, memory.malformed
