# SPDX-License-Identifier: Apache-2.0
"""The gait as it is lived: starts, stops, early and late ground."""

import numpy as np
import pytest

from runtime.legged.gait_task import GaitTask
from runtime.signals import Fault, Mode, Stance

MS = 1_000_000


class Walk:
    """A robot whose feet obey their references, and meet the ground when told."""

    def __init__(self, robot):
        self.robot = robot
        config = robot.config
        records = robot.body, robot.command, robot.safety, robot.posture, robot.gait
        self.task = GaitTask(config.quadruped, config.gait, config.swing, config.foothold, *records)
        # it has stood before
        wanted, robot.safety.mode = robot.safety.mode, Mode.STANDING
        self.task.step(998 * MS)
        robot.safety.mode = wanted
        self.now_ns = 1000 * MS
        robot.command.velocity = (0.6, 0.0)

    def step(self, contact=None):
        gait, body = self.robot.gait, self.robot.body
        self.task.step(self.now_ns)
        feet = np.where(np.repeat(gait.contact, 3), body.foot_position, gait.swing_position)
        body.foot_position = feet
        body.contact = gait.stance if contact is None else contact
        self.now_ns += 2 * MS

    def run(self, milliseconds, **options):
        for _ in range(milliseconds // 2):
            self.step(**options)


def test_it_trots_when_active_and_asked_to_move(bench):
    walk = Walk(bench())
    walk.step()
    assert walk.robot.gait.walking
    assert walk.robot.gait.cycle_start_ns == 1000 * MS
    schedules = set()
    for _ in range(200):
        walk.step()
        schedules.add(tuple(walk.robot.gait.stance.tolist()))
    assert schedules == {(True, False, False, True), (False, True, True, False)}


def test_without_permission_or_wish_it_stands(bench):
    for change in (
        lambda robot: setattr(robot.safety, "mode", Mode.STANDING),
        lambda robot: setattr(robot.command, "velocity", (0.0, 0.01)),
        lambda robot: setattr(robot.posture, "stance", Stance.RISING),
    ):
        walk = Walk(bench())
        change(walk.robot)
        walk.run(500)
        assert not walk.robot.gait.walking
        assert walk.robot.gait.stance.all()
        assert walk.robot.gait.contact.all()


def test_turning_in_place_is_a_reason_to_step(bench):
    walk = Walk(bench())
    walk.robot.command.velocity, walk.robot.command.yaw_rate = (0.0, 0.0), 0.5
    walk.step()
    assert walk.robot.gait.walking


def test_it_stops_at_the_end_of_a_cycle_only(bench):
    walk = Walk(bench())
    walk.run(700)
    walk.robot.command.velocity = (0.0, 0.0)
    while walk.robot.gait.walking:
        walk.step()
    assert (walk.now_ns - 2 * MS - 1000 * MS) % (400 * MS) == 0
    assert walk.robot.gait.contact.all()


def test_a_robot_that_is_damped_does_not_step(bench):
    walk = Walk(bench())
    walk.run(500)
    walk.robot.safety.mode = Mode.DAMPED
    walk.step()
    assert not walk.robot.gait.balancing
    assert not walk.robot.gait.walking


def test_contact_right_after_lift_off_is_not_a_touchdown(bench):
    walk = Walk(bench())
    # feet report load all the time; the two in the air do so from the start of their swing on
    walk.step(contact=True)
    for _ in range(55):
        walk.step(contact=True)
        assert walk.robot.gait.contact.tolist() == [True, False, False, True]
    assert walk.robot.gait.early_contacts == 0


def test_ground_that_comes_early_ends_the_swing(bench):
    walk = Walk(bench())
    walk.run(160)
    assert not walk.robot.gait.contact[1]
    walk.step(contact=[True, True, False, True])
    place = walk.robot.body.foot_position[3:6].copy()
    walk.step(contact=[True, True, False, True])
    assert walk.robot.gait.contact.tolist() == [True, True, False, True]
    assert walk.robot.gait.early_contacts == 1
    np.testing.assert_array_equal(walk.robot.gait.foothold[3:6], place)


def test_ground_that_comes_late_is_searched_for_and_counted(bench):
    walk = Walk(bench())
    before_late = walk.robot.gait.late_contacts
    walk.run(202, contact=[True, False, False, True])
    # now the right front foot is scheduled to stand, but there is nothing below it
    heights = []
    for _ in range(40):
        walk.step(contact=[False, False, True, False])
        heights.append(walk.robot.gait.swing_position[5])
        assert not walk.robot.gait.contact[1]
    assert np.diff(heights).max() < 0
    assert heights[0] - heights[-1] > 0.01
    walk.step(contact=[False, True, True, False])
    walk.step(contact=[False, True, True, False])
    assert walk.robot.gait.contact[1]
    assert walk.robot.gait.late_contacts > before_late


def test_footholds_are_on_the_stance_plane(bench):
    robot = bench()
    slope = 0.3
    normal = np.array([-np.sin(slope), 0.0, np.cos(slope)])
    robot.body.plane_normal = normal
    walk = Walk(robot)
    walk.run(100)
    center = robot.body.position - (0, 0, robot.body.height)
    for foot in (1, 2):
        point = robot.gait.foothold[3 * foot : 3 * foot + 3] - normal * robot.robot.foot_radius_m
        assert abs(float((point - center) @ normal)) < 1e-9


def test_a_standing_foot_without_load_searches_for_the_ground_again_and_is_counted(bench):
    walk = Walk(bench())
    walk.run(20)
    first = [True, False, False, True]
    assert walk.robot.gait.contact.tolist() == first
    # the last step that fed contact was seen at the begin of the next one
    walk.step(contact=[False, False, False, True])
    for _ in range(10):
        walk.step(contact=[False, False, False, True])
        assert walk.robot.gait.contact.tolist() == first, "20 ms are borne"
    walk.step(contact=[False, False, False, True])
    assert walk.robot.gait.contact.tolist() == [False, False, False, True]
    assert walk.robot.gait.lost_contacts == walk.task.state.lost_contacts == 1
    late, heights = walk.robot.gait.late_contacts, []
    for _ in range(10):
        walk.step(contact=[False, False, False, True])
        heights.append(walk.robot.gait.swing_position[2])
    assert np.diff(heights).max() < 0.0
    assert walk.robot.gait.lost_contacts == 1, "a foot is lost once"
    walk.step(contact=first)
    walk.step(contact=first)
    assert walk.robot.gait.contact.tolist() == first
    assert walk.robot.gait.late_contacts == late + 1


def test_load_that_returns_within_the_bound_is_no_loss(bench):
    walk = Walk(bench())
    walk.run(20)
    for _ in range(8):
        for _ in range(9):
            walk.step(contact=[False, False, False, True])
        walk.step(contact=[True, False, False, True])
    assert walk.robot.gait.lost_contacts == 0


def test_a_robot_that_only_stands_loses_no_contact(bench):
    walk = Walk(bench())
    walk.robot.command.velocity = (0.0, 0.0)
    walk.run(200, contact=False)
    assert walk.robot.gait.contact.all()
    assert walk.robot.gait.lost_contacts == 0
    # nor at once when it begins to walk with load on its feet again
    walk.step(contact=True)
    walk.robot.command.velocity = (0.6, 0.0)
    walk.step()
    assert walk.robot.gait.walking
    assert walk.robot.gait.lost_contacts == 0


@pytest.mark.parametrize("into_stance_ms", [60, 100])
def test_the_search_of_a_lost_foot_begins_where_the_foot_is(bench, into_stance_ms):
    walk = Walk(bench())
    walk.run(into_stance_ms)
    walk.step(contact=[False, False, False, True])
    while walk.robot.gait.contact[0]:
        place = walk.robot.body.foot_position[2]
        walk.step(contact=[False, False, False, True])
    assert abs(walk.robot.gait.swing_position[2] - place) < 0.005


@pytest.mark.parametrize("fault", [Fault.STALE_FORCES, Fault.STALE_BODY_COMMAND])
@pytest.mark.parametrize("after_ms", [10, 150, 250, 390])
def test_a_gait_that_nobody_leads_stops_when_the_feet_change(bench, fault, after_ms):
    walk = Walk(bench())
    walk.run(after_ms)
    walk.robot.safety.halt = fault
    half_ms = walk.robot.config.gait.period_ns // 2 // MS
    walk.run(half_ms - after_ms % half_ms)
    assert walk.robot.gait.walking, "feet in the air must land first"
    walk.step()
    walk.step()
    assert not walk.robot.gait.walking
    assert walk.robot.gait.contact.all()
    walk.run(1000)
    assert not walk.robot.gait.walking, "the old command does not start it again"
    walk.robot.safety.halt = 0
    walk.step()
    assert walk.robot.gait.walking


def test_a_robot_that_others_slow_down_walks_on_until_it_is_slow(bench):
    walk = Walk(bench())
    walk.robot.safety.halt = Fault.STALE_LOCALIZATION
    walk.run(1000)
    assert walk.robot.gait.walking
    walk.robot.command.velocity = 0.0
    walk.run(walk.robot.config.gait.period_ns // MS + 4)
    assert not walk.robot.gait.walking
