# SPDX-License-Identifier: Apache-2.0
"""What the robot's processes meet at the far end: drives, sensors, and an operator who has the robot stand up.

Arguments: the configuration, the runtime directory. SIGUSR1 makes the operator fall silent for good.
"""

import signal
import sys
from functools import partial
from pathlib import Path

from drivers.device_end import open_device_end
from runtime.executors.companions import SIM, CompanionTicks
from runtime.executors.tick_stream import TickStream
from runtime.recording.service import SOCKET
from runtime.robots import load_configuration, topics
from runtime.robots.uslgo1.assembly import assemble
from sim_bridge.live_world import LiveWorld
from sim_bridge.outlets import SharedOutlet
from sim_bridge.run import chosen_scenario, rehearse, world_of
from sim_bridge.script import ScriptedOperator


class Operator:
    """A scripted one, until told to be silent."""

    def __init__(self, course, rise_s):
        self._script, self._silent = ScriptedOperator(course, rise_s), False
        signal.signal(signal.SIGUSR1, self._fall_silent)

    def _fall_silent(self, *_):
        self._silent = True

    def read(self, record, now_ns):
        return not self._silent and self._script.read(record, now_ns)


def main(configuration: str, directory: Path) -> None:
    config = load_configuration(configuration)
    course = chosen_scenario("stand", config, 0)
    rehearse(config.robot, config.variant.estimator, config.variant.controller)
    stop = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    wires = open_device_end(config.drives.interface, config.drives.channels)
    world = world_of(config, course, course.terrain(0), wires, 0)
    loops = assemble(config).loops
    records = {record.topic: record.like() for loop in loops for record in loop.port_inputs}
    ports = {
        topics.IMU: world.imu,
        topics.LOCALIZATION: world.localization,
        topics.BATTERY: world.battery,
        topics.OPERATOR_EVENT: Operator(course, config.posture.rise_s),
    }
    sources = [(records[topic], port, SharedOutlet(directory, records[topic])) for topic, port in ports.items()]
    ticks = partial(CompanionTicks, loops, SIM, TickStream(directory / SOCKET))
    print("ready", flush=True)
    try:
        LiveWorld(world, wires, config.simulation.time_step_ns, sources, ticks).run(lambda now_ns: bool(stop))
    finally:
        wires.close()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
