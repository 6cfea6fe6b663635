# SPDX-License-Identifier: Apache-2.0
"""The predictive tracker as a controller: it follows, holds its angle where a solve fails, and knows no stale one."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from runtime.robots import load_configuration
from runtime.robots.predictive_policy import PredictivePolicy
from runtime.tracking.bends import Bend, arc, path_of_bends
from runtime.tracking.drive_tracker_config import SolveMemory
from runtime.tracking.motion import Motion
from runtime.tracking.polyline import Polyline
from runtime.tracking.vehicle_tracker import VehicleTracker
from runtime.wheeled.tracking_mpc import MpcAnswer, TrackingMpc
from sim_bridge.kinematic_vehicle import KinematicPlant, KinematicVehicle

CONFIG = load_configuration("4ws4wd", {"variant.controller": "mpc"})
MPC = CONFIG.controllers.mpc
PERIOD_NS = 20_000_000
LINE = Polyline(np.column_stack((np.arange(0.0, 20.0, 0.3), np.zeros(67))))
SETTLED_S = 8.0
S = path_of_bends((Bend(5.0), arc(60.0), arc(-60.0), Bend(3.0)))
AWAY, BACK = path_of_bends((Bend(4.0), arc(45.0, 4.0))), path_of_bends((arc(-30.0, 4.0), Bend(3.0)))
AT_THE_CUSP = math.sqrt(0.5) * np.array([[1.0, -1.0], [1.0, 1.0]])
CUSPED = np.vstack((AWAY, AWAY[-1] - BACK[1:] @ AT_THE_CUSP.T))


class Driven(NamedTuple):
    """True lateral errors once the vehicle has had time to settle, and what the controller remembers in the end."""

    errors: np.ndarray
    memory: SolveMemory
    arrived: bool


def remembering(angle):
    memory = SolveMemory("/ugv/state/tracker")
    memory.angle[0] = angle
    return memory


def asked_of(memory, motion, path=LINE):
    """Centre angle that is asked for."""
    closest = path.closest(motion.x, motion.y, 0.0, 3.0)
    curvature = PredictivePolicy(MPC, memory)(path, motion, closest).curvature
    return math.atan(0.5 * MPC.wheelbase_m * curvature)


def driven(points, start, limit_s=120.0):
    """Drive along a path, at 0.6 m/s."""
    memory, following = remembering(0.0), CONFIG.tracker.following
    tracker = VehicleTracker(PredictivePolicy(MPC, memory), following, speed=CONFIG.speed_policy)
    tracker.take(points)
    answer = following.answer
    plant = KinematicPlant(answer.wheelbase_m, 0, 0, answer.rate_radps, answer.acceleration_mps2, PERIOD_NS)
    vehicle, errors = KinematicVehicle(plant, start), []
    for tick in range(round(limit_s * 1e9 / PERIOD_NS)):
        now_s = 1.0 + tick * PERIOD_NS * 1e-9
        command = tracker.step(now_s, vehicle.motion, 0.6)
        vehicle.command(command.speed, command.curvature)
        vehicle.advance()
        if now_s > SETTLED_S:
            errors.append(command.lateral_error)
        if command.arrived and vehicle.motion.speed == 0.0:
            break
    return Driven(np.array(errors), memory, command.arrived)


def test_it_follows_an_s_with_the_solver_of_the_configuration():
    assert MPC.solver == "proxqp"
    run = driven(S, (0.0, 0.3, 0.0))
    assert run.arrived
    assert np.abs(run.errors).max() <= 0.02
    assert run.memory.failures[0] == 0


def test_it_goes_on_behind_a_cusp_as_before_it():
    run = driven(CUSPED, (0.0, 0.0, 0.0))
    assert run.arrived
    assert np.abs(run.errors).max() <= 0.03
    assert run.memory.failures[0] == 0


@pytest.mark.parametrize("wheels", [-0.3, 0.0, 0.2])
def test_what_it_asked_for_before_a_cusp_or_another_path_has_no_part_in_what_it_asks_for(wheels):
    motion = Motion(1.0, 0.2, 0.1, 0.6, wheels)
    angles = [asked_of(remembering(angle), motion) for angle in (-0.4, 0.0, 0.4)]
    assert angles[0] == angles[1] == angles[2]
    assert abs(angles[0] - wheels) <= MPC.rate_radps * MPC.step_s + 1e-6


def test_a_mirrored_vehicle_is_asked_for_the_mirrored_angle():
    one, other = Motion(1.0, 0.2, 0.1, 0.6, 0.2), Motion(1.0, -0.2, -0.1, 0.6, -0.2)
    assert asked_of(remembering(0.3), one) == pytest.approx(-asked_of(remembering(0.3), other), abs=1e-6)


@pytest.fixture
def failing(monkeypatch):
    """No solve succeeds."""
    monkeypatch.setattr(TrackingMpc, "solve", lambda *_: MpcAnswer(math.nan, False, 7.0))


def test_where_a_solve_fails_the_last_good_angle_is_held_and_the_failure_counted(failing):
    memory = remembering(0.25)
    for count in (1, 2, 3):
        assert asked_of(memory, Motion(1.0, 0.2, 0.1, 0.6, 0.2)) == pytest.approx(0.25)
        assert (memory.failures[0], memory.residual[0], memory.angle[0]) == (count, 7.0, 0.25)


def test_an_angle_of_before_a_cusp_is_not_held(failing):
    """The wheels are then on the other side: they are steered no further back than within a step, and stay there."""
    memory, reach = remembering(0.3), MPC.rate_radps * MPC.step_s
    for wheels in (-0.3, -0.3 + 0.5 * reach, -0.3 + reach):
        assert asked_of(memory, Motion(1.0, 0.2, 0.1, 0.6, wheels)) == pytest.approx(-0.3 + reach)


def test_an_unknown_angle_of_the_wheels_holds_the_last_one():
    memory, motion = remembering(0.25), Motion(1.0, 0.2, 0.1, 0.6, 0.2)
    assert asked_of(memory, motion._replace(angle=math.nan)) == pytest.approx(0.25)
    assert memory.failures[0] == 1
    assert math.isfinite(asked_of(memory, motion))
    assert memory.failures[0] == 1
