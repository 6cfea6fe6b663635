# SPDX-License-Identifier: Apache-2.0
"""Out of DAMPED: not by itself, not by an arm, but by a reset without arm and then a new arm."""

import pytest

from runtime.executors.lockstep import Lockstep
from runtime.robots import load_configuration, topics
from runtime.signals import Mode, Motion, Request
from sim_bridge.courses import scenario
from sim_bridge.faults.buses import bus_down
from sim_bridge.faults.loops import late
from sim_bridge.faults.operator import insert, says
from sim_bridge.faults.sensors import nan_imu
from sim_bridge.faults.wires import Wires
from sim_bridge.run import NullSink, wire

MS = 1_000_000
FAULT_NS, MENDED_NS = 1_600 * MS, 2_400 * MS
SAID = (
    (2_600, Request.ARM, Motion.REST),
    (2_700, Request.RESET, Motion.REST),
    (2_800, Request.DISARM, Motion.REST),
    (2_900, Request.RESET, Motion.REST),
    (3_600, Request.MOTION, Motion.STAND),
    (3_700, Request.ARM, Motion.REST),
    (7_400, Request.MOTION, Motion.WALK),
)
EXPECTED = (
    (2_500, Mode.DAMPED),
    (2_650, Mode.DAMPED),
    (2_750, Mode.DAMPED),
    (2_850, Mode.DAMPED),
    (3_500, Mode.STANDBY),
    (3_650, Mode.STANDBY),
    (3_750, Mode.STANDING),
    (7_300, Mode.STANDING),
    (8_000, Mode.ACTIVE),
)


@pytest.mark.parametrize("fault", [bus_down, nan_imu, late("wbc", 3 * MS), late("mpc", 10**9)])
def test_a_mended_robot_leaves_damped_by_reset_and_arm_and_walks_again(fault):
    config = load_configuration("uslgo1")
    wired = wire(config, scenario("flat"), 0)
    wires = Wires(config, wired.bus, wired.world, wired.inputs, wired.robot.loops)
    for at_ms, request, motion in reversed(SAID):
        insert(wires, topics.OPERATOR_EVENT, at_ms * MS, [says(request, motion)])
    fault(wires, FAULT_NS, MENDED_NS)
    executor = Lockstep(wired.robot.loops, wired.inputs, wired.outputs, wired.world, NullSink(), delays=wires.delay)
    status, gait = (record_of(wired.robot, topic) for topic in (topics.SAFETY, topics.GAIT))
    modes = []

    def look(now_ns):
        for event in wires.events:
            event(now_ns)
        if len(modes) < len(EXPECTED) and now_ns >= EXPECTED[len(modes)][0] * MS:
            modes.append(Mode(status.mode))
        return False

    executor.run(8_100 * MS, look)
    assert modes == [mode for _, mode in EXPECTED]
    assert status.faults == 1
    assert gait.walking
    assert wired.world.clearance > 0.25


def record_of(robot, topic):
    return next(record for loop in robot.loops for record in loop.writes if record.topic == topic)
