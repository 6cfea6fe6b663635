# SPDX-License-Identifier: Apache-2.0
"""The vehicle's tracking task runs a path once, stops when it is to, follows a velocity, and restarts as it was."""

import math

import numpy as np
import pytest

from runtime.models.vehicle import VehicleGeometry
from runtime.signals import Mode, Motion, OperatorRequest, Path, SafetyStatus, Steering
from runtime.tracking.bends import figure_eight
from runtime.tracking.curvature_look_ahead import CurvatureLookAhead
from runtime.tracking.drive_tracker import DriveTracker, manner_of
from runtime.tracking.drive_tracker_config import DriveTrackerConfig
from runtime.tracking.paths import straight
from runtime.tracking.velocity import PlanarVelocity
from runtime.tracking.waypoint_pursuit import WaypointPursuit
from runtime.vehicle_signals import CommandDelay, SteeringMode, TwistCommand, VehicleState, WheelState

PERIOD_S = 0.02
SIZES = {"path": 512, "wheel": 4, "axle_drive": 8, "unit_frame": 6}
CONFIG = DriveTrackerConfig()
PATH_AGE_MAX_NS = 60_000_000_000


class Vehicle:
    """The task, and a vehicle that moves as it is told at once."""

    def __init__(self, aside_m=0.0):
        self.path, self.body, self.wheels = Path("/path", SIZES), VehicleState("/body", SIZES), WheelState("/w", SIZES)
        self.request, self.safety, self.command = OperatorRequest("/o"), SafetyStatus("/s"), TwistCommand("/t")
        self.delay = CommandDelay("/d")
        self.task = DriveTracker(
            CONFIG,
            VehicleGeometry(),
            lambda memory: WaypointPursuit(look_ahead=CurvatureLookAhead(), longitudinal_gain=0.9),
            None,
            self.path,
            self.body,
            self.wheels,
            self.delay,
            self.request,
            self.safety,
            self.command,
            PATH_AGE_MAX_NS,
        )
        self.safety.mode, self.request.motion = Mode.ACTIVE, Motion.WALK
        self.now_ns, self.yaw = 1_000_000_000, 0.0
        self.body.position = 0.0, aside_m, 0.0
        self.body.orientation = 0.0, 0.0, 0.0, 1.0

    def give(self, waypoints, closed=False, speed=0.6):
        self.path.stamp_ns, self.path.count = self.now_ns, len(waypoints)
        self.path.closed, self.path.speed = closed, speed
        self.path.x[: len(waypoints)], self.path.y[: len(waypoints)] = waypoints.T

    def step(self):
        self.now_ns += round(PERIOD_S * 1e9)
        self.task.step(self.now_ns)
        (forward, lateral), yaw_rate = self.command.velocity.tolist(), self.command.yaw_rate
        self.yaw += PERIOD_S * yaw_rate
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        self.body.position[0] += PERIOD_S * (forward * cosine - lateral * sine)
        self.body.position[1] += PERIOD_S * (forward * sine + lateral * cosine)
        self.body.orientation = 0.0, 0.0, math.sin(0.5 * self.yaw), math.cos(0.5 * self.yaw)
        self.body.velocity, self.body.angular_velocity = (forward, lateral), (0.0, 0.0, yaw_rate)

    def run(self, seconds):
        for _ in range(round(seconds / PERIOD_S)):
            self.step()

    def ask(self, velocity, seconds):
        """An operator who steers by velocity."""
        self.request.steering = Steering.VELOCITY
        for _ in range(round(seconds / PERIOD_S)):
            self.request.velocity, self.request.velocity_ns = velocity, self.now_ns
            self.step()

    def withdraw(self):
        self.path.stamp_ns, self.path.count = self.now_ns, 0


def test_a_line_is_reached_from_the_side_and_run_to_its_end():
    vehicle = Vehicle(aside_m=1.5)
    vehicle.give(straight(12.0))
    vehicle.run(12.0)
    assert abs(vehicle.body.position[1]) < 0.1
    vehicle.run(15.0)
    assert vehicle.command.arrived
    assert vehicle.body.position[:2] == pytest.approx((12.0, 0.0), abs=0.1)
    assert not vehicle.command.velocity.any()


def test_a_closed_path_is_run_once():
    vehicle = Vehicle()
    eight = figure_eight()
    vehicle.yaw = math.radians(45.0)
    vehicle.give(eight, closed=True)
    vehicle.run(85.0)
    assert vehicle.command.arrived
    assert vehicle.command.progress > 40.0


