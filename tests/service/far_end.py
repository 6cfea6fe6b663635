# SPDX-License-Identifier: Apache-2.0
"""What the robot's processes meet at the far end: drives, sensors, and an operator who has the robot stand up.

Arguments: the configuration, the runtime directory. SIGUSR1 makes the operator fall silent for good; SIGUSR2 has it
reset a damped robot and have it stand up again.
"""

import signal
import sys
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path

from drivers.device_end import open_device_end
from runtime.executors.companions import SIM, CompanionTicks
from runtime.executors.linux import run_first
from runtime.executors.tick_stream import RECORDER_SOCKET, TickStream
from runtime.link.loop import link_loop
from runtime.robots import load_configuration
from runtime.robots.uslgo1.assembly import assemble
from runtime.signals import Motion, Request
from sim_bridge.live_world import LiveWorld
from sim_bridge.outlets import sources_of
from sim_bridge.ros_outlet import RosOutlet
from sim_bridge.run import rehearse
from sim_bridge.script import PRIORITY, SOURCE, ScriptedOperator, ScriptedPath
from sim_bridge.simulation import simulation_of

STANDING_S = 3600.0


SECOND_NS = 1_000_000_000
RECOVERY = (
    (0, Request.DISARM, Motion.REST),
    (SECOND_NS, Request.RESET, Motion.REST),
    (SECOND_NS + 200_000_000, Request.MOTION, Motion.STAND),
    (SECOND_NS + 300_000_000, Request.ARM, Motion.STAND),
)
FIRST_SEQUENCE = 1 << 32
"""Beyond those of the script."""


class Operator:
    """A scripted one, until told to be silent, or to recover the robot."""

    def __init__(self, course, rise_s):
        self._script, self._silent = ScriptedOperator(course, rise_s), False
        self._asked, self._orders, self._sequence = False, [], FIRST_SEQUENCE
        signal.signal(signal.SIGUSR1, self._fall_silent)
        signal.signal(signal.SIGUSR2, self._recover)

    def _fall_silent(self, *_):
        self._silent = True

    def _recover(self, *_):
        self._asked = True

    def read(self, record, now_ns):
        if self._silent:
            return False
        if self._asked and not self._orders:
            self._orders = [(now_ns + after_ns, request, motion) for after_ns, request, motion in RECOVERY]
        self._asked = False
        if not self._orders or now_ns < self._orders[0][0]:
            return self._script.read(record, now_ns)
        _, record.request, record.motion = self._orders.pop(0)
        self._sequence += 1
        record.stamp_ns, record.sequence, record.source, record.priority = now_ns, self._sequence, SOURCE, PRIORITY
        return True


def main(configuration: str, directory: Path) -> None:
    config = load_configuration(configuration)
    simulation = simulation_of(config)
    course = replace(simulation.scenario("stand", 0), stand_s=STANDING_S)
    rehearse(config.robot, config.variant.estimator, config.variant.controller)
    stop = []
    signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
    run_first(SIM.priority)
    with ExitStack() as stack:
        wires = stack.enter_context(closing(open_device_end(config.drives.interface, config.drives.channels)))
        ros = stack.enter_context(RosOutlet(config.link))
        world = simulation.world(course, course.terrain(0), wires, 0)
        operator = Operator(course, config.posture.rise_s)
        loops = assemble(config).loops
        sources = sources_of(simulation, world, operator, ScriptedPath(course), loops, ros, ros, directory)
        loops = (*loops, link_loop(config.link, config.realtime.link_priority))
        ticks = partial(CompanionTicks, loops, SIM, TickStream(directory / RECORDER_SOCKET))
        print("ready", flush=True)
        live = LiveWorld(world, wires, config.simulation.time_step_ns, sources, ticks, ros.heard)
        live.run(lambda now_ns: bool(stop))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
