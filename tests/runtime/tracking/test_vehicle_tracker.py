# SPDX-License-Identifier: Apache-2.0
"""The vehicle's tracker on a kinematic vehicle: paths of all kinds, driven to their ends."""

import math

import numpy as np
import pytest

from runtime.tracking.bends import Bend, arc, figure_eight, path_of_bends, s_bend
from runtime.tracking.curvature_look_ahead import CurvatureLookAhead
from runtime.tracking.errors import PathError
from runtime.tracking.motion import Motion
from runtime.tracking.paths import circle, straight
from runtime.tracking.polyline import Polyline
from runtime.tracking.regulated_pursuit import RegulatedPursuit, RegulatedSpeed
from runtime.tracking.steered_return import SteeredReturn
from runtime.tracking.vehicle_tracker import VehicleTracker, VehicleTrackerConfig
from runtime.tracking.waypoint_pursuit import WaypointPursuit

LINE = np.column_stack((np.arange(0.0, 25.1, 0.3), np.zeros(84)))
PLAIN, LDC = WaypointPursuit(), WaypointPursuit(longitudinal_gain=0.9)
FUZZY_LDC = WaypointPursuit(look_ahead=CurvatureLookAhead(), longitudinal_gain=0.9)
POLICIES = {"plain": PLAIN, "fuzzy-ldc": FUZZY_LDC, "steered-return": SteeredReturn()}
DRIVE = {"acceleration": 2.0, "tick_s": 0.02, "period_s": 0.02}


def to_the_end(vehicle, controller, limit_s=120.0):
    while vehicle.ticks * vehicle.tick_s < limit_s:
        vehicle.step()
        if controller.commands[-1].arrived and vehicle.speed == 0.0:
            return vehicle
    raise AssertionError(f"not there after {limit_s} s: {controller.commands[-1]}")


def inner_angle_deg(curvature):
    bend = abs(curvature)
    return math.degrees(math.atan2(1.17 * bend, 2.0 - 0.74 * bend))


def test_return_to_a_line_from_beside_it_with_delay(bicycle, tracked):
    """The paper's straight line: as good as the steering allows (0.228 m and 6.7 s at any steering angle)."""
    controller = tracked(SteeredReturn(), LINE, 0.6, delay_s=0.6, rolling=True)
    vehicle = bicycle(LINE, controller, start=(0.0, -1.5, 0.0), speed=0.6, command_delay_s=0.6).run(25.0)
    assert vehicle.mean_error() <= 0.237
    assert vehicle.settling_time() <= 6.7
    assert vehicle.overshoot() <= 0.02
    plain = inner_angle_deg(1.0 / 0.75)
    assert max(inner_angle_deg(command.requested) for command in controller.commands) <= 0.4 * plain


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.6])
def test_return_is_mirror_symmetric(bicycle, tracked, delay):
    tracks = []
    for side in (1.0, -1.0):
        controller = tracked(SteeredReturn(), LINE, 0.6, delay_s=delay, rolling=True)
        vehicle = bicycle(LINE, controller, start=(0.0, side, 0.0), speed=0.6, command_delay_s=delay, tick_s=0.02).run(
            12.0
        )
        tracks.append(np.array(vehicle.track) * (1.0, side, side))
    assert tracks[0] == pytest.approx(tracks[1], abs=1e-9)


def curve_error(bicycle, tracked, policy, delay, known):
    waypoints = s_bend()
    controller = tracked(policy, waypoints, 0.6, delay_s=known, rolling=True)
    vehicle = bicycle(waypoints, controller, start=(0.0, -1.0, 0.0), speed=0.6, command_delay_s=delay, tick_s=0.02).run(
        60.0
    )
    return vehicle.mean_error(after_s=12.0)


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.6])
def test_curves_against_plain_pursuit(bicycle, tracked, delay):
    plain = curve_error(bicycle, tracked, PLAIN, delay, 0.0)
    fuzzy = curve_error(bicycle, tracked, FUZZY_LDC, delay, delay)
    ours = curve_error(bicycle, tracked, SteeredReturn(), delay, delay)
    assert fuzzy <= 0.8 * plain
    assert ours <= 0.6 * plain
    assert max(fuzzy, ours) <= 0.05