@pytest.mark.parametrize("stop", ["mode", "motion", "halt"])
def test_it_stops_when_it_is_to_and_goes_on_from_there(stop):
    vehicle = Vehicle()
    vehicle.give(straight(12.0))
    vehicle.run(5.0)
    values = {"mode": ("safety", Mode.STANDING), "motion": ("request", Motion.STAND), "halt": ("safety", 1)}
    record, value = getattr(vehicle, values[stop][0]), values[stop][1]
    before = getattr(record, stop)
    setattr(record, stop, value)
    vehicle.run(2.0)
    assert not vehicle.command.velocity.any()
    progress = vehicle.command.progress
    setattr(record, stop, before)
    vehicle.run(2.0)
    assert vehicle.command.progress > progress


@pytest.mark.parametrize(
    ("velocity", "manner"),
    [
        ((0.4, 0.0, 0.2), SteeringMode.ACKERMANN),
        ((0.0, 0.4, 0.0), SteeringMode.CRAB),
        ((0.0, 0.0, 0.4), SteeringMode.SPIN),
        ((0.3, 0.1, 0.2), SteeringMode.FREE),
    ],
)
def test_a_velocity_is_followed_and_the_path_waits(velocity, manner):
    vehicle = Vehicle()
    vehicle.give(straight(12.0))
    vehicle.run(1.0)
    vehicle.ask(velocity, 4.0)
    limits = CONFIG.velocity
    wanted = (velocity[0], min(velocity[1], limits.lateral_mps), velocity[2])
    assert (*vehicle.command.velocity, vehicle.command.yaw_rate) == pytest.approx(wanted)
    assert vehicle.command.manner == manner
    vehicle.run(2.0)  # nobody asks any more
    assert not vehicle.command.velocity.any()
    assert vehicle.command.manner == manner


def smooth(vehicle, seconds):
    """Step on; true if no command changed faster than the configured accelerations allow."""
    limits, most = CONFIG.following.speed, PERIOD_S * (1.0 + 1e-9)
    bounds = np.array([limits.deceleration_mps2, limits.deceleration_mps2, limits.yaw_acceleration_radps2]) * most
    commands = [(*vehicle.command.velocity, vehicle.command.yaw_rate)]
    for _ in range(round(seconds / PERIOD_S)):
        vehicle.step()
        commands.append((*vehicle.command.velocity, vehicle.command.yaw_rate))
    return bool((np.abs(np.diff(commands, axis=0)) <= bounds).all())


@pytest.mark.parametrize("stop", ["velocity", "withdrawal"])
def test_after_a_stop_in_between_a_path_is_begun_from_a_stand(stop):
    vehicle = Vehicle()
    vehicle.give(straight(30.0))
    vehicle.run(4.0)
    assert vehicle.command.velocity[0] == pytest.approx(0.6)
    if stop == "velocity":
        vehicle.ask((0.0, 0.0, 0.0), 2.0)
        vehicle.request.steering = Steering.PATH
    else:
        vehicle.withdraw()
        vehicle.run(2.0)
        vehicle.give(straight(30.0))
    assert not vehicle.command.velocity.any()
    vehicle.delay.delay = 0.5
    assert smooth(vehicle, 0.02)
    assert vehicle.command.predicted == pytest.approx((*vehicle.body.position[:2], vehicle.yaw), abs=1e-3)
    assert smooth(vehicle, 2.0)
    assert vehicle.command.velocity[0] == pytest.approx(0.6)


@pytest.mark.parametrize(
    "velocity", [(0.9, 0.0, 0.1), (-0.5, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.5), (0.3, 0.1, 0.2)]
)
def test_from_any_velocity_a_path_is_taken_up_smoothly(velocity):
    vehicle = Vehicle()
    vehicle.ask(velocity, 3.0)
    x, y, _ = vehicle.body.position
    vehicle.give(straight(30.0, vehicle.yaw) + np.array([x, y]))
    vehicle.request.steering = Steering.PATH
    assert smooth(vehicle, 4.0)
    assert vehicle.command.velocity == pytest.approx((0.6, 0.0), abs=1e-3)


def test_the_delay_of_commands_by_velocity_is_reckoned_with_on_the_path():
    vehicle = Vehicle()
    vehicle.give(straight(30.0))
    vehicle.ask((0.5, 0.0, 0.0), 3.0)
    vehicle.request.steering = Steering.PATH
    vehicle.delay.delay = 0.4
    vehicle.body.velocity = 0.0, 0.0  # it has not answered yet
    x = vehicle.body.position[0]
    vehicle.task.step(vehicle.now_ns + round(PERIOD_S * 1e9))
    starting_s = 0.5 / CONFIG.following.answer.acceleration_mps2
    assert vehicle.command.predicted[0] - x == pytest.approx(0.5 * (0.4 - 0.5 * starting_s), abs=0.02)


