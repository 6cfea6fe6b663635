# SPDX-License-Identifier: Apache-2.0
"""The operator of a simulated run."""

import itertools

import pytest

from runtime.robots import load_configuration
from runtime.robots.uslgo1.assembly import sizes
from runtime.signals import Motion, OperatorRequest, Path
from sim_bridge.courses import scenario
from sim_bridge.script import PERIOD_NS, WALK_NS, ScriptedOperator, ScriptedPath

CONFIG = load_configuration("uslgo1")
MS = 1_000_000


def day(name, seconds):
    """(time, motion, arm) whenever the operator speaks."""
    port, record, said = ScriptedOperator(scenario(name), CONFIG.posture.rise_s), OperatorRequest("/operator"), []
    for now_ns in range(0, int(seconds * 1e9), 2 * MS):
        if port.read(record, now_ns):
            assert record.stamp_ns == now_ns
            assert not record.reset
            said.append((now_ns, Motion(record.motion), bool(record.arm)))
    return said


@pytest.mark.parametrize("name", ["flat", "stand"])
def test_signs_of_life_come_often_enough_for_the_watchdog(name):
    times = [row[0] for row in day(name, 10.0)]
    assert max(b - a for a, b in itertools.pairwise(times)) <= PERIOD_NS < CONFIG.safety.command_age_max_ns


def test_a_walk_is_armed_stood_and_started():
    changes = []
    for now_ns, motion, armed in day("flat", 5.0):
        assert armed == (motion != Motion.REST)
        if not changes or changes[-1][1] != motion:
            changes.append((now_ns, motion))
    assert [motion for _, motion in changes] == [Motion.REST, Motion.STAND, Motion.WALK]
    assert changes[-1][0] == WALK_NS


def test_without_a_path_the_robot_stands_up_stands_and_sits_down():
    motions = [motion for _, motion, _ in day("stand", 10.0)]
    order = [motion for index, motion in enumerate(motions) if not index or motions[index - 1] != motion]
    assert order == [Motion.REST, Motion.STAND, Motion.SIT]


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