def test_figure_eight_at_speed_with_delay(bicycle, tracked):
    waypoints = figure_eight()
    controller = tracked(SteeredReturn(), waypoints, 1.5, delay_s=0.3, closed=True, period_s=0.02)
    start = (0.0, 0.0, math.radians(45.0))
    vehicle = bicycle(waypoints, controller, closed=True, start=start, command_delay_s=0.3, **DRIVE)
    to_the_end(vehicle, controller, 60.0)
    rms = float(np.sqrt(np.mean(np.square(vehicle.lateral[150:]))))
    assert rms <= 0.025
    assert vehicle.progress == pytest.approx(vehicle.line.length, abs=0.1)


@pytest.mark.parametrize("name", sorted(POLICIES))
@pytest.mark.parametrize("delay", [0.0, 0.4])
def test_stops_at_the_goal_of_a_path_that_crosses_itself(bicycle, tracked, name, delay):
    waypoints = path_of_bends((Bend(3.0), arc(270.0), Bend(6.0)))
    controller = tracked(POLICIES[name], waypoints, 0.8, delay_s=delay, period_s=0.02)
    vehicle = to_the_end(bicycle(waypoints, controller, command_delay_s=delay, **DRIVE), controller)
    assert math.dist(vehicle.pose[:2], waypoints[-1]) <= 0.1
    assert vehicle.mean_error() <= 0.1
    assert controller.commands[-1].remaining <= 0.03


def test_closed_path_is_driven_once(bicycle, tracked):
    waypoints = circle(4.0)
    controller = tracked(SteeredReturn(), waypoints, 1.0, delay_s=0.2, closed=True, period_s=0.02)
    vehicle = to_the_end(bicycle(waypoints, controller, closed=True, command_delay_s=0.2, **DRIVE), controller)
    assert math.dist(vehicle.pose[:2], (0.0, 0.0)) <= 0.1
    assert vehicle.ticks * vehicle.tick_s >= math.tau * 4.0
    assert vehicle.mean_error() <= 0.02


@pytest.mark.parametrize("name", sorted(POLICIES))
def test_path_behind_the_vehicle_is_driven_backwards(bicycle, tracked, name):
    controller = tracked(POLICIES[name], LINE[:30], 0.6, delay_s=0.2, period_s=0.02)
    vehicle = bicycle(LINE[:30], controller, start=(0.0, 0.3, math.pi - 0.1), command_delay_s=0.2, **DRIVE)
    to_the_end(vehicle, controller)
    assert math.dist(vehicle.pose[:2], LINE[29]) <= 0.1
    assert max(command.speed for command in controller.commands) <= 0.0
    assert abs(vehicle.lateral[-1]) <= 0.03


def test_path_that_begins_behind_the_vehicle_is_taken_up_where_it_is(bicycle, tracked):
    controller = tracked(SteeredReturn(), LINE[:30], 0.6, period_s=0.02)
    vehicle = to_the_end(bicycle(LINE[:30], controller, start=(2.0, 0.2, 0.0), **DRIVE), controller)
    assert controller.commands[0].progress == pytest.approx(2.0)
    assert min(command.speed for command in controller.commands) == 0.0
    assert math.dist(vehicle.pose[:2], LINE[29]) <= 0.1


@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_three_point_turn(bicycle, tracked, delay):
    """Forwards into a bend, backwards out of it, and forwards again."""
    first = path_of_bends((Bend(3.0), arc(60.0, 3.0)))
    back = first[-1] - np.outer(np.arange(1, 11) * 0.3, (math.cos(math.pi / 3), math.sin(math.pi / 3)))
    last = back[-1] + np.outer(np.arange(1, 16) * 0.3, (math.cos(math.pi / 3), math.sin(math.pi / 3)))
    waypoints = np.vstack((first, back, last))
    controller = tracked(SteeredReturn(), waypoints, 0.6, delay_s=delay, period_s=0.02)
    vehicle = to_the_end(bicycle(first, controller, command_delay_s=delay, **DRIVE), controller)
    assert math.dist(vehicle.pose[:2], last[-1]) <= 0.1
    signs = [math.copysign(1.0, command.speed) for command in controller.commands if abs(command.speed) > 0.1]
    assert [s for i, s in enumerate(signs) if i == 0 or s != signs[i - 1]] == [1.0, -1.0, 1.0]
    progress = [command.progress for command in controller.commands]
    assert progress == sorted(progress)
    turned = max(math.dist(pose[:2], first[-1]) for pose in vehicle.track if pose[0] > first[-1][0])
    assert turned <= 4.6