def test_at_rest_the_way_of_steering_stays():
    assert manner_of(PlanarVelocity(0.0, 0.0, 0.0), SteeringMode.CRAB) == SteeringMode.CRAB


def test_the_command_is_made_for_the_pose_at_which_the_wheels_answer():
    vehicle = Vehicle()
    vehicle.give(straight(12.0))
    vehicle.run(3.0)
    assert vehicle.command.predicted[0] == pytest.approx(vehicle.body.position[0], abs=0.02)
    vehicle.delay.delay = 0.5
    vehicle.step()
    assert vehicle.command.predicted[0] == pytest.approx(vehicle.body.position[0] + 0.5 * 0.6, abs=0.02)


def test_an_estimate_that_is_no_number_is_answered_by_standing():
    vehicle = Vehicle()
    vehicle.give(straight(12.0))
    vehicle.run(3.0)
    vehicle.body.position[0] = np.nan
    vehicle.step()
    assert not vehicle.command.velocity.any()


def test_a_path_that_cannot_be_followed_is_counted_and_the_one_before_is_kept():
    vehicle = Vehicle()
    vehicle.give(straight(12.0))
    vehicle.run(3.0)
    vehicle.give(np.array([[0.0, 0.0], [np.nan, 1.0]]))
    vehicle.run(1.0)
    assert vehicle.command.rejected_paths == 1
    assert vehicle.command.velocity[0] == pytest.approx(0.6)


def test_a_path_of_another_than_the_lease_s_holder_is_counted_and_the_one_before_is_kept():
    vehicle = Vehicle()
    vehicle.request.held, vehicle.request.holder, vehicle.path.source = True, 7, 7
    vehicle.give(straight(12.0))
    vehicle.run(3.0)
    vehicle.path.source = 8
    vehicle.withdraw()
    vehicle.run(1.0)
    assert (vehicle.command.rejected_paths, vehicle.command.foreign_paths) == (1, 1)
    assert vehicle.command.velocity[0] == pytest.approx(0.6)


@pytest.mark.parametrize("velocity", [None, (0.4, 0.0, 0.2), (0.0, 0.3, 0.0)])
def test_a_restored_task_goes_on_as_the_one_that_was_saved(velocity):
    vehicle, other = Vehicle(aside_m=1.0), Vehicle()
    vehicle.give(straight(12.0))
    vehicle.run(4.0)
    if velocity is not None:
        vehicle.ask(velocity, 1.0)
        vehicle.request.steering = Steering.PATH
    vehicle.delay.delay = other.delay.delay = 0.3
    other.task.restore(vehicle.task.save())
    for record in ("path", "body", "wheels", "request", "safety"):
        getattr(other, record).copy_from(getattr(vehicle, record))
    other.now_ns, other.yaw = vehicle.now_ns, vehicle.yaw
    for _ in range(50):
        vehicle.step()
        other.step()
        assert other.command.to_bytes() == vehicle.command.to_bytes()
        assert other.task.save() == vehicle.task.save()


def sliding(vehicle, lateral_mps):
    """A step of a vehicle whose centre moves across its heading besides, seen by its estimator only."""
    vehicle.step()
    vehicle.body.velocity[1] = lateral_mps


def test_where_it_slides_it_slows_down_and_says_so_and_comes_back_slowly():
    """On an arc at 2 m/s^2 of lateral acceleration; the share of it that is counted on is that of v^2 k."""
    traction, vehicle = CONFIG.traction, Vehicle()
    vehicle.give(figure_eight(), closed=True, speed=3.0)
    vehicle.run(6.0)
    assert vehicle.command.grip == 1.0
    fast = vehicle.command.velocity[0]
    for _ in range(50):
        sliding(vehicle, 0.3)
    assert vehicle.command.grip == pytest.approx(traction.least)
    assert vehicle.command.velocity[0] == pytest.approx(fast - CONFIG.following.speed.deceleration_mps2, abs=0.05)
    vehicle.run(1.0)
    assert vehicle.command.grip == pytest.approx(traction.least + traction.rise_per_s, abs=0.01)


def test_a_vehicle_that_is_asked_to_move_sideways_does_not_slide():
    vehicle = Vehicle()
    vehicle.request.steering, vehicle.request.velocity = Steering.VELOCITY, (0.0, 0.2, 0.0)
    for _ in range(100):
        vehicle.request.velocity_ns = vehicle.now_ns
        vehicle.step()
    assert vehicle.body.velocity[1] == pytest.approx(0.2)
    assert vehicle.command.grip == 1.0
