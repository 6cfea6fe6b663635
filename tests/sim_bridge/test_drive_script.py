# SPDX-License-Identifier: Apache-2.0
"""Who drives by velocity asks for it until the vehicle would come to a stand where it should, and lets go at once."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from runtime.robots import load_configuration, topics
from runtime.signals import OperatorEvent, OperatorRequest, Request, Steering
from runtime.vehicle_signals import TwistCommand
from sim_bridge.drive_script import BEGIN_NS, ScriptedDriver
from sim_bridge.script import PERIOD_NS
from sim_bridge.simulation import simulation_of
from sim_bridge.vehicle_courses import scenario

TICK_NS, LEAD_S = 10_000_000, 0.2
SIMULATION = simulation_of(load_configuration("4ws4wd"))


def asked(name, moved):
    """Times and velocities that the driver asks for, of a vehicle that moves as a function of time says."""
    world = SimpleNamespace(position=np.zeros(3), yaw=0.0)
    driver, record, requests = ScriptedDriver(scenario(name), world, LEAD_S), OperatorEvent("/event"), []
    for tick in range(2500):
        world.position[:2], world.yaw = moved(tick * 0.01)
        if driver.read(record, tick * TICK_NS) and record.request == Request.VELOCITY:
            requests.append((tick * TICK_NS, tuple(record.velocity.tolist())))
    return requests


@pytest.mark.parametrize(
    ("name", "moved", "at_s"),
    [
        ("crab", lambda t: ((0.0, 0.4 * t), 0.0), 4.0 / 0.4 - LEAD_S),
        ("reverse", lambda t: ((-0.5 * t, 0.0), 0.0), 5.0 / 0.5 - LEAD_S),
        ("spin", lambda t: ((0.0, 0.0), math.remainder(0.5 * t, 2.0 * math.pi)), 4.0 * math.pi - LEAD_S),
    ],
)
def test_he_lets_go_at_once_where_the_vehicle_will_come_to_a_stand(name, moved, at_s):
    requests, velocity = asked(name, moved), scenario(name).velocity
    given = [at_ns for at_ns, wanted in requests if wanted == velocity]
    let_go = [at_ns for at_ns, wanted in requests if wanted == (0.0, 0.0, 0.0)]
    assert BEGIN_NS <= given[0] < BEGIN_NS + PERIOD_NS
    assert given[-1] < let_go[0]
    assert let_go[0] * 1e-9 == pytest.approx(at_s, abs=2e-9 * TICK_NS)
    assert len(given) + len(let_go) == len(requests)


def test_a_drive_is_over_when_the_vehicle_stands_after_it_was_let_go():
    request, twist = OperatorRequest(topics.OPERATOR), TwistCommand(topics.BODY_COMMAND)
    over = SIMULATION.finished(scenario("crab"), {topics.OPERATOR: request, topics.BODY_COMMAND: twist})
    assert not over()
    request.steering, request.velocity = Steering.VELOCITY, (0.0, 0.4, 0.0)
    assert not over()
    request.velocity, twist.velocity = 0.0, (0.0, 0.1)
    assert not over()
    twist.velocity = 0.0
    assert over()


def test_a_path_is_done_when_the_vehicle_stands_where_it_ends():
    request, twist = OperatorRequest(topics.OPERATOR), TwistCommand(topics.BODY_COMMAND)
    over = SIMULATION.finished(scenario("straight"), {topics.OPERATOR: request, topics.BODY_COMMAND: twist})
    assert not over()
    twist.arrived, twist.velocity = True, (0.05, 0.0)
    assert not over()
    twist.velocity = 0.0
    assert over()
