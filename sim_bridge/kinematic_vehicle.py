# SPDX-License-Identifier: Apache-2.0
"""A vehicle without mass or slip, steered at its centre angle: the plant on which methods of tracking are compared.

Its commands take effect late, and its pose is seen late:

    x' = v cos(psi),  y' = v sin(psi),  psi' = 2 v tan(delta) / L,

with the centre angle delta and the speed v following their commands at bounded rates. Over a tick in which the angle
does not change, the motion is the exact arc. What is late about a late pose is the localisation: the encoders of the
wheels and the gyroscope tell of the present.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Annotated

import msgspec
from msgspec import Meta

from runtime.tracking.motion import Motion

Delay = Annotated[int, Meta(ge=0, le=5_000_000_000)]
NS_PER_SECOND = 1_000_000_000


class KinematicPlant(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What such a vehicle is like.

    Attributes:
        wheelbase_m: L.
        command_delay_ns: from a command to the wheels.
        pose_delay_ns: age of the pose that is seen.
        steering_rate_radps: greatest rate of the centre angle; infinite for an angle that is there at once.
        acceleration_mps2: greatest rate of the speed.
        tick_ns: time step; it divides both delays.
    """

    wheelbase_m: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.17
    command_delay_ns: Delay = 0
    pose_delay_ns: Delay = 0
    steering_rate_radps: Annotated[float, Meta(gt=0.0)] = math.radians(20.0)
    acceleration_mps2: Annotated[float, Meta(gt=0.0)] = 2.0
    tick_ns: Annotated[int, Meta(gt=0, le=100_000_000)] = 10_000_000

    def __post_init__(self) -> None:
        """Check the delays against the tick.

        Raises:
            ValueError: if it does not divide them.
        """
        for name in ("command_delay_ns", "pose_delay_ns"):
            if getattr(self, name) % self.tick_ns:
                raise ValueError(f"{name} = {getattr(self, name)} is no multiple of tick_ns = {self.tick_ns}")


class KinematicVehicle:
    """One such vehicle, on its way.

    Args:
        plant: what it is like.
        pose: (x, y, yaw) at first, m and rad; its wheels are straight.
        speed: at which it rolls at first, and has been rolling, m/s.

    Attributes:
        motion: true, now.
    """

    def __init__(self, plant: KinematicPlant, pose: tuple[float, float, float], speed: float = 0.0) -> None:
        self._plant, self._tick_s = plant, plant.tick_ns / NS_PER_SECOND
        self.motion = Motion(*pose, speed)
        self._asked = (speed, 0.0)
        self._on_their_way = deque([self._asked] * (plant.command_delay_ns // plant.tick_ns))
        self._poses = deque([pose], maxlen=plant.pose_delay_ns // plant.tick_ns + 1)

    @property
    def seen(self) -> Motion:
        """The pose of before the pose delay (at first, that of the start), with speed, angle and yaw rate of now."""
        x, y, yaw = self._poses[0]
        return self.motion._replace(x=x, y=y, yaw=yaw)

    def command(self, speed: float, curvature: float) -> None:
        """Ask for a speed, m/s, and a curvature of the centre's path, 1/m, from now on."""
        self._asked = speed, math.atan(0.5 * self._plant.wheelbase_m * curvature)

    def advance(self) -> None:
        """Move on by a tick."""
        self._on_their_way.append(self._asked)
        wanted_speed, wanted_angle = self._on_their_way.popleft()
        plant, tick_s, (x, y, yaw, speed, angle, _) = self._plant, self._tick_s, self.motion
        gained = _bounded(wanted_speed - speed, plant.acceleration_mps2 * tick_s)
        turned = _bounded(wanted_angle - angle, plant.steering_rate_radps * tick_s)
        middle = speed + 0.5 * gained
        curvature = 2.0 * math.tan(angle + 0.5 * turned) / plant.wheelbase_m
        half_turn = 0.5 * curvature * middle * tick_s
        chord = middle * tick_s * (math.sin(half_turn) / half_turn if half_turn else 1.0)
        speed, angle = speed + gained, angle + turned
        self.motion = Motion(
            x + chord * math.cos(yaw + half_turn),
            y + chord * math.sin(yaw + half_turn),
            yaw + 2.0 * half_turn,
            speed,
            angle,
            2.0 * speed * math.tan(angle) / plant.wheelbase_m,
        )
        self._poses.append(self.motion[:3])


def _bounded(change: float, most: float) -> float:
    return min(max(change, -most), most)
