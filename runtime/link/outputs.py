# SPDX-License-Identifier: Apache-2.0
"""Every topic that the link sends, at bounded rates, from what the control loops last said."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

from runtime.link import topics as ros
from runtime.link.clocks import Instant
from runtime.link.control_monitor import ControlMonitor
from runtime.link.diagnosis import Diagnosis
from runtime.link.rate_gate import RateGate
from runtime.messages import definitions
from runtime.messages.battery import BatteryMessage
from runtime.messages.diagnostics import encode_diagnostics
from runtime.messages.joint_state import JointStateMessage
from runtime.messages.keys import TRANSIENT_LOCAL_QUALITY
from runtime.messages.odometry import OdometryMessage
from runtime.messages.session import Publisher, Session
from runtime.messages.standard import encode_string
from runtime.messages.transform import TransformMessage, encode_fixed
from runtime.records import Record
from runtime.robots import topics
from runtime.robots.link_config import LinkConfig
from runtime.signals import BodyState

_DIGITS = 4
_BURST = 2
"""So that a tick of the link that comes a little early still counts."""


class SignalOutput:
    """A topic that is made of one signal.

    Args:
        publisher: of the topic.
        hz: messages a second, at most.
        source: the signal's topic.
        encode: makes the message.
    """

    def __init__(self, publisher: Publisher, hz: int, source: str, encode: Callable[[Any], bytes]) -> None:
        self._publisher, self._gate = publisher, RateGate(hz, _BURST)
        self._source, self._encode = source, encode
        self._sent_ns = -1

    def publish(self, monitor: ControlMonitor, now: Instant) -> None:
        """Send the newest record if it was not sent yet and it is time."""
        record: Any = monitor.newest(self._source, Record)
        if record is None or record.stamp_ns == self._sent_ns or not self._gate.passes(now.monotonic_ns):
            return
        self._sent_ns = record.stamp_ns
        record.stamp_ns = max(0, now.unix(record.stamp_ns))
        self._publisher.put(self._encode(record))


class Outputs:
    """Publishes from one thread, which never waits for a subscriber.

    Args:
        session: to publish in.
        config: rates and frames.
        robot: its name.
        joint_names: in the order of the robot's joints.
        description: of the robot, as URDF.
        monitor: what the loops do.
        diagnosis: what is said of it.
        now: the present.
    """

    def __init__(
        self,
        session: Session,
        config: LinkConfig,
        robot: str,
        joint_names: Sequence[str],
        description: str,
        monitor: ControlMonitor,
        diagnosis: Diagnosis,
        now: Instant,
    ) -> None:
        self._robot, self._monitor, self._diagnosis = robot, monitor, diagnosis
        odom, base = config.odom_frame, config.base_frame
        joints, battery = JointStateMessage(joint_names, base), BatteryMessage(base).encode
        odometry, transform = OdometryMessage(odom, base).encode, TransformMessage(odom, base).encode
        rows: tuple[tuple[str, str, int, str, Callable[[Any], bytes]], ...] = (
            (ros.JOINT_STATES, definitions.JOINT_STATE, config.joint_states_hz, topics.JOINT_STATE, joints.encode),
            (
                ros.JOINT_STATES,
                definitions.JOINT_STATE,
                config.joint_states_hz,
                topics.WHEEL_STATE,
                joints.of_wheels,
            ),
            (ros.ODOMETRY, definitions.ODOMETRY, config.odometry_hz, topics.BODY_STATE, odometry),
            (ros.TF, definitions.TF, config.odometry_hz, topics.BODY_STATE, transform),
            (ros.BATTERY_STATE, definitions.BATTERY_STATE, config.battery_hz, topics.BATTERY, battery),
        )
        self._signals = [
            SignalOutput(session.publisher(topic, name), hz, source, encode)
            for topic, name, hz, source, encode in rows
            if monitor.knows(source)
        ]
        self._diagnostics = session.publisher(ros.DIAGNOSTICS, definitions.DIAGNOSTIC_ARRAY)
        self._state = session.publisher(ros.STATE, definitions.STRING)
        self._loops = session.publisher(ros.LOOPS, definitions.STRING)
        self._state_gate = RateGate(config.state_hz, _BURST)
        self._diagnostics_gate = RateGate(config.diagnostics_hz, _BURST)
        self._told = ("", "")
        kept = TRANSIENT_LOCAL_QUALITY
        session.publisher(ros.TF_STATIC, definitions.TF, kept).put(encode_fixed(now.unix_ns, base, config.imu_frame))
        session.publisher(ros.ROBOT_DESCRIPTION, definitions.STRING, kept).put(encode_string(description))

    def publish(self, now: Instant, link: Callable[[], dict[str, object]]) -> None:
        """Send what is due.

        Args:
            now: the present.
            link: gives figures of the link itself.
        """
        for signal in self._signals:
            signal.publish(self._monitor, now)
        state = self._diagnosis.state(now.monotonic_ns)
        if self._state_gate.passes(now.monotonic_ns) or state != self._told:
            self._state.put(encode_string(json.dumps(self._summary(state))))
        if self._diagnostics_gate.passes(now.monotonic_ns) or state != self._told:
            statuses = self._diagnosis.statuses(now.monotonic_ns, link())
            self._diagnostics.put(encode_diagnostics(now.unix_ns, statuses, self._robot))
            loops = {name: loop.figures() for name, loop in self._monitor.loops.items()}
            self._loops.put(encode_string(json.dumps(loops)))
        self._told = state

    def _summary(self, state: tuple[str, str]) -> dict[str, object]:
        """The robot's state in words and a few figures."""
        summary: dict[str, object] = {"robot": self._robot, "mode": state[0], "faults": state[1]}
        body: Any = self._monitor.newest(topics.BODY_STATE, Record)
        if body is not None:
            summary["position"] = body.position.round(_DIGITS).tolist()
            summary["orientation"] = body.orientation.round(_DIGITS).tolist()
            summary["velocity"] = body.linear_velocity.round(_DIGITS).tolist()
        if isinstance(body, BodyState):
            summary["height"] = round(body.height, _DIGITS)
        command: Any = self._monitor.newest(topics.BODY_COMMAND, Record)
        if command is not None:
            summary["progress"] = round(command.progress, _DIGITS)
            summary["lateral_error"] = round(command.lateral_error, _DIGITS)
            summary["arrived"] = bool(command.arrived)
        return summary
