# SPDX-License-Identifier: Apache-2.0
"""sensor_msgs/JointState from the joints as measured."""

from __future__ import annotations

from collections.abc import Sequence

from runtime.messages.cdr import CdrTemplate
from runtime.signals import JointState
from runtime.vehicle_signals import WheelState


class JointStateMessage:
    """Encodes /joint_states; the names are in the order of the robot's joints."""

    def __init__(self, names: Sequence[str], frame: str = "base_link") -> None:
        self._template = template = CdrTemplate()
        self._stamp = template.header(frame)
        template.count(len(names))
        for name in names:
            template.string(name)
        slots = []
        for _ in range(3):
            template.count(len(names))
            slots.append(template.float64(len(names)))
        self._position, self._velocity, self._effort = (template.view(slot, len(names)) for slot in slots)

    def encode(self, joints: JointState) -> bytes:
        """The message of one measurement."""
        self._template.set_stamp(self._stamp, joints.stamp_ns)
        self._position[:] = joints.position
        self._velocity[:] = joints.velocity
        self._effort[:] = joints.effort
        return self._template.to_bytes()

    def of_wheels(self, wheels: WheelState) -> bytes:
        """The message of one measurement of a vehicle: steering axes, then wheels.

        How far a wheel has rolled, and how fast an axis is steered, is not measured and stays zero.
        """
        self._template.set_stamp(self._stamp, wheels.stamp_ns)
        axes = len(wheels.steering)
        self._position[:axes], self._velocity[axes:] = wheels.steering, wheels.speed
        return self._template.to_bytes()
