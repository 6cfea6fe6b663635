# SPDX-License-Identifier: Apache-2.0
"""One holder commands, anyone may stop, and nobody is obeyed for longer than a lease."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runtime.safety.authority import AuthorityConfig, AuthorityTask
from runtime.signals import Motion, OperatorEvent, OperatorRequest, Request, Steering

MS = 1_000_000
CONFIG = AuthorityConfig()
ANN, BEN = 11, 22


class Rig:
    """An authority, stepped every 2 ms."""

    def __init__(self):
        self.now_ns = 5_000 * MS
        self.event, self.request = OperatorEvent("/event"), OperatorRequest("/request")
        self.task = AuthorityTask(CONFIG, self.event, self.request)

    def step(self, count=1):
        for _ in range(count):
            self.now_ns += 2 * MS
            self.task.step(self.now_ns)
        return self.request

    def say(self, source, request, motion=Motion.REST, priority=10, velocity=(0.0, 0.0, 0.0), age_ns=0):
        event = self.event
        event.sequence += 1
        event.stamp_ns = self.now_ns + 2 * MS - age_ns
        event.source, event.priority, event.request, event.motion = source, priority, request, motion
        event.velocity = velocity
        return self.step()


@pytest.fixture
def rig():
    return Rig()


def walking(rig):
    rig.say(ANN, Request.ARM)
    return rig.say(ANN, Request.MOTION, Motion.WALK)


def test_nobody_commands_at_first(rig):
    request = rig.step(10)
    assert not request.held
    assert not request.arm
    assert request.malformed == 0
    assert request.motion == Motion.REST


@pytest.mark.parametrize("kind", [kind for kind in Request if kind not in (Request.EMERGENCY_STOP, Request.RELEASE)])
def test_the_first_to_ask_takes_the_lease(rig, kind):
    request = rig.say(ANN, kind)
    assert (request.held, request.holder, request.leases) == (True, ANN, 1)


def test_others_are_refused_and_counted_and_change_nothing(rig):
    before = bytearray(walking(rig).to_bytes())
    for kind in Request:
        if kind != Request.EMERGENCY_STOP:
            rig.say(BEN, kind, Motion.SIT, velocity=(1.0, 0.0, 0.0))
    request = OperatorRequest("/request")
    request.load(before)
    request.refused = len(Request) - 1
    assert rig.request.to_bytes() == request.to_bytes()


def test_a_higher_priority_takes_the_lease_and_finds_a_robot_that_is_asked_to_stand(rig):
    walking(rig)
    request = rig.say(BEN, Request.LIFE, priority=11)
    assert (request.holder, request.priority, request.leases) == (BEN, 11, 2)
    assert request.motion == Motion.STAND
    assert request.arm, "a robot that loses its torque falls"
    assert rig.say(ANN, Request.MOTION, Motion.WALK).refused == 1
    assert rig.say(BEN, Request.MOTION, Motion.WALK, priority=11).motion == Motion.WALK


def test_a_holder_keeps_the_highest_priority_of_its_lease_whatever_else_it_sends(rig):
    walking(rig)
    rig.say(ANN, Request.LIFE, priority=20)
    request = rig.say(ANN, Request.VELOCITY, priority=10, velocity=(0.3, 0.0, 0.0))
    assert request.priority == 20
    request = rig.say(BEN, Request.LIFE, priority=20)
    assert (request.holder, request.refused, request.motion) == (ANN, 1, Motion.WALK)
    assert rig.say(BEN, Request.LIFE, priority=21).holder == BEN


@pytest.mark.parametrize("end", [Request.RELEASE, None], ids=["released", "run out"])
def test_a_priority_ends_with_its_lease(rig, end):
    rig.say(ANN, Request.LIFE, priority=20)
    if end is None:
        rig.step(1 + CONFIG.lease_ns // (2 * MS))
    else:
        rig.say(ANN, end, priority=20)
    assert rig.say(ANN, Request.LIFE, priority=10).priority == 10
    assert rig.say(BEN, Request.LIFE, priority=11).holder == BEN


def test_the_lease_ends_without_a_sign_of_life(rig):
    walking(rig)
    assert rig.step(CONFIG.lease_ns // (2 * MS)).held
    request = rig.step()
    assert not request.held
    assert request.motion == Motion.STAND
    assert request.arm
    request = rig.say(BEN, Request.LIFE, priority=1)
    assert (request.held, request.holder) == (True, BEN)


@pytest.mark.parametrize("kind", [Request.LIFE, Request.VELOCITY, Request.MOTION, Request.ARM])
def test_every_event_of_the_holder_is_a_sign_of_life(rig, kind):
    rig.say(ANN, Request.LIFE)
    for _ in range(10):
        rig.step(200)
        rig.say(ANN, kind)
        assert rig.request.held
        assert rig.request.stamp_ns == rig.now_ns


def test_a_lease_can_be_released(rig):
    walking(rig)
    request = rig.say(ANN, Request.RELEASE)
    assert not request.held
    assert request.motion == Motion.STAND


@pytest.mark.parametrize("source", [ANN, BEN])
@pytest.mark.parametrize("age_ns", [0, 60_000 * MS])
def test_anyone_may_stop_and_only_a_holder_without_arm_resets_it(rig, source, age_ns):
    walking(rig)
    assert rig.say(source, Request.EMERGENCY_STOP, priority=0, age_ns=age_ns).emergency_stop
    assert rig.request.holder == ANN
    rig.say(ANN, Request.RESET)
    assert rig.request.emergency_stop, "the arm is still held"
    rig.say(ANN, Request.DISARM)
    rig.say(BEN, Request.RESET)
    assert rig.request.emergency_stop, "another one asks"
    assert not rig.request.reset
    assert rig.say(ANN, Request.ARM).arm is False
    request = rig.say(ANN, Request.RESET)
    assert not request.emergency_stop
    assert request.reset
    assert request.motion == Motion.REST, "what was asked for before does not come back"


def test_a_reset_asks_for_a_while_and_no_longer_than_until_the_arm(rig):
    assert rig.say(ANN, Request.RESET).reset
    assert rig.step(CONFIG.reset_ns // (2 * MS)).reset
    assert not rig.step().reset
    rig.say(ANN, Request.RESET)
    assert not rig.say(ANN, Request.ARM).reset


def test_a_velocity_is_passed_on_with_its_time_until_another_motion_is_asked_for(rig):
    walking(rig)
    request = rig.say(ANN, Request.VELOCITY, velocity=(0.3, -0.1, 0.2))
    assert (request.steering, request.velocity_ns) == (Steering.VELOCITY, rig.now_ns)
    np.testing.assert_array_equal(request.velocity, (0.3, -0.1, 0.2))
    assert request.motion == Motion.WALK
    assert rig.say(ANN, Request.LIFE).steering == Steering.VELOCITY
    assert rig.say(ANN, Request.MOTION, Motion.WALK).steering == Steering.VELOCITY, "it walks already"
    assert rig.say(ANN, Request.MOTION, Motion.STAND).steering == Steering.PATH


def test_a_lease_that_ends_takes_its_velocity_along(rig):
    walking(rig)
    rig.say(ANN, Request.VELOCITY, velocity=(0.3, 0.0, 0.0))
    request = rig.step(1 + CONFIG.lease_ns // (2 * MS))
    assert request.steering == Steering.PATH
    assert not request.velocity.any()


@pytest.mark.parametrize(
    "spoil",
    [
        {"request": 8},
        {"request": 255},
        {"motion": 4},
        {"velocity": np.nan},
        {"velocity": np.inf},
        {"stamp_ns": 0},
        {"stamp_ns": 1 << 60},
    ],
)
def test_what_cannot_be_understood_is_counted_and_changes_nothing(rig, spoil):
    walking(rig)
    event = rig.event
    event.sequence, event.stamp_ns, event.source, event.priority = 99, rig.now_ns, BEN, 200
    event.request, event.motion = Request.MOTION, Motion.SIT
    for name, value in spoil.items():
        setattr(event, name, value)
    request = rig.step()
    assert request.malformed == 1
    assert (request.holder, request.motion) == (ANN, Motion.WALK)


def test_an_event_is_taken_once(rig):
    rig.say(ANN, Request.LIFE)
    rig.say(BEN, Request.LIFE)
    rig.step(50)
    assert rig.request.refused == 1


def test_events_without_a_sequence_differ_by_their_stamps(rig):
    for _ in range(3):
        rig.event.source, rig.event.stamp_ns = ANN, rig.now_ns
        request = rig.step()
        assert request.stamp_ns == rig.event.stamp_ns


@given(st.lists(st.tuples(*(st.integers(0, 255),) * 4, st.floats(), st.integers(-(2**62), 2**62)), max_size=30))
def test_whatever_arrives_nothing_is_raised_and_only_the_armed_holder_walks(said):
    rig = Rig()
    for source, priority, kind, motion, velocity, stamp_ns in said:
        event = rig.event
        event.sequence += 1
        event.source, event.priority, event.request, event.motion = source % 3, priority, kind % 10, motion % 6
        event.velocity, event.stamp_ns = velocity, stamp_ns if stamp_ns % 3 else rig.now_ns
        request = rig.step()
        assert request.motion in set(Motion)
        assert np.isfinite(request.velocity).all()
        assert request.stamp_ns <= rig.now_ns
        assert request.held or request.motion != Motion.WALK
        assert not (request.reset and request.arm)
        assert rig.now_ns - request.stamp_ns <= CONFIG.lease_ns or not request.held


def test_saved_and_restored_it_grants_the_same(rig):
    walking(rig)
    rig.say(ANN, Request.VELOCITY, velocity=(0.3, 0.0, 0.1))
    twin = Rig()
    twin.now_ns = rig.now_ns
    twin.event.copy_from(rig.event)
    twin.task.restore(rig.task.save())
    assert twin.step().to_bytes() == rig.step().to_bytes()
