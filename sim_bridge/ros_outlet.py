# SPDX-License-Identifier: Apache-2.0
"""The simulated robot's sensor stack and operator as they speak on a real one: ROS messages over zenoh.

Messages are laid out where the world is stepped, and sent by a thread of their own: sending may take milliseconds.
"""

from __future__ import annotations

import threading
import time
from queue import SimpleQueue
from types import TracebackType

from runtime.link import topics as ros
from runtime.messages.keys import DEFAULT_QUALITY, SENSOR_QUALITY
from runtime.messages.session import RosPublisher, RosSession, session_config
from runtime.records import Record
from runtime.robots.link_config import LinkConfig
from sim_bridge.ros_messages import TYPES, Message, RosMessages

CLOCK_STEP_NS = 5_000_000
ORDERS = (ros.HEARTBEAT, ros.ARM, ros.MOTION, ros.RESET, ros.PATH)
"""What an operator says once must not be said before somebody listens."""


class RosOutlet:
    """A node that publishes what sensors and the operator say.

    Args:
        config: of the link that listens.
        node: its name.

    Raises:
        SessionError: if the link is not there.
    """

    def __init__(self, config: LinkConfig, node: str = "ugv_sim") -> None:
        self._session = RosSession(node, config.domain_id, session_config((), config.listen), config.type_hashes)
        self._publishers = {topic: self._publisher(topic, name) for topic, name in TYPES.items()}
        self._messages = RosMessages(config)
        self._unix_offset_ns = 0
        self._waiting: SimpleQueue[Message | None] = SimpleQueue()
        self._sender = threading.Thread(target=self._send, name="ros")
        self._sender.start()

    def _publisher(self, topic: str, type_name: str) -> RosPublisher:
        return self._session.publisher(topic, type_name, SENSOR_QUALITY if topic == ros.IMU else DEFAULT_QUALITY)

    def publish(self, record: Record, start_ns: int) -> None:
        """Send a record, stamped in unix time."""
        record.stamp_ns += start_ns + self._unix_offset()  # type: ignore[attr-defined]
        for message in self._messages.of(record):
            self._waiting.put(message)

    def heard(self) -> bool:
        """Whether the link has subscribed to what an operator says."""
        return all(self._publishers[topic].heard for topic in ORDERS)

    def _unix_offset(self) -> int:
        """From the monotonic to the unix clock, which may be set at any time; the reading's own noise is left out."""
        offset_ns = time.time_ns() - time.monotonic_ns()
        if abs(offset_ns - self._unix_offset_ns) > CLOCK_STEP_NS:
            self._unix_offset_ns = offset_ns
        return self._unix_offset_ns

    def _send(self) -> None:
        while (message := self._waiting.get()) is not None:
            topic, payload = message
            self._publishers[topic].put(payload)

    def close(self) -> None:
        """Send what waits, and leave."""
        self._waiting.put(None)
        self._sender.join()
        self._session.close()

    def __enter__(self) -> RosOutlet:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
