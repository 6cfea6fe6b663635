# SPDX-License-Identifier: Apache-2.0
"""Every input in every state: 6 modes x 3 healths x armed x reset x 4 motions x 5 stances x walking."""

import itertools

import pytest

from runtime.safety import state_machine
from runtime.safety.state_machine import Health
from runtime.signals import Mode, Motion, Stance

INPUTS = list(itertools.product(Health, (False, True), (False, True), Motion, Stance, (False, True)))
POWERED = {Mode.STANDING, Mode.ACTIVE, Mode.CROUCHING}


def next_mode(*inputs):
    """The kernel, which knows the numbers alone."""
    return Mode(state_machine.next_mode(*map(int, inputs)))


def transitions():
    for mode in Mode:
        for inputs in INPUTS:
            yield mode, *inputs, next_mode(mode, *inputs)


TABLE = list(transitions())


def test_the_table_is_complete():
    assert len(TABLE) == 6 * 3 * 2 * 2 * 4 * 5 * 2
    assert all(isinstance(after, Mode) for *_, after in TABLE)


def test_damped_is_latched():
    """It is left only to STANDBY, by a fit robot, on a reset, with the arm withdrawn."""
    for mode, health, armed, reset, *_, after in TABLE:
        if mode == Mode.DAMPED:
            assert after == (Mode.STANDBY if health == Health.FIT and reset and not armed else Mode.DAMPED)


def test_power_comes_only_from_standby_by_a_fit_armed_robot_that_is_asked_to_stand():
    for mode, health, armed, _, motion, _, _, after in TABLE:
        if after in POWERED and mode not in POWERED:
            assert (mode, health, armed, after) == (Mode.STANDBY, Health.FIT, True, Mode.STANDING)
            assert motion in (Motion.STAND, Motion.WALK)


def test_an_unfit_robot_loses_its_power_at_once():
    for mode, health, *_, after in TABLE:
        if mode in POWERED and health == Health.UNFIT:
            assert after == Mode.DAMPED


def test_a_blind_robot_crouches_unless_it_rests_already():
    for mode, health, armed, _, _, stance, _, after in TABLE:
        if mode in (Mode.STANDING, Mode.ACTIVE) and armed and health == Health.BLIND:
            assert after == (Mode.DAMPED if stance == Stance.RESTING else Mode.CROUCHING)


def test_crouching_comes_from_blindness_alone_and_leads_to_damped_alone():
    for mode, health, armed, _, _, stance, _, after in TABLE:
        if after == Mode.CROUCHING and mode != Mode.CROUCHING:
            assert health == Health.BLIND
        if mode == Mode.CROUCHING:
            ended = not armed or stance == Stance.RESTING or health == Health.UNFIT
            assert after == (Mode.DAMPED if ended else Mode.CROUCHING)


def test_a_fault_in_standby_is_latched_too():
    for mode, health, *_, after in TABLE:
        if mode == Mode.STANDBY and health != Health.FIT:
            assert after == Mode.DAMPED


def test_withdrawing_the_arm_always_takes_the_power():
    for mode, _, armed, _, motion, stance, _, after in TABLE:
        if not armed:
            assert after not in POWERED
            if mode in POWERED and after == Mode.STANDBY:
                assert stance == Stance.RESTING
                assert motion in (Motion.REST, Motion.SIT)


def test_walking_takes_a_robot_that_stands():
    for mode, _, _, _, motion, stance, _, after in TABLE:
        if after == Mode.ACTIVE and mode != Mode.ACTIVE:
            assert mode == Mode.STANDING
            assert motion == Motion.WALK
            assert stance == Stance.STANDING


def test_a_robot_that_walks_stays_active_until_it_has_come_to_a_stand():
    for mode, health, armed, _, motion, _, walking, after in TABLE:
        if mode == Mode.ACTIVE and health == Health.FIT and armed:
            assert after == (Mode.ACTIVE if walking or motion == Motion.WALK else Mode.STANDING)


def test_only_a_reset_matters_in_damped_and_nowhere_else():
    for mode, health, armed, reset, motion, stance, walking, after in TABLE:
        if mode != Mode.DAMPED:
            assert next_mode(mode, health, armed, not reset, motion, stance, walking) == after


def test_off_is_left_once_and_never_returned_to():
    for mode, health, *_, after in TABLE:
        if mode == Mode.OFF:
            assert after == (Mode.STANDBY if health == Health.FIT else Mode.OFF)
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
        ((Health.FIT, False, False, Motion.REST, Stance.RESTING, False), Mode.STANDBY),
        ((Health.FIT, True, False, Motion.STAND, Stance.RESTING, False), Mode.STANDING),
        ((Health.FIT, True, False, Motion.WALK, Stance.RISING, False), Mode.STANDING),
        ((Health.FIT, True, False, Motion.WALK, Stance.STANDING, False), Mode.ACTIVE),
        ((Health.FIT, True, False, Motion.STAND, Stance.STANDING, True), Mode.ACTIVE),
        ((Health.FIT, True, False, Motion.STAND, Stance.STANDING, False), Mode.STANDING),
        ((Health.FIT, True, False, Motion.SIT, Stance.SITTING, False), Mode.STANDING),
        ((Health.FIT, True, False, Motion.SIT, Stance.RESTING, False), Mode.STANDBY),
    ]
    mode = Mode.OFF
    for inputs, expected in day:
        mode = next_mode(mode, *inputs)
        assert mode == expected
