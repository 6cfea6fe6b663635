# SPDX-License-Identifier: Apache-2.0
"""Where the simulator's sensors and its operator speak, in real time."""

from __future__ import annotations

from pathlib import Path

from runtime.executors.control import EVENTS
from runtime.executors.loop_run import InputPort
from runtime.executors.shared_ports import event_writer, latest_writer
from runtime.records import Record
from runtime.robots import topics
from runtime.robots.uslgo1.assembly import assemble
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.courses import Scenario
from sim_bridge.live_world import Source
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.script import ScriptedOperator, ScriptedPath


class SharedOutlet:
    """Writes the record into a shared file of the runtime directory."""

    def __init__(self, directory: Path, record: Record) -> None:
        make = event_writer if record.topic in EVENTS else latest_writer
        self._writer = make(directory, record)

    def publish(self, record: Record, start_ns: int) -> None:
        """Write it, stamped with the monotonic clock."""
        record.stamp_ns += start_ns  # type: ignore[attr-defined]
        self._writer.write(record)


def sources_of(world: QuadrupedWorld, course: Scenario, config: Uslgo1Config, directory: Path) -> list[Source]:
    """Every sensor, and the operator."""
    records = {record.topic: record.like() for loop in assemble(config).loops for record in loop.port_inputs}
    ports: dict[str, InputPort] = {
        topics.IMU: world.imu,
        topics.LOCALIZATION: world.localization,
        topics.BATTERY: world.battery,
        topics.TRUTH: world,
        topics.OPERATOR: ScriptedOperator(course, config.posture.rise_s),
        topics.PATH: ScriptedPath(course),
    }
    return [(records[topic], port, SharedOutlet(directory, records[topic])) for topic, port in ports.items()]