def test_turns_in_place_where_the_path_goes_the_other_way_round(tracked):
    """Set against the path after its start, a vehicle does not drive away from it."""
    controller = tracked(PLAIN, LINE, 0.6, period_s=0.02)
    controller((0.0, 0.0, 0.0), 0.0, 0.0)
    yaw = 2.5
    for _ in range(600):
        controller((1.0, 0.0, yaw), 0.0, 0.0)
        command = controller.commands[-1]
        if not command.turning:
            break
        assert command.speed == 0.0
        yaw += 0.02 * command.yaw_rate
    assert abs(yaw) <= 0.35
    assert command.speed >= 0.0


def test_slows_for_a_bend_ahead_and_keeps_the_lateral_acceleration(bicycle, tracked):
    waypoints = path_of_bends((Bend(12.0), arc(180.0, 2.5), Bend(8.0)))
    controller = tracked(SteeredReturn(), waypoints, 3.0, period_s=0.02)
    vehicle = bicycle(waypoints, controller, **DRIVE)
    worst = fastest = 0.0
    while not controller.commands or not controller.commands[-1].arrived:
        vehicle.step()
        worst = max(worst, vehicle.speed**2 * 2.0 * abs(math.tan(vehicle.angle)) / 1.17)
        fastest = max(fastest, vehicle.speed)
    assert fastest >= 2.3
    assert worst <= 1.02 * VehicleTrackerConfig().speed.lateral_acceleration_mps2
    assert max(map(abs, vehicle.lateral)) <= 0.1


def test_halts_and_goes_on(bicycle, tracked):
    controller = tracked(LDC, LINE[:20], 0.6, period_s=0.02)
    vehicle = bicycle(LINE[:20], controller, **DRIVE).run(4.0)
    controller.halted = True
    vehicle.run(2.0)
    assert vehicle.speed == 0.0
    assert not controller.commands[-1].arrived
    controller.halted = False
    to_the_end(vehicle, controller)
    assert math.dist(vehicle.pose[:2], LINE[19]) <= 0.05


def test_memory_is_all_that_is_remembered(bicycle, tracked):
    controller = tracked(SteeredReturn(), LINE, 0.6, delay_s=0.3, period_s=0.02)
    vehicle = bicycle(LINE, controller, start=(0.0, -0.5, 0.1), command_delay_s=0.3, **DRIVE).run(3.0)
    memory = controller.tracker.memory.copy()
    other = VehicleTracker(SteeredReturn(), memory=memory)
    other.take(LINE)
    motion = Motion(*vehicle.pose, vehicle.speed, vehicle.angle)
    for now_s in (controller.now_s, controller.now_s + 0.02):
        assert other.step(now_s, motion, 0.6, 0.3) == controller.tracker.step(now_s, motion, 0.6, 0.3)


def test_a_bad_path_is_refused_and_the_one_before_kept():
    tracker = VehicleTracker(PLAIN)
    tracker.take(LINE)
    with pytest.raises(PathError, match="2 are needed"):
        tracker.take([(0.0, 0.0)])
    assert tracker.step(1.0, Motion(0.0, 0.0, 0.0), 0.6).remaining == pytest.approx(24.9)


def test_regulated_pursuit_follows_and_slows(bicycle, tracked):
    waypoints = path_of_bends((Bend(3.0), arc(180.0, 0.7), Bend(3.0)), spacing_m=0.1)
    controller = tracked(RegulatedPursuit(), waypoints, 0.5, regulation=RegulatedSpeed(), period_s=0.02)
    vehicle = to_the_end(bicycle(waypoints, controller, steering_rate=2.0, **DRIVE), controller)
    assert vehicle.mean_error() <= 0.1
    speeds = [command.speed for command in controller.commands[200:400]]
    assert min(speeds) < 0.45


def test_regulated_speed_from_its_definition():
    regulation, path = RegulatedSpeed(), Polyline(straight(10.0))
    assert regulation(path, 1.0, 0.0, 10.0, 0.5) == 0.5
    assert regulation(path, 1.0 / 0.6, 0.0, 10.0, 0.5) == pytest.approx(0.5 * 0.6 / 0.9)
    assert regulation(path, 5.0, 0.0, 10.0, 0.5) == 0.25
    assert regulation(path, 0.0, 0.0, 0.3, 0.5) == pytest.approx(0.25)
    assert regulation(path, 0.0, 0.0, 0.01, 0.5) == 0.05
    assert regulation(path, 0.0, 0.0, 10.0, 0.1) == 0.1
