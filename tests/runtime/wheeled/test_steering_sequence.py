# SPDX-License-Identifier: Apache-2.0
"""Stop, steer, go: no wheel swings round while the vehicle rolls, and every wanted motion comes about."""

import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.models.vehicle import VehicleGeometry
from runtime.wheeled.steering import STANDSTILL, Twist, twist_of_wheels
from runtime.wheeled.steering_sequence import (
    Phase,
    SteeringLimits,
    SteeringMode,
    fastest_wheel,
    next_targets,
    standing,
    within_mode,
)

VEHICLE, LIMITS, DT = VehicleGeometry(), SteeringLimits(), 0.01


class Wheels:
    """Wheels that follow their targets no faster than they can."""

    def __init__(self, steering_rate=1.5, acceleration=20.0):
        self.steering, self.speed = [0.0] * 4, [0.0] * 4
        self.step_angle, self.step_speed = steering_rate * DT, acceleration * DT
        self.state = standing(self.steering)
        self.targets = None

    def step(self, twist, mode=SteeringMode.FREE):
        before = self.state
        self.state, self.targets = next_targets(self.state, twist, mode, self.steering, self.speed, DT, VEHICLE, LIMITS)
        self.steering = [
            _towards(a, b, self.step_angle) for a, b in zip(self.steering, self.targets.steering, strict=True)
        ]
        self.speed = [_towards(a, b, self.step_speed) for a, b in zip(self.speed, self.targets.speed, strict=True)]
        return before

    def run(self, twist, mode=SteeringMode.FREE, steps=600):
        phases = []
        for _ in range(steps):
            self.step(twist, mode)
            phases.append(self.state.phase)
        return phases


def _towards(present, wanted, step):
    return present + min(max(wanted - present, -step), step)


def test_goes_from_arc_to_crab_to_spin_by_stopping():
    wheels = Wheels()
    wheels.run(Twist(0.6, 0.0, 0.3), SteeringMode.ACKERMANN)
    for twist, mode in ((Twist(0.3, 0.5, 0.0), SteeringMode.CRAB), (Twist(0.0, 0.0, 0.6), SteeringMode.SPIN)):
        phases = wheels.run(twist, mode)
        assert [p for i, p in enumerate(phases) if i == 0 or p != phases[i - 1]] == [
            Phase.STOPPING,
            Phase.STEERING,
            Phase.ROLLING,
        ]
        assert wheels.state.mode == mode
        assert twist_of_wheels(wheels.steering, wheels.speed, VEHICLE) == pytest.approx(twist, abs=1e-3)


def test_the_same_way_of_steering_needs_no_stop():
    wheels = Wheels()
    wheels.run(Twist(0.6, 0.0, 0.2), SteeringMode.ACKERMANN)
    for curvature in (0.1, 0.0, -0.1, -0.3):
        phases = wheels.run(Twist(0.6, 0.0, 0.6 * curvature), SteeringMode.ACKERMANN, steps=200)
        assert set(phases) == {Phase.ROLLING}


def test_reversing_needs_no_steering():
    wheels = Wheels()
    wheels.run(Twist(0.6, 0.0, 0.2), SteeringMode.ACKERMANN)
    angles = wheels.state.angles
    phases = wheels.run(Twist(-0.6, 0.0, -0.2), SteeringMode.ACKERMANN)
    assert set(phases) == {Phase.ROLLING}
    assert wheels.state.angles == pytest.approx(angles)


def test_standstill_holds_the_angles_with_hysteresis():
    wheels = Wheels()
    wheels.run(Twist(0.6, 0.0, 0.2), SteeringMode.ACKERMANN)
    angles = wheels.state.angles
    wheels.run(STANDSTILL, SteeringMode.ACKERMANN)
    assert wheels.targets.speed == (0.0,) * 4
    between = 0.5 * (LIMITS.hold_mps + LIMITS.rest_mps)
    wheels.run(Twist(0.0, between, 0.0))
    assert wheels.state.angles == angles
    assert not wheels.state.moving
    wheels.run(Twist(1.01 * LIMITS.rest_mps, 0.0, 0.0), SteeringMode.ACKERMANN)
    assert wheels.state.moving
    wheels.run(Twist(between, 0.0, 0.0), SteeringMode.ACKERMANN)
    assert wheels.state.moving
    assert wheels.targets.speed == pytest.approx((between / VEHICLE.wheel_radius_m,) * 4)
    wheels.run(Twist(0.99 * LIMITS.hold_mps, 0.0, 0.0), SteeringMode.ACKERMANN)
    assert not wheels.state.moving
    assert wheels.targets.speed == (0.0,) * 4


def test_slows_while_a_wheel_lags():
    state = standing((0.0,) * 4)._replace(phase=int(Phase.ROLLING), angles=(0.0,) * 4)
    shares = []
    for error in (0.0, 0.5, 0.9, 1.3):
        _, targets = next_targets(
            state, Twist(1.0, 0.0, 0.0), SteeringMode.ACKERMANN, (error, 0, 0, 0), (5.0,) * 4, DT, VEHICLE, LIMITS
        )
        shares.append(targets.speed[0] * VEHICLE.wheel_radius_m)
    assert shares == pytest.approx([1.0, 1.0, 0.5, 0.0])


def test_each_mode_does_its_part_of_a_motion():
    twist = Twist(0.5, 0.2, 0.4)
    assert within_mode(twist, SteeringMode.ACKERMANN) == Twist(0.5, 0.0, 0.4)
    assert within_mode(twist._replace(vx=0.0), SteeringMode.ACKERMANN) == STANDSTILL
    assert within_mode(twist, SteeringMode.CRAB) == Twist(0.5, 0.2, 0.0)
    assert within_mode(twist, SteeringMode.SPIN) == Twist(0.0, 0.0, 0.4)
    assert within_mode(twist, SteeringMode.FREE) == twist


speeds = st.floats(-2.0, 2.0)
twists = st.builds(Twist, speeds, speeds, speeds)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(twists, st.sampled_from(list(SteeringMode)), st.integers(1, 150)), min_size=1, max_size=5))
def test_any_order_of_motions(orders):
    wheels = Wheels()
    for twist, mode, steps in orders:
        for _ in range(steps):
            before = wheels.step(twist, mode)
            change = max(abs(a - b) for a, b in zip(wheels.state.angles, before.angles, strict=True))
            if wheels.state.phase == Phase.ROLLING:
                assert change <= LIMITS.jump_rad or before.phase == Phase.STEERING
            else:
                assert wheels.targets.speed == (0.0,) * 4
            if wheels.state.phase == Phase.STOPPING:
                assert change == 0.0
            assert max(map(abs, wheels.targets.speed)) <= LIMITS.maximum_wheel_radps * (1.0 + 1e-12)
    twist, mode, _ = orders[-1]
    wheels.run(twist, mode, steps=1200)
    motion = within_mode(twist, mode)
    if fastest_wheel(motion, VEHICLE) > 2.0 * LIMITS.rest_mps:
        assert wheels.state.phase == Phase.ROLLING
        reached = twist_of_wheels(wheels.targets.steering, wheels.targets.speed, VEHICLE)
        direct = math.hypot(*(a - b for a, b in zip(reached, motion, strict=True)))
        assert direct <= 0.02 + 0.2 * fastest_wheel(motion, VEHICLE)


@pytest.mark.parametrize(
    "wrong", [{"hold_mps": 0.1}, {"full_speed_rad": 1.3}, {"steered_rad": 0.9}, {"maximum_wheel_radps": 0.0}]
)
def test_crossed_limits_are_refused(wrong):
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(wrong, SteeringLimits)
