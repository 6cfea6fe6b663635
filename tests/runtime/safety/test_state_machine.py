# SPDX-License-Identifier: Apache-2.0
"""Every input in every state: 5 modes x healthy x armed x reset x 4 motions x 4 stances."""

import itertools

import pytest

from runtime.safety.state_machine import next_mode
from runtime.signals import Mode, Motion, Stance

INPUTS = list(itertools.product((False, True), (False, True), (False, True), Motion, Stance))
POWERED = {Mode.STANDING, Mode.ACTIVE}


def transitions():
    for mode in Mode:
        for inputs in INPUTS:
            yield mode, *inputs, next_mode(mode, *inputs)


TABLE = list(transitions())


def test_the_table_is_complete():
    assert len(TABLE) == 5 * 2 * 2 * 2 * 4 * 4
    assert all(isinstance(after, Mode) for *_, after in TABLE)


def test_damped_is_latched():
    """It is left only to STANDBY, by a healthy robot, on a reset, with the arm withdrawn."""
    for mode, healthy, armed, reset, _, _, after in TABLE:
        if mode == Mode.DAMPED:
            assert after == (Mode.STANDBY if healthy and reset and not armed else Mode.DAMPED)


def test_power_comes_only_from_standby_by_a_healthy_armed_robot_that_is_asked_to_stand():
    for mode, healthy, armed, _, motion, _, after in TABLE:
        if after in POWERED and mode not in POWERED:
            assert (mode, healthy, armed, after) == (Mode.STANDBY, True, True, Mode.STANDING)
            assert motion in (Motion.STAND, Motion.WALK)


def test_a_fault_under_power_damps_at_once():
    for mode, healthy, _, _, _, _, after in TABLE:
        if mode in POWERED and not healthy:
            assert after == Mode.DAMPED


def test_a_fault_in_standby_is_latched_too():
    for mode, healthy, *_, after in TABLE:
        if mode == Mode.STANDBY and not healthy:
            assert after == Mode.DAMPED


def test_nothing_unhealthy_is_or_becomes_powered():
    for _, healthy, *_, after in TABLE:
        assert healthy or after not in POWERED


def test_withdrawing_the_arm_always_takes_the_power():
    for mode, _, armed, _, motion, stance, after in TABLE:
        if not armed:
            assert after not in POWERED
            if mode in POWERED:
                resting = stance == Stance.RESTING and motion in (Motion.REST, Motion.SIT)
                assert after == Mode.DAMPED or resting


def test_walking_takes_a_robot_that_stands():
    for mode, _, _, _, motion, stance, after in TABLE:
        if after == Mode.ACTIVE:
            assert mode in POWERED
            assert motion == Motion.WALK
            assert mode == Mode.ACTIVE or stance == Stance.STANDING


def test_only_a_reset_matters_in_damped_and_nowhere_else():
    for mode, healthy, armed, reset, motion, stance, after in TABLE:
        if mode != Mode.DAMPED:
            assert next_mode(mode, healthy, armed, not reset, motion, stance) == after


def test_off_is_left_once_and_never_returned_to():
    for mode, healthy, *_, after in TABLE:
        if mode == Mode.OFF:
            assert after == (Mode.STANDBY if healthy else Mode.OFF)
        else:
            assert after != Mode.OFF


def reachable(start, allowed):
    """Every mode that some sequence of the allowed inputs leads to."""
    found, waiting = {start}, [start]
    while waiting:
        mode = waiting.pop()
        for inputs in allowed:
            after = next_mode(mode, *inputs)
            if after not in found:
                found.add(after)
                waiting.append(after)
    return found


@pytest.mark.parametrize("start", [Mode.OFF, Mode.STANDBY, Mode.DAMPED])
def test_without_an_arm_no_sequence_leads_to_power(start):
    assert not POWERED & reachable(start, [row for row in INPUTS if not row[1]])


def test_out_of_damped_no_sequence_leads_to_power_while_the_arm_is_held():
    assert reachable(Mode.DAMPED, [row for row in INPUTS if row[1]]) == {Mode.DAMPED}


def test_every_mode_can_be_reached_and_left():
    assert reachable(Mode.OFF, INPUTS) == set(Mode)
    assert reachable(Mode.DAMPED, INPUTS) >= POWERED


def test_the_ordinary_day():
    day = [
        ((True, False, False, Motion.REST, Stance.RESTING), Mode.STANDBY),
        ((True, True, False, Motion.STAND, Stance.RESTING), Mode.STANDING),
        ((True, True, False, Motion.WALK, Stance.RISING), Mode.STANDING),
        ((True, True, False, Motion.WALK, Stance.STANDING), Mode.ACTIVE),
        ((True, True, False, Motion.STAND, Stance.STANDING), Mode.STANDING),
        ((True, True, False, Motion.SIT, Stance.SITTING), Mode.STANDING),
        ((True, True, False, Motion.SIT, Stance.RESTING), Mode.STANDBY),
    ]
    mode = Mode.OFF
    for inputs, expected in day:
        mode = next_mode(mode, *inputs)
        assert mode == expected
