# SPDX-License-Identifier: Apache-2.0
"""The kinematic plant keeps to its equations, its rates and its delays."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from sim_bridge.kinematic_vehicle import KinematicPlant, KinematicVehicle

TICK_S = 0.01
PROMPT = KinematicPlant(steering_rate_radps=math.inf, acceleration_mps2=math.inf)
poses = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-3.0, 3.0))
speeds, curvatures = st.floats(0.1, 3.0), st.floats(0.05, 1.2) | st.floats(-1.2, -0.05)
commands = st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-1.3, 1.3)), min_size=1, max_size=30)


def driven(plant, asked, every=5, pose=(0.0, 0.0, 0.0), speed=0.6):
    """Motions from the start on, a new command every few ticks."""
    vehicle = KinematicVehicle(plant, pose, speed)
    motions, seen = [vehicle.motion], [vehicle.seen]
    for command in asked:
        vehicle.command(*command)
        for _ in range(every):
            vehicle.advance()
            motions.append(vehicle.motion)
            seen.append(vehicle.seen)
    return motions, seen


@given(poses, speeds, curvatures, st.integers(1, 3000))
def test_constant_steering_is_the_exact_circle(pose, speed, curvature, ticks):
    vehicle = KinematicVehicle(PROMPT, pose, speed)
    vehicle.command(speed, curvature)
    vehicle.advance()
    x, y, yaw, _, angle, yaw_rate = vehicle.motion
    assert angle == pytest.approx(math.atan(0.5 * 1.17 * curvature))
    assert yaw_rate == pytest.approx(speed * curvature)
    for _ in range(ticks):
        vehicle.advance()
    turned = speed * curvature * ticks * TICK_S
    centre = x - math.sin(yaw) / curvature, y + math.cos(yaw) / curvature
    end = vehicle.motion
    assert end.yaw == pytest.approx(yaw + turned, abs=1e-9)
    assert end.x == pytest.approx(centre[0] + math.sin(yaw + turned) / curvature, abs=1e-8)
    assert end.y == pytest.approx(centre[1] - math.cos(yaw + turned) / curvature, abs=1e-8)


@given(poses, st.floats(-2.0, 2.0))
def test_straight_wheels_are_the_exact_line(pose, speed):
    (*_, end), _ = driven(PROMPT, [(speed, 0.0)], every=250, pose=pose, speed=speed)
    way = speed * 250 * TICK_S
    assert end[:3] == pytest.approx((pose[0] + way * math.cos(pose[2]), pose[1] + way * math.sin(pose[2]), pose[2]))


@given(commands, st.integers(0, 80))
def test_a_command_delay_shifts_the_answer_by_exactly_itself(asked, ticks):
    """Until then the vehicle rolls on; what follows is the same, from where it has come to."""
    motions, _ = driven(KinematicPlant(), asked)
    late, _ = driven(KinematicPlant(command_delay_ns=ticks * 10_000_000), [*asked, *[asked[-1]] * 16])
    for before, after in zip(motions, late[ticks:], strict=False):
        assert after[2:] == before[2:]
        assert after[:2] == pytest.approx((before.x + 0.6 * ticks * TICK_S, before.y), abs=1e-9)
    assert all(motion[1:5] == (0.0, 0.0, 0.6, 0.0) for motion in late[: ticks + 1])


@given(commands, st.integers(0, 80))
def test_a_pose_delay_shows_the_pose_of_exactly_then_and_the_wheels_of_now(asked, ticks):
    motions, seen = driven(KinematicPlant(pose_delay_ns=ticks * 10_000_000), asked)
    assert motions == driven(KinematicPlant(), asked)[0]
    assert [one[:3] for one in seen] == [motions[max(number - ticks, 0)][:3] for number in range(len(seen))]
    assert [one[3:] for one in seen] == [motion[3:] for motion in motions]


@given(commands, st.floats(0.05, 2.0), st.floats(0.1, 5.0))
def test_rates_are_kept_and_reached(asked, rate, acceleration):
    motions, _ = driven(KinematicPlant(steering_rate_radps=rate, acceleration_mps2=acceleration), asked)
    angles, speeds = (np.array([motion[column] for motion in motions]) for column in (4, 3))
    assert np.abs(np.diff(angles)).max() <= rate * TICK_S + 1e-12
    assert np.abs(np.diff(speeds)).max() <= acceleration * TICK_S + 1e-12
    wanted = math.atan(0.5 * 1.17 * asked[0][1])
    assert angles[5] == pytest.approx(math.copysign(min(5 * rate * TICK_S, abs(wanted)), wanted), abs=1e-12)


@given(commands)
def test_left_and_right_are_alike(asked):
    motions, _ = driven(KinematicPlant(), asked)
    mirrored, _ = driven(KinematicPlant(), [(speed, -curvature) for speed, curvature in asked])
    sides = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    assert np.array_equal(np.array(motions) * sides, np.array(mirrored))


@pytest.mark.parametrize("curvature", [0.4, -1.3])
def test_while_the_steering_turns_the_motion_is_that_of_the_differential_equations(curvature):
    plant = KinematicPlant()
    wanted = math.atan(0.5 * plant.wheelbase_m * curvature)

    def slope(t, state):
        angle = math.copysign(min(plant.steering_rate_radps * t, abs(wanted)), wanted)
        yaw = state[2]
        return 0.6 * math.cos(yaw), 0.6 * math.sin(yaw), 0.6 * 2.0 * math.tan(angle) / plant.wheelbase_m

    (*_, end), _ = driven(plant, [(0.6, curvature)], every=400)
    reference = solve_ivp(slope, (0.0, 4.0), (0.0, 0.0, 0.0), rtol=1e-10, atol=1e-10, max_step=0.05).y[:, -1]
    assert end[:3] == pytest.approx(tuple(reference), abs=5e-5)


@pytest.mark.parametrize("name", ["command_delay_ns", "pose_delay_ns"])
def test_a_delay_that_is_no_multiple_of_the_tick_is_refused(name):
    with pytest.raises(ValueError, match=f"{name} = 15000000 is no multiple of tick_ns = 10000000"):
        KinematicPlant(**{name: 15_000_000})
