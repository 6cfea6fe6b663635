# SPDX-License-Identifier: Apache-2.0
"""The operator of a simulated run."""

import itertools

import pytest

from runtime.robots import load_configuration
from runtime.robots.uslgo1.assembly import sizes
from runtime.signals import Motion, OperatorEvent, Path, Request
from sim_bridge.courses import scenario
from sim_bridge.script import ARM_NS, PERIOD_NS, STAND_NS, WALK_NS, ScriptedOperator, ScriptedPath

CONFIG = load_configuration("uslgo1")
MS = 1_000_000


def day(name, seconds):
    """(time, request, motion) whenever the operator speaks."""
    port, record, said = ScriptedOperator(scenario(name), CONFIG.posture.rise_s), OperatorEvent("/event"), []
    for now_ns in range(0, int(seconds * 1e9), 2 * MS):
        if port.read(record, now_ns):
            assert record.stamp_ns == now_ns
            said.append((now_ns, Request(record.request), Motion(record.motion)))
            assert record.sequence == len(said)
    return said


def orders(name, seconds):
    return [row for row in day(name, seconds) if row[1] != Request.LIFE]


@pytest.mark.parametrize("name", ["flat", "stand"])
def test_signs_of_life_come_often_enough_for_the_watchdog(name):
    times = [row[0] for row in day(name, 10.0)]
    assert max(b - a for a, b in itertools.pairwise(times)) <= PERIOD_NS + 2 * MS < CONFIG.authority.lease_ns


def test_a_walk_is_armed_stood_and_started():
    assert orders("flat", 5.0) == [
        (STAND_NS, Request.MOTION, Motion.STAND),
        (ARM_NS, Request.ARM, Motion.REST),
        (WALK_NS, Request.MOTION, Motion.WALK),
    ]


def test_without_a_path_the_robot_stands_up_stands_and_sits_down():
    said = [(request, motion) for _, request, motion in orders("stand", 10.0)]
    assert said == [(Request.MOTION, Motion.STAND), (Request.ARM, Motion.REST), (Request.MOTION, Motion.SIT)]


@pytest.mark.parametrize("name", ["flat", "stand"])
def test_what_is_said_does_not_depend_on_how_often_one_listens(name):
    operator = ScriptedOperator(scenario(name), CONFIG.posture.rise_s)
    pieces = [operator.events(from_ns, from_ns + 7 * MS) for from_ns in range(0, 7000 * MS, 7 * MS)]
    assert [event for piece in pieces for event in piece] == operator.events(0, 7000 * MS)


def test_the_path_is_given_once_and_is_the_scenarios():
    course, record = scenario("circle-6cm"), Path("/path", sizes(CONFIG))
    port = ScriptedPath(course)
    given = [now_ns for now_ns in range(0, 2_000 * MS, 20 * MS) if port.read(record, now_ns)]
    assert given == [WALK_NS]
    count = record.count
    assert count == len(course.waypoints)
    assert record.closed
    assert record.speed == 0.6
    assert list(zip(record.x[:count].tolist(), record.y[:count].tolist(), strict=True)) == list(course.waypoints)


def test_without_a_path_none_is_given():
    port, record = ScriptedPath(scenario("stand")), Path("/path", sizes(CONFIG))
    assert not any(port.read(record, now_ns) for now_ns in range(0, 2_000 * MS, 20 * MS))
