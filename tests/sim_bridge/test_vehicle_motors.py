# SPDX-License-Identifier: Apache-2.0
"""The vehicle's motors on a bench, against the closed forms of what limits them."""

import math

import msgspec
import numpy as np
import pytest

from runtime.robots import load_configuration
from sim_bridge.vehicle_motors import DRIVING, VehicleMotors

CONFIG = load_configuration("4ws4wd")
VEHICLE, PHYSICS = CONFIG.vehicle, CONFIG.simulation
STEP_S = PHYSICS.time_step_ns * 1e-9
PEAK_NM, FASTEST_RADPS = PHYSICS.peak_torque_nm, PHYSICS.no_load_speed_radps


class Bench:
    """Motors with power, and axes that are held at the steering and turn as a flywheel, or as they are made to."""

    def __init__(self, inertia_kg_m2=math.inf, **changes):
        self.motors = VehicleMotors(VEHICLE, msgspec.structs.replace(PHYSICS, **changes))
        self.motors.braked = False
        self.position, self.velocity, self.inertia = np.zeros((4, 3)), np.zeros((4, 3)), inertia_kg_m2

    def run(self, seconds):
        """Give torque and steering profile after each step, and speed after it, of all wheels."""
        for _ in range(round(seconds / STEP_S)):
            self.motors.update(self.position, self.velocity)
            self.velocity[:, DRIVING] += STEP_S * self.motors.torque[:, 1] / self.inertia
            yield self.motors.torque[:, 1].copy(), self.motors.lag(self.position), self.velocity[:, DRIVING].copy()


@pytest.mark.parametrize("lag_s", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("asked_rad", [0.15, 1.2])
def test_steering_follows_its_ramp_as_a_first_order_lag_does(lag_s, asked_rad):
    """r (t - T (1 - exp(-t / T))) on the ramp; after its end at t_1 the rest of the way decays with T."""
    bench, rate = Bench(steering_lag_s=lag_s), PHYSICS.steering_rate_radps
    bench.motors.target[0] = asked_rad
    angles = np.array([angle for _, angle, _ in bench.run(2.0)])
    t, end = STEP_S * np.arange(1, len(angles) + 1), asked_rad / rate
    ramp = rate * (t - lag_s * -np.expm1(-t / lag_s))
    rest = rate * lag_s * -math.expm1(-end / lag_s) * np.exp(-(t - end) / lag_s)
    expected = np.where(t < end, ramp, asked_rad - rest)
    np.testing.assert_allclose(angles, np.tile(expected, (4, 1)).T, atol=rate * STEP_S)


def test_without_a_lag_steering_is_on_its_ramp():
    bench, rate = Bench(steering_lag_s=0.0), PHYSICS.steering_rate_radps
    bench.motors.target[0] = 0.3
    angles = np.array([angle[0] for _, angle, _ in bench.run(0.4)])
    expected = np.minimum(rate * STEP_S * np.arange(1, len(angles) + 1), 0.3)
    np.testing.assert_allclose(angles, expected, atol=1e-9)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("speed", [0.0, 5.0, 12.0, 19.0])
def test_a_motor_gives_what_its_torque_speed_line_has_left_and_its_peak_against_the_motion(speed, sign):
    for asked, expected in ((1.0, PEAK_NM * (1.0 - speed / FASTEST_RADPS)), (-1.0, PEAK_NM)):
        bench = Bench()
        bench.velocity[:, DRIVING] = sign * speed
        bench.motors.target[1] = asked * sign * 10.0 * FASTEST_RADPS
        *_, (torque, _, _) = bench.run(5.0)
        np.testing.assert_allclose(torque, asked * sign * expected, atol=1e-9)


def test_a_heavy_wheel_runs_up_to_the_no_load_speed_as_its_line_says():
    """J dw/dt = M (1 - w / w_0), so that w_0 - w decays with J w_0 / M, once its controller asks for all there is."""
    inertia, begin = 10.0, 100
    assert PEAK_NM / inertia < 0.5 * PHYSICS.acceleration_radps2
    bench = Bench(inertia)
    bench.motors.target[1] = 2.0 * FASTEST_RADPS
    speeds = np.array([speed for _, _, speed in bench.run(10.0)])[begin:]
    t = STEP_S * np.arange(len(speeds))[:, None]
    lacking = (FASTEST_RADPS - speeds[0]) * np.exp(-PEAK_NM * t / (inertia * FASTEST_RADPS))
    np.testing.assert_allclose(FASTEST_RADPS - speeds, lacking, rtol=2e-3)


def test_a_light_wheel_runs_up_no_faster_than_its_profile():
    """At a t until the speed that is asked for; while it speeds up, the controller's error is at most J a / k."""
    inertia, asked, rate = 0.1, 8.0, PHYSICS.acceleration_radps2
    bench = Bench(inertia)
    bench.motors.target[1] = asked
    speeds = np.array([speed for _, _, speed in bench.run(1.5)])
    expected = np.minimum(rate * STEP_S * np.arange(1, len(speeds) + 1), asked)
    np.testing.assert_allclose(
        speeds, np.tile(expected, (4, 1)).T, atol=1.1 * inertia * rate / PHYSICS.speed_gain_nms_prad
    )


@pytest.mark.parametrize("begun", [8.0, -8.0])
def test_a_light_wheel_slows_down_no_faster_than_its_profile_and_reverses_at_that_of_speeding_up(begun):
    """At d to rest, and on at a to the speed asked for; the controller's error jumps by up to J (a + d) / k."""
    inertia, up, down = 0.1, PHYSICS.acceleration_radps2, PHYSICS.deceleration_radps2
    bench, sign = Bench(inertia), math.copysign(1.0, begun)
    bench.motors.target[1] = begun
    list(bench.run(2.0))
    bench.motors.target[1] = -0.5 * begun
    speeds = sign * np.array([speed for _, _, speed in bench.run(1.5)])
    t, rests = STEP_S * np.arange(1, len(speeds) + 1), abs(begun) / down
    expected = np.where(t < rests, abs(begun) - down * t, np.maximum(-up * (t - rests), -0.5 * abs(begun)))
    bound = 1.1 * inertia * (up + down) / PHYSICS.speed_gain_nms_prad
    np.testing.assert_allclose(speeds, np.tile(expected, (4, 1)).T, atol=bound)


def test_without_power_there_is_no_torque_and_steering_stays():
    bench = Bench()
    bench.motors.target[0], bench.motors.target[1] = 0.5, 10.0
    list(bench.run(0.3))
    bench.motors.braked = True
    held = bench.motors.lag(bench.position)
    for torque, angle, _ in bench.run(0.5):
        assert not torque.any()
        np.testing.assert_array_equal(angle, held)
