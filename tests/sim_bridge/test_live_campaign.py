# SPDX-License-Identifier: Apache-2.0
"""Faults in real time are tried until each has shown something, on a robot of the configuration that it asks for."""

from types import SimpleNamespace

import pytest

from sim_bridge.faults import live_campaign
from sim_bridge.faults.live_campaign import TRIES, campaign
from sim_bridge.faults.live_judge import Verdict
from sim_bridge.faults.live_row import LiveRow
from sim_bridge.faults.live_table import DAMP, LIVE_ROWS

PLAIN = [LiveRow(name, DAMP) for name in ("one", "two")]
OTHER = LiveRow("other", DAMP, settings={"safety.motor_fault": "derate"})


@pytest.fixture
def sessions(monkeypatch):
    """Names of the rows of each session; a trial shows something unless its name is in `spoiled`."""
    played, spoiled = [], []

    def play(rows, seed, logs, told):
        played.append([row.name for row in rows])
        return [SimpleNamespace(row=row) for row in rows]

    def judged(episode, logs, config):
        flaws, stall_ms = (("it fell",), 40.0) if episode.row.name in spoiled else ((), 0.0)
        derates = config.safety.motor_fault == "derate"
        assert derates == bool(episode.row.settings), "judged by the bounds of its own robot"
        return Verdict(episode.row.name, DAMP, DAMP, 1.0, 1.0, True, flaws, stall_ms, bool(flaws))

    monkeypatch.setattr(live_campaign, "play", play)
    monkeypatch.setattr(live_campaign, "judged", judged)
    monkeypatch.setattr(live_campaign, "LiveLogs", lambda *_: None)
    monkeypatch.setattr(live_campaign, "moved_unarmed", lambda _: [])
    return SimpleNamespace(played=played, spoiled=spoiled)


def test_rows_of_one_configuration_share_a_robot(sessions):
    done = campaign([PLAIN[0], OTHER, PLAIN[1]], 1, 0, None, print)
    assert sessions.played == [["one", "two"], ["other"]]
    assert all(len(done.shown(name)) == 1 for name in ("one", "two", "other"))


def test_what_shows_nothing_is_tried_again_but_not_for_ever(sessions):
    sessions.spoiled += ["two", "other"]
    done = campaign([*PLAIN, OTHER], 1, 0, None, print)
    assert sessions.played.count(["other"]) == TRIES
    assert [names for names in sessions.played if "other" not in names] == [["one", "two"]] + [["two"]] * (TRIES - 1)
    assert not done.shown("two")


def test_the_table_asks_for_few_robots():
    assert len({tuple(row.settings.items()) for row in LIVE_ROWS}) <= 3
