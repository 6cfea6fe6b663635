# SPDX-License-Identifier: Apache-2.0
"""A trial in real time is judged by its log, by what the drives saw, and by the stalls of the machine."""

import numpy as np
import pytest
from story import AT_NS, CONFIG, LOOPS, MS, PERIOD_NS, Story, damped, episode_of

from runtime.executors.tick import TICK_TOPIC_PREFIX, tick_record
from runtime.recording.log import Signal
from runtime.recording.stalls import Stall
from runtime.signals import Fault, Mode
from sim_bridge.faults.live_judge import (
    INEXCUSABLE,
    STILL_DRIVEN,
    judged,
    moved_unarmed,
    oldest_command_ns,
    while_recorded,
)
from sim_bridge.faults.live_logs import FAST, LiveLogs
from sim_bridge.faults.live_session import Frames


def test_an_answer_in_time_is_as_expected_with_its_time():
    verdict = judged(episode_of("emergency stop", 12), damped(10), CONFIG)
    assert verdict.flaws == ()
    assert verdict.answer == ("damp",)
    assert verdict.time_ms == pytest.approx(10, abs=PERIOD_NS / MS)


@pytest.mark.parametrize(
    ("story", "episode", "flaw"),
    [
        (Story(), episode_of("emergency stop"), "answer is walk on"),
        (damped(400), episode_of("emergency stop", 401), "took"),
        (damped(10, Fault.TILT), episode_of("emergency stop", 12), "EMERGENCY_STOP was not named"),
        (damped(10), episode_of("emergency stop", 12, joints_kept=False), "a joint passed its limits"),
        (damped(10), episode_of("emergency stop", 12, fell=True), "it fell"),
        (damped(10), episode_of("emergency stop"), "the drives never let go"),
    ],
)
def test_what_is_not_as_it_is_to_be_is_said_and_a_stall_alone_excuses_it_not(story, episode, flaw):
    for stalls in ([], [Stall("sim", AT_NS, 20 * MS)]):
        story.stalls = stalls
        verdict = judged(episode, story, CONFIG)
        assert any(flaw in found for found in verdict.flaws)
        assert not verdict.shows_nothing


