# SPDX-License-Identifier: Apache-2.0
"""tf2_msgs/TFMessage: where the robot is, and what never moves."""

from __future__ import annotations

from runtime.messages.cdr import CdrTemplate
from runtime.signals import BodyState
from runtime.vehicle_signals import VehicleState


class TransformMessage:
    """Encodes /tf: odom -> base_link."""

    def __init__(self, frame: str = "odom", child_frame: str = "base_link") -> None:
        self._template = template = CdrTemplate()
        template.count(1)
        self._stamp = template.header(frame)
        template.string(child_frame)
        translation, rotation = template.float64(3), template.float64(4)
        self._translation, self._rotation = template.view(translation, 3), template.view(rotation, 4)

    def encode(self, body: BodyState | VehicleState) -> bytes:
        """The message of one estimate."""
        self._template.set_stamp(self._stamp, body.stamp_ns)
        self._translation[:] = body.position
        self._rotation[:] = body.orientation
        return self._template.to_bytes()


def encode_fixed(stamp_ns: int, frame: str, child_frame: str) -> bytes:
    """/tf_static of a frame that coincides with another."""
    template = CdrTemplate()
    template.count(1)
    stamp = template.header(frame)
    template.string(child_frame)
    template.float64(3)
    template.view(template.float64(4), 4)[3] = 1.0
    template.set_stamp(stamp, stamp_ns)
    return template.to_bytes()
