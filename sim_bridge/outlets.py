# SPDX-License-Identifier: Apache-2.0
"""What the simulator tells in real time: sensors and operator over zenoh, the truth through shared memory."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from runtime.executors.loop_run import InputPort
from runtime.executors.shared_ports import latest_writer
from runtime.records import Record
from runtime.robots import topics
from runtime.tasks import Loop
from sim_bridge.live_world import Source
from sim_bridge.ros_outlet import RosOutlet
from sim_bridge.simulation import Simulation
from sim_bridge.world import World


class SharedOutlet:
    """Writes a record into a shared file of the runtime directory, stamped with the monotonic clock."""

    def __init__(self, directory: Path, record: Record) -> None:
        self._writer = latest_writer(directory, record)

    def publish(self, record: Record, start_ns: int) -> None:
        """Write it."""
        record.stamp_ns += start_ns  # type: ignore[attr-defined]
        self._writer.write(record)


def sources_of(
    simulation: Simulation,
    world: World,
    operator: InputPort,
    path: InputPort,
    loops: Sequence[Loop],
    ros: RosOutlet,
    operator_ros: RosOutlet,
    directory: Path,
) -> list[Source]:
    """Every sensor, and what the operator asks for.

    Args:
        simulation: of the robot.
        world: whose sensors they are.
        operator: port of the operator's events.
        path: port of the path.
        loops: of the robot.
        ros: by which the sensors speak.
        operator_ros: by which the operator speaks; it may be the same.
        directory: the runtime directory.
    """
    records = {record.topic: record.like() for loop in loops for record in loop.port_inputs}
    spoken: dict[str, tuple[InputPort, RosOutlet]] = {
        **{topic: (port, ros) for topic, port in simulation.sensors(world).items()},
        topics.OPERATOR_EVENT: (operator, operator_ros),
        topics.PATH: (path, operator_ros),
    }
    truth = records[topics.TRUTH]
    return [
        *((records[topic], port, outlet) for topic, (port, outlet) in spoken.items()),
        (truth, world, SharedOutlet(directory, truth)),
    ]
