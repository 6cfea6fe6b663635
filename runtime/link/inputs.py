# SPDX-License-Identifier: Apache-2.0
"""Every topic that the link takes, and where it goes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path as FilePath
from typing import Any

from runtime.executors.shared_memory import SharedWriter
from runtime.executors.shared_ports import event_writer, latest_writer
from runtime.link import topics as ros
from runtime.link.clocks import Instant, instant
from runtime.link.event_outlet import EventOutlet
from runtime.link.operator_inputs import RequestUse, VelocityUse
from runtime.link.path_input import PathUse
from runtime.link.rate_gate import RateGate
from runtime.link.senders import SenderBook
from runtime.link.sensor_inputs import BatteryUse, ImuUse, PoseUse, watch_scan
from runtime.link.setup import LinkSetup
from runtime.link.tally import Tally
from runtime.link.topic_input import TopicInput, never
from runtime.messages import definitions, standard
from runtime.messages.battery import decode_battery_state
from runtime.messages.imu import decode_imu
from runtime.messages.keys import DEFAULT_QUALITY, SENSOR_QUALITY
from runtime.messages.path import decode_path
from runtime.messages.pose import decode_pose_stamped, decode_pose_with_covariance_stamped
from runtime.messages.scan import decode_laser_scan, decode_point_cloud
from runtime.messages.session import Session
from runtime.messages.twist import decode_twist, decode_twist_stamped
from runtime.records import Record
from runtime.robots import topics
from runtime.robots.link_config import LinkConfig
from runtime.signals import Battery, Imu, OperatorEvent, Pose, Request
from runtime.signals import Path as PathRecord
from runtime.tasks import Loop

_BURST_S = 0.1
IsStale = Callable[[Any, int], bool]
"""Whether a message that was late by so many ns is not used any more."""
_NS_PER_SECOND = 1_000_000_000


class Inputs:
    """Owns the files that the control loops read, and the topics that fill them.

    Args:
        config: what is accepted.
        records: a record of each topic's layout, by topic.
        directory: of the files.
        taken_hz: how many operator's requests a second the control loop takes.
        clock: gives the present.

    Attributes:
        tally: what became of the messages.
        outlet: where requests wait.
        senders: whose the publishers are.

    Raises:
        SharedMemoryError: if the files cannot be made or another link writes to them.
    """

    def __init__(
        self,
        config: LinkConfig,
        records: Mapping[str, Record],
        directory: FilePath,
        taken_hz: float,
        clock: Callable[[], Instant] = instant,
    ) -> None:
        self.tally, self.senders, self._clock = Tally(), SenderBook(), clock
        self._files = ExitStack()
        self._topics: list[tuple[str, str, TopicInput[Any]]] = []
        try:
            self._connect(config, records, directory, taken_hz)
        except BaseException:
            self._files.close()
            raise

    def _connect(self, config: LinkConfig, records: Mapping[str, Record], directory: FilePath, taken_hz: float) -> None:
        def file(make: Callable[[FilePath, Record], SharedWriter], topic: str) -> Any:
            writer = make(directory, records[topic])
            self._files.callback(writer.close)
            return records[topic], writer.write

        record, write = file(event_writer, topics.OPERATOR_EVENT)
        _, keep_stop = file(latest_writer, topics.OPERATOR_STOP)

        def hand_over(event: OperatorEvent) -> None:
            if event.request in (Request.EMERGENCY_STOP, Request.RESET):
                keep_stop(event)
            write(event)

        self.outlet = EventOutlet(record, hand_over, taken_hz)
        poses = {
            "PoseStamped": (definitions.POSE_STAMPED, decode_pose_stamped),
            "PoseWithCovarianceStamped": (
                definitions.POSE_WITH_COVARIANCE_STAMPED,
                decode_pose_with_covariance_stamped,
            ),
        }
        imu = ImuUse(config, *file(latest_writer, topics.IMU))
        pose = PoseUse(config, *file(latest_writer, topics.LOCALIZATION))
        battery = BatteryUse(config, *file(latest_writer, topics.BATTERY))
        path = PathUse(config, *file(latest_writer, topics.PATH))
        capacity = records[topics.PATH].sizes["path"]
        self._add(ros.IMU, definitions.IMU, decode_imu, imu, config.imu_rate_max_hz)
        self._add(ros.LOCALIZATION, *poses[config.localization_type], pose, config.localization_rate_max_hz)
        self._add(ros.BATTERY, definitions.BATTERY_STATE, decode_battery_state, battery, config.battery_rate_max_hz)
        self._add(ros.SCAN, definitions.LASER_SCAN, decode_laser_scan, watch_scan, config.scan_rate_max_hz)
        self._add(ros.POINTS, definitions.POINT_CLOUD2, decode_point_cloud, watch_scan, config.scan_rate_max_hz)
        decode = partial(decode_path, capacity=capacity + 1)  # a closed path ends with its first point
        self._add(ros.PATH, definitions.PATH, decode, path, config.path_rate_max_hz)
        rate_hz = config.operator_rate_max_hz

        def late(message: Any, late_ns: int) -> bool:
            return late_ns > config.request_late_max_ns

        self._add(ros.PATH_SPEED, definitions.FLOAT64, standard.decode_float64, path.set_speed, rate_hz)
        for topic, priority in ((ros.CMD_VEL, config.cmd_vel_priority), (ros.TELEOP, config.teleop_priority)):
            for name, decoder in (
                (definitions.TWIST, decode_twist),
                (definitions.TWIST_STAMPED, decode_twist_stamped),
            ):
                self._add(topic, name, decoder, VelocityUse(config, self.outlet.offer, priority), rate_hz, late)
        self._add_requests(RequestUse(self.outlet.offer, config.operator_priority), rate_hz, late)

    def _add_requests(self, use: RequestUse, rate_hz: float, late: IsStale) -> None:
        """What withdraws something is used however late it is."""

        def late_arm(armed: bool, late_ns: int) -> bool:
            return armed and late(armed, late_ns)

        self._add(ros.E_STOP, definitions.BOOL, standard.decode_bool, use.emergency_stop, None)
        self._add(ros.ARM, definitions.BOOL, standard.decode_bool, use.arm, rate_hz, late_arm)
        self._add(ros.MOTION, definitions.STRING, standard.decode_string, use.motion, rate_hz, late)
        self._add(ros.RESET, definitions.EMPTY, standard.decode_empty, use.plain(Request.RESET), rate_hz, late)
        self._add(ros.HEARTBEAT, definitions.EMPTY, standard.decode_empty, use.plain(Request.LIFE), rate_hz, late)
        self._add(ros.RELEASE, definitions.EMPTY, standard.decode_empty, use.plain(Request.RELEASE), rate_hz)

    def _add(
        self, topic: str, type_name: str, decode: Any, use: Any, rate_hz: float | None, is_stale: IsStale = never
    ) -> None:
        gate = None if rate_hz is None else partial(RateGate, rate_hz, max(1, round(rate_hz * _BURST_S)))
        taker: TopicInput[Any] = TopicInput(topic, decode, use, gate, self.tally, self.senders, self._clock, is_stale)
        self._topics.append((topic, type_name, taker))

    def subscribe(self, session: Session) -> None:
        """Begin to take messages."""
        session.watch_publishers(self.senders.note)
        for topic, type_name, taker in self._topics:
            quality = SENSOR_QUALITY if topic in (ros.IMU, ros.SCAN, ros.POINTS) else DEFAULT_QUALITY
            session.subscribe(topic, type_name, taker, quality)

    def close(self) -> None:
        """Let the files go, which stay for their readers; the session must be closed by then."""
        self._files.close()


def inputs_of(setup: LinkSetup, directory: FilePath, clock: Callable[[], Instant] = instant) -> Inputs:
    """The inputs of a robot's link; arguments and errors as of `Inputs`."""
    fastest_ns = min(loop.period_ns for loop in setup.loops)
    return Inputs(setup.config, records_of(setup.loops), directory, _NS_PER_SECOND / fastest_ns, clock)


def records_of(loops: Sequence[Loop]) -> dict[str, Record]:
    """A record of each input's layout."""
    measured = (Imu(topics.IMU), Pose(topics.LOCALIZATION), Battery(topics.BATTERY))
    path = next(r for loop in loops for r in loop.port_inputs if isinstance(r, PathRecord))
    asked = (OperatorEvent(topics.OPERATOR_EVENT), OperatorEvent(topics.OPERATOR_STOP))
    return {record.topic: record for record in (*measured, path.like(), *asked)}
