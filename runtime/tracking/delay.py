# SPDX-License-Identifier: Apache-2.0
"""Where the vehicle will be when a command takes effect: its pose, moved on by what it was told and has not done yet."""

from __future__ import annotations

import math

from runtime.records import Record, float64_array, uint32

CAPACITY = 64
"""Commands that are remembered."""

PlanarPose = tuple[float, float, float]


class CommandMemory(Record):
    """The last commands, the newest first: forward and lateral, m/s, and yaw rate, rad/s."""

    told = uint32("", "commands that are remembered")
    told_forward = float64_array(CAPACITY, "m/s")
    told_lateral = float64_array(CAPACITY, "m/s")
    told_yaw_rate = float64_array(CAPACITY, "rad/s")


def remember(memory: CommandMemory, forward: float, lateral: float, yaw_rate: float) -> None:
    """Put a command before all others; the oldest is forgotten."""
    for kept, newest in (
        (memory.told_forward, forward),
        (memory.told_lateral, lateral),
        (memory.told_yaw_rate, yaw_rate),
    ):
        kept[1:] = kept[:-1].copy()
        kept[0] = newest
    memory.told = min(memory.told + 1, CAPACITY)


def after_delay(pose: PlanarPose, memory: CommandMemory, delay_s: float, period_s: float) -> PlanarPose:
    """The pose when a command that is given now takes effect.

    Args:
        pose: x, y and yaw now.
        memory: commands, one a period.
        delay_s: from a command to its effect, at most `CAPACITY` periods.
        period_s: between commands.
    """
    periods = delay_s / period_s
    whole = min(math.ceil(periods), memory.told)
    commands = (
        memory.told_forward[:whole].tolist(),
        memory.told_lateral[:whole].tolist(),
        memory.told_yaw_rate[:whole].tolist(),
    )
    for age in reversed(range(whole)):
        forward, lateral, yaw_rate = (values[age] for values in commands)
        pose = moved(pose, forward, lateral, yaw_rate, min(periods - age, 1.0) * period_s)
    return pose


def moved(pose: PlanarPose, forward: float, lateral: float, yaw_rate: float, seconds: float) -> PlanarPose:
    """A pose after a time at constant velocities in base: an arc, taken along its chord."""
    x, y, yaw = pose
    half = 0.5 * yaw_rate * seconds
    chord = seconds * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    cosine, sine = math.cos(yaw + half), math.sin(yaw + half)
    return (
        x + chord * (forward * cosine - lateral * sine),
        y + chord * (forward * sine + lateral * cosine),
        yaw + yaw_rate * seconds,
    )
