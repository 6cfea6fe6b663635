# SPDX-License-Identifier: Apache-2.0
"""A joint that passes a limit is seen, also by way of a torque that its motor could never give."""

from types import SimpleNamespace

import numpy as np
import pytest

from drivers.dialects import CLASSIC_8
from drivers.joint_group import JointGroup
from runtime.robots import load_configuration
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.faults.attempt import attempt
from sim_bridge.faults.joint_limits import ASKED_MARGIN_NM, JointLimits
from sim_bridge.faults.table import WALK_ON
from sim_bridge.faults.table_parts import at_once
from sim_bridge.faults.trial import flaws
from sim_bridge.faults.walk import WalkRow
from sim_bridge.quadruped_world import drive_model
from sim_bridge.virtual_drive import VirtualDrives

CONFIG = load_configuration("uslgo1")
assert isinstance(CONFIG, Uslgo1Config)
SAFETY, LIMITS, KNEE = CONFIG.safety, JointLimits(CONFIG.safety), 5


def standing():
    drives = SimpleNamespace(asked=np.zeros(12))
    angles = CONFIG.quadruped.standing_angles(0.3)
    return SimpleNamespace(joint_angles=angles, joint_velocities=np.zeros(12), drives=drives)


BEYOND = {
    "angle": lambda world, more: world.joint_angles.__setitem__(
        KNEE, SAFETY.position_max_rad[2] + SAFETY.position_margin_rad + more
    ),
    "speed": lambda world, more: world.joint_velocities.__setitem__(KNEE, -SAFETY.velocity_max_radps - more),
    "torque": lambda world, more: world.drives.asked.__setitem__(KNEE, -SAFETY.effort_max_nm - ASKED_MARGIN_NM - more),
}


@pytest.mark.parametrize("quantity", BEYOND)
def test_each_limit_is_seen_to_be_passed_and_not_before(quantity):
    world = standing()
    BEYOND[quantity](world, -0.01)
    assert LIMITS.kept(world)
    BEYOND[quantity](world, 0.01)
    assert not LIMITS.kept(world)


@pytest.mark.parametrize("asked_nm", [30.0, -30.0, 45.0, -45.0])
def test_what_a_drive_is_asked_for_is_seen_though_its_motor_gives_no_more_than_it_can(asked_nm):
    joints = CONFIG.drives.joints(SAFETY)
    drives = VirtualDrives(joints, CLASSIC_8, drive_model(CONFIG.simulation), 0)
    group = JointGroup(joints, CLASSIC_8, 10**12)
    world = SimpleNamespace(**{**vars(standing()), "drives": drives})
    effort, stiffness = 0.5 * asked_nm, 50.0
    target = world.joint_angles + (asked_nm - effort) / stiffness
    commands = (target, np.zeros(12), np.full(12, effort), np.full(12, stiffness), np.zeros(12))
    for frames in (group.enable_frames(), group.encode(*commands, 0, 0)):
        drives.answer(frames, group.bus[: len(frames)], np.zeros(len(frames), np.int64))
    given = drives.torque(world.joint_angles, world.joint_velocities, 0)
    np.testing.assert_allclose(drives.asked, asked_nm, atol=0.3)
    assert (np.abs(given) <= CONFIG.simulation.peak_torque_nm).all()
    assert LIMITS.kept(world) == (abs(asked_nm) < SAFETY.effort_max_nm)


def test_a_trial_in_which_a_joint_is_thrown_faster_than_it_may_be_is_not_as_it_is_to_be():
    def throw(wires, begin_ns, end_ns):
        def event(now_ns):
            if now_ns >= begin_ns:
                wires.world.data.qvel[6 + KNEE] = -1.5 * SAFETY.velocity_max_radps

        wires.events.append(event)

    row = WalkRow("a knee thrown", throw, WALK_ON, at_once)
    assert "a limit was passed" in flaws(row, attempt(row, 0), CONFIG)
