# SPDX-License-Identifier: Apache-2.0
"""A robot of which a process is killed must be safe within the bound of that fault, and no old command may be sent."""

import kills
import numpy as np
import pytest
from story import AT_NS, CONFIG, MS, PERIOD_NS, Story, damped, episode_of

from runtime.recording.stalls import Stall
from runtime.robots import topics
from runtime.signals import Fault, Mode
from sim_bridge.faults.live_session import Frames
from sim_bridge.faults.live_table import CARRIED_NS, let_go_in_real_time

CRASHED = "control killed at 2.000 s: "
AT_TICK = AT_NS // PERIOD_NS


def killed(victim, released_ms=None, frames=None, **seen):
    episode = episode_of(f"{victim} killed", released_ms, **seen)
    return kills.Kill(victim, AT_NS, (), episode if frames is None else episode._replace(frames=frames))


def without_control():
    story = Story()
    story.loses(AT_TICK, 2000)
    return story


def crouches(after_ms):
    """A robot that crouches so long after its link was killed, and is damped half a second later."""
    story = Story()
    story.becomes(after_ms * MS, Mode.CROUCHING)
    story.becomes((after_ms + 500) * MS, Mode.DAMPED)
    story.status["warning"][AT_TICK + after_ms // 2 :] = Fault.STALE_IMU
    return story


def walks_on():
    return Story()


@pytest.mark.parametrize(
    ("story", "kill"),
    [
        (without_control(), killed("control", 24)),
        (crouches(20), killed("link", 522)),
        (walks_on(), killed("recorder")),
        (damped(100), kills.Kill("sim", AT_NS)),
    ],
    ids=kills.VICTIMS,
)
def test_a_kill_that_is_answered_in_time_is_no_finding(story, kill):
    assert kills.judge(story, [kill], CONFIG) == []


def test_drives_must_let_go_within_their_time_out_and_a_stall_that_may_be_why_is_named():
    bound_ms = let_go_in_real_time(CONFIG) // MS
    assert bound_ms < 30
    assert kills.judge(without_control(), [killed("control", bound_ms)], CONFIG) == []
    late = killed("control", bound_ms + 20)
    assert kills.judge(without_control(), [late], CONFIG) == [f"{CRASHED}took 48 ms of 28 ms, stalls included"]
    story = without_control()
    story.stalls = [Stall("link", AT_NS - 100 * MS, 15 * MS)]
    assert kills.judge(story, [late], CONFIG)[0].endswith("(beside a stall of 15 ms)")
    story.stalls = [Stall("wbc", AT_NS + 1, 15 * MS)]
    assert not kills.judge(story, [late], CONFIG)[0].endswith("(beside a stall of 15 ms)"), "of control that begins"


@pytest.mark.parametrize(
    ("story", "kill", "finding"),
    [
        (without_control(), killed("control"), "answer is walk on"),
        (crouches(100 + CARRIED_NS // MS), killed("link", 632), "took"),
        (damped(20, Fault.STALE_IMU), killed("link", 22), "answer is damp"),
        (Story(), killed("link"), "answer is walk on"),
        (without_control(), killed("control", 24, joints_kept=False), "a joint passed its limits"),
        (Story(), killed("recorder", fell=True), "it fell"),
        (Story(), kills.Kill("sim", AT_NS), "control did not end DAMPED without its buses"),
        (Story(), kills.Kill("link", AT_NS, ("the robot is ACTIVE",)), "the robot is ACTIVE"),
    ],
)
def test_what_is_not_answered_or_too_late_is_a_finding(story, kill, finding):
    assert any(finding in found for found in kills.judge(story, [kill], CONFIG))


@pytest.mark.parametrize("kill", [killed("control", 24), killed("recorder"), kills.Kill("sim", AT_NS)])
def test_the_log_is_whole_but_for_the_last_moments_before_a_kill(kill):
    story = damped(100) if kill.victim == "sim" else Story()
    story.loses(AT_TICK - 15, AT_TICK)
    assert any("the log lacks the last 32.0 ms" in found for found in kills.judge(story, [kill], CONFIG))


@pytest.mark.parametrize("victim", ["control", "recorder"])
def test_a_command_that_reaches_a_drive_too_late_is_a_finding(victim):
    story = without_control() if victim == "control" else Story()
    sent = story.between(topics.CAN_SENT, 0, AT_NS).values
    sent["count"][-1], sent["data"][-1, :16] = 1, 7
    for age_ms, old in ((1, False), (40, True)):
        arrival_ns = int(sent["stamp_ns"][-1]) + age_ms * MS
        frames = Frames(np.array([arrival_ns]), np.zeros(1, np.uint8), np.full((1, 16), 7, np.uint8))
        kill = killed(victim, 24 if victim == "control" else None, frames)
        found = kills.judge(story, [kill], CONFIG)
        assert any("a command of 40.0 ms reached a drive" in finding for finding in found) is old


def test_a_robot_whose_recorder_is_killed_may_come_to_the_end_of_its_lap_and_stand():
    story = Story()
    story.gait["walking"][AT_TICK + 50 :] = False
    assert kills.judge(story, [killed("recorder")], CONFIG) == []