def lost_by(fault, after_ms=60):
    """An emergency stop that is answered by a crouch, since another fault came as well."""
    story = Story()
    story.becomes(after_ms * MS, Mode.CROUCHING)
    story.status["warning"][(AT_NS + after_ms * MS) // PERIOD_NS :] = fault | Fault.EMERGENCY_STOP
    return story


@pytest.mark.parametrize(
    ("fault", "loop", "stall_ms", "shows_nothing"),
    [
        (Fault.STALE_IMU, "sim", 15, False),
        (Fault.STALE_IMU, "link", 17, True),
        (Fault.STALE_IMU, "wbc", 50, False),
        (Fault.STALE_MOTOR, "sim", 7, True),
        (Fault.TILT, "sim", 50, False),
        (Fault.EMERGENCY_STOP, "sim", 50, False),
    ],
    ids=["below its bound", "beyond it", "of another loop", "beyond a lower one", "by no stall", "by the trial itself"],
)
def test_a_trial_shows_nothing_if_a_stall_beyond_its_bound_made_another_fault(fault, loop, stall_ms, shows_nothing):
    story = lost_by(fault)
    story.stalls = [Stall(loop, AT_NS + (60 - stall_ms) * MS, stall_ms * MS)]
    verdict = judged(episode_of("emergency stop"), story, CONFIG)
    assert verdict.flaws[0] == "answer is crouch"
    assert verdict.shows_nothing is shows_nothing
    assert verdict.stall_ms == stall_ms
    story.stalls = [Stall(loop, AT_NS - 300 * MS, stall_ms * MS)]
    assert not judged(episode_of("emergency stop"), story, CONFIG).shows_nothing, "long before the other fault"


def test_no_stall_excuses_joints_beyond_their_limits():
    story = lost_by(Fault.STALE_IMU)
    story.stalls = [Stall("sim", AT_NS + 30 * MS, 30 * MS)]
    assert judged(episode_of("emergency stop"), story, CONFIG).shows_nothing
    abused = judged(episode_of("emergency stop", joints_kept=False), story, CONFIG)
    assert set(abused.flaws) & INEXCUSABLE
    assert not abused.shows_nothing


def test_no_stall_excuses_drives_that_are_seen_not_to_let_go():
    story = lost_by(Fault.STALE_IMU)
    story.becomes(600 * MS, Mode.DAMPED)
    for stall_ms, excused in ((30, False), (290, True)):
        story.stalls = [Stall("sim", AT_NS + 30 * MS, stall_ms * MS)]
        verdict = judged(episode_of("emergency stop"), story, CONFIG)
        assert (STILL_DRIVEN in verdict.flaws) is not excused
        assert verdict.shows_nothing is excused


def test_stalls_of_loops_that_the_fault_itself_holds_up_excuse_nothing():
    story = Story()
    story.becomes(60 * MS, Mode.DAMPED)
    story.status["warning"][(AT_NS + 60 * MS) // PERIOD_NS :] = Fault.STALE_IMU | Fault.STALE_MOTOR
    story.stalls = [Stall("link", AT_NS, 60 * MS)]
    assert not judged(episode_of("link killed", 62), story, CONFIG).shows_nothing
    story.stalls.append(Stall("sim", AT_NS + 50 * MS, 10 * MS))
    assert judged(episode_of("link killed", 62), story, CONFIG).shows_nothing


def test_a_stall_gives_so_much_more_time():
    story = damped(50)
    assert judged(episode_of("emergency stop", 52), story, CONFIG).flaws
    story.stalls = [Stall("link", AT_NS, 40 * MS)]
    assert judged(episode_of("emergency stop", 52), story, CONFIG).flaws == ()


def test_ticks_that_are_missing_for_less_time_than_a_stall_took_are_excused():
    story = damped(10)
    story.loses(960, 963)
    for stall_ms, excused in ((5, False), (7, True)):
        story.stalls = [Stall("sim", AT_NS - 100 * MS, stall_ms * MS)]
        verdict = judged(episode_of("emergency stop", 12), story, CONFIG)
        assert verdict.flaws == ("3 ticks before the fault are missing",)
        assert verdict.shows_nothing is excused


def test_without_control_the_drives_answer_for_the_robot():
    story = Story()
    story.loses(AT_NS // PERIOD_NS, 2000)
    verdict = judged(episode_of("control killed", 24), story, CONFIG)
    assert verdict.flaws == ()
    assert verdict.time_ms == 24.0
    assert judged(episode_of("control killed", 60), story, CONFIG).flaws != ()


def test_a_log_must_be_whole_up_to_the_fault_and_go_on_after_it():
    for first, last, flaw in ((960, 963, "3 ticks"), (985, 1000, "the log lacks the last"), (1300, 2000, "nothing is")):
        story = damped(10)
        story.loses(first, last)
        assert any(flaw in found for found in judged(episode_of("emergency stop", 12), story, CONFIG).flaws), flaw


def test_nobody_drives_a_robot_without_power_and_control_begins_in_standby():
    story = damped(10)
    assert moved_unarmed(story) == []
    story.command["stiffness"][-1] = 1.0
    assert len(moved_unarmed(story)) == 1
    story = Story()
    story.status["mode"][0] = Mode.DAMPED
    assert moved_unarmed(story) == ["control began in DAMPED"]


def test_the_age_of_a_command_is_that_of_the_newest_with_its_bytes():
    sent = np.zeros(3, [("stamp_ns", "<i8"), ("count", "<u4"), ("bus", "u1", (2,)), ("data", "u1", (32,))])
    sent["stamp_ns"], sent["count"] = (10, 20, 30), (1, 1, 2)
    sent["data"][0, :16], sent["data"][1, :16], sent["data"][2, :16] = 1, 1, 2
    sent["data"][2, 16:], sent["bus"][2, 1] = 1, 1
    signal = Signal(sent["stamp_ns"], sent)

    def oldest(arrival_ns, bus, byte):
        frames = Frames(np.array([arrival_ns]), np.array([bus], np.uint8), np.full((1, 16), byte, np.uint8))
        return oldest_command_ns(frames, signal)

    assert oldest(26, 0, 1) == 6
    assert oldest(15, 0, 1) == 5
    assert oldest(40, 1, 1) == 10
    assert oldest(40, 0, 9) == 0, "of what is not in the log nothing is known"


def test_of_frames_that_arrive_while_ticks_are_lost_nothing_is_known():
    ticks = np.zeros(4, tick_record(LOOPS[0]).dtype)
    ticks["index"], ticks["skipped"], ticks["now_ns"] = [1, 2, 10, 14], [0, 0, 0, 3], np.array([2, 4, 20, 28]) * MS
    arrivals = np.array([3, 4, 5, 20, 30, 31]) * MS
    frames = Frames(arrivals, np.zeros(6, np.uint8), np.zeros((6, 16), np.uint8))
    assert while_recorded(frames, ticks).arrival_ns.tolist() == [3 * MS, 4 * MS, 31 * MS]


def test_logs_of_several_bags_are_one(tmp_path, write_bag):
    write_bag(tmp_path / "a", range(500, 600), late=[550])
    write_bag(tmp_path / "b", range(100, 200), late=[150])
    (tmp_path / "begun but empty").mkdir()
    logs = LiveLogs(tmp_path, ())
    assert [log.path.parent.name for log in logs.bags] == ["b", "a"]
    indices = logs.whole(TICK_TOPIC_PREFIX + FAST).values["index"].tolist()
    assert indices == [*range(100, 200), *range(500, 600)]
    across = logs.ticks(190 * PERIOD_NS, 510 * PERIOD_NS)
    assert across["index"].tolist() == [*range(190, 200), *range(500, 510)]
    assert [stall.at_ns for stall in logs.stalls] == [150 * PERIOD_NS, 550 * PERIOD_NS]
    assert [s.at_ns for s in logs.stalls_between(500 * PERIOD_NS, 600 * PERIOD_NS)] == [550 * PERIOD_NS]


def test_without_a_bag_there_is_no_log(tmp_path):
    assert LiveLogs(tmp_path, ()).bags == []
