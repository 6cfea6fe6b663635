# SPDX-License-Identifier: Apache-2.0
"""The operator of a long walk brings a robot through laps and faults by what it shows."""

from types import SimpleNamespace

import pytest

from runtime.robots import load_configuration, topics
from runtime.robots.uslgo1.assembly import assemble
from runtime.signals import Fault, Mode, Motion, OperatorEvent, Path, Request
from sim_bridge.courses import scenario
from sim_bridge.endurance import RESTED_NS, WATCHED, EnduranceObserver, EnduringOperator
from sim_bridge.observer import SAMPLE_NS
from sim_bridge.script import PERIOD_NS

CONFIG = load_configuration("uslgo1")


class Robot:
    """What the operator sees, and the answers it gives."""

    def __init__(self):
        loops = assemble(CONFIG).loops
        written = {record.topic: record for loop in loops for record in loop.writes}
        self.records = {topic: written[topic] for topic in (*WATCHED, topics.GAIT)}
        self.safety, self.gait = self.records[topics.SAFETY], self.records[topics.GAIT]
        self.command, self.asked = self.records[topics.BODY_COMMAND], self.records[topics.OPERATOR]
        self.operator = EnduringOperator(scenario("circle-6cm"), self.records, lambda: self.gait.balancing)
        self.event = OperatorEvent("/event")
        path = next(r for loop in loops for r in loop.port_inputs if r.topic == topics.PATH)
        self.path: Path = path.like()
        self.now_ns = 0

    def request(self):
        self.now_ns += PERIOD_NS
        self.operator.look(self.now_ns)
        assert self.operator.read(self.event, self.now_ns)
        return Request(self.event.request), Motion(self.event.motion)

    def obey(self):
        """Take up what is asked, as the authority does."""
        request, motion = self.request()
        if request == Request.MOTION:
            self.asked.motion = motion
        elif request in (Request.ARM, Request.DISARM):
            self.asked.arm = request == Request.ARM
        return request

    def given_path(self):
        """Number of waypoints of the path that is given, None for no path."""
        self.now_ns += 10 * PERIOD_NS
        self.operator.look(self.now_ns)
        return self.path.count if self.operator.read_path(self.path, self.now_ns) else None


@pytest.fixture
def robot():
    return Robot()


def stand(robot):
    assert [robot.obey() for _ in range(2)] == [Request.MOTION, Request.ARM]
    assert robot.asked.motion == Motion.STAND
    robot.safety.mode, robot.gait.balancing = Mode.STANDING, True


def walk_off(robot):
    assert robot.given_path() == 0, "the path is withdrawn before it is given again"
    take_path(robot)


def take_path(robot):
    assert robot.given_path() == len(scenario("circle-6cm").waypoints)
    assert robot.path.closed
    robot.command.remaining, robot.safety.mode = 31.0, Mode.ACTIVE
    assert robot.given_path() is None


def test_it_stands_up_is_given_the_path_and_walks(robot):
    stand(robot)
    walk_off(robot)
    assert robot.obey() == Request.MOTION
    assert robot.asked.motion == Motion.WALK
    assert robot.request()[0] == Request.LIFE


def test_lap_follows_on_lap(robot):
    stand(robot)
    walk_off(robot)
    for lap in range(1, 4):
        robot.command.arrived, robot.command.remaining = True, 0.0
        assert robot.given_path() == 0, "the path is withdrawn before it is given again"
        assert robot.operator.laps == lap
        robot.command.arrived = False
        take_path(robot)


def test_after_a_fault_it_lies_is_reset_and_stands_up_again(robot):
    stand(robot)
    walk_off(robot)
    robot.obey()
    robot.safety.mode, robot.safety.fault = Mode.DAMPED, Fault.STALE_IMU
    assert robot.obey() == Request.DISARM
    assert robot.request()[0] == Request.LIFE, "a robot that just fell is left alone"
    robot.now_ns += RESTED_NS
    assert robot.request()[0] == Request.RESET
    robot.safety.mode, robot.asked.motion, robot.command.remaining = Mode.STANDBY, Motion.REST, 0.0
    robot.gait.balancing = False
    stand(robot)
    walk_off(robot)
    assert [fault for _, fault in robot.operator.falls] == ["STALE_IMU"]


@pytest.fixture
def watched(robot):
    """An observer of a robot of which the truth is set, and what it counts after each look."""
    world = SimpleNamespace(tilt=0.0, clearance=0.05)
    simulation = SimpleNamespace(fallen_clearance_m=0.1)
    observer = EnduranceObserver(simulation, world, robot.operator, robot.records, 1e6, lambda *_: None)

    def tumbles(mode, tilt, clearance, balancing=False):
        robot.safety.mode, robot.gait.balancing = mode, balancing
        world.tilt, world.clearance = tilt, clearance
        robot.now_ns += SAMPLE_NS
        assert not observer.over(robot.now_ns)
        return observer.outcome()["tumbles"]

    return tumbles


def test_a_robot_that_rises_from_the_ground_has_not_fallen(watched):
    for clearance in (0.05, 0.11, 0.09, 0.12):
        assert watched(Mode.STANDING, 0.1, clearance) == 0
    assert watched(Mode.STANDING, 0.1, 0.29, balancing=True) == 0


def test_a_robot_that_stood_and_lies_under_power_has_fallen_once(watched):
    watched(Mode.STANDING, 0.0, 0.29, balancing=True)
    assert watched(Mode.ACTIVE, 0.3, 0.05) == 1
    assert watched(Mode.ACTIVE, 0.3, 0.05) == 1


def test_a_robot_that_tips_over_under_power_has_fallen_even_if_it_never_stood(watched):
    watched(Mode.STANDING, 0.5, 0.08)
    assert watched(Mode.STANDING, 1.1, 0.2) == 1
    assert watched(Mode.STANDING, 3.0, 0.05) == 1


def test_what_falls_out_of_damped_is_no_tumble(watched):
    watched(Mode.ACTIVE, 0.0, 0.29, balancing=True)
    assert watched(Mode.DAMPED, 0.3, 0.2) == 0
    assert watched(Mode.DAMPED, 1.2, 0.05) == 0
