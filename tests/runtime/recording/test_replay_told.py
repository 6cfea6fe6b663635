# SPDX-License-Identifier: Apache-2.0
"""`ugv replay` lists the stretches of a log with gaps, the gaps, and how much of it was stepped again."""

import re

import pytest

from runtime import robots
from runtime.cli.main import main
from runtime.recording.log import Log
from runtime.recording.replay import Replay


@pytest.fixture
def told(toy, monkeypatch, capsys):
    """What `ugv replay` prints of a log of the tiny robot, and the exit code, which must be 0."""
    monkeypatch.setattr(robots, "ROBOTS", ("toy",))
    monkeypatch.setattr(robots, "assemble", lambda robot, config, overrides: toy.loops())

    def replayed(run, *options):
        assert main(["replay", str(run), *options]) == 0
        return capsys.readouterr().out

    return replayed


def lossy(toy, directory, lost):
    """A log without some of the ticks of the fast loop."""
    kept, index = [], 0
    for datagram in toy.datagrams():
        fast = int.from_bytes(datagram[:2], "little") == 0
        if not (fast and index in lost):
            kept.append(datagram)
        index += fast
    return toy.written(kept, directory)


def cells(text):
    """Rows of the tables."""
    return [[cell.strip() for cell in line.strip("│").split("│")] for line in text.splitlines() if line[:1] == "│"]


def test_a_log_with_a_gap_is_told_by_stretches_gaps_and_share(toy, told, tmp_path):
    run = lossy(toy, tmp_path / "run", range(120, 123))
    text = told(run)
    rows = cells(text)
    assert ["fast", "0.000", "0.238", "0", "119", "120", "yes"] in rows
    assert ["fast", "0.400", "0.498", "200", "249", "50", "yes"] in rows
    assert "fast: up to 3 ticks are missing between tick 119 (0.238 s) and tick 123 (0.246 s)" in text
    result = Replay(Log(run), toy.loops(), "toy").run()
    share = f"{100 * result.stepped / 272:.4g}"
    assert 0 < result.stepped < 272
    assert f"{share} % of 272 recorded ticks were stepped again" in text
    assert text.rstrip().endswith("signals compared: identical over every gap-free stretch")
    assert sum(int(row[5]) for row in rows if len(row) == 7) == result.stepped


def test_a_log_without_a_gap_is_told_to_be_stepped_as_a_whole(toy, told, recorded):
    text = told(recorded)
    assert "Stretches" not in text
    assert "missing" not in text
    assert "100 % of 275 recorded ticks were stepped again" in text
    assert re.search(r"\d+ steps, \d+ signals compared: identical$", text.rstrip())


def test_a_log_that_begins_late_says_from_which_tick_on(toy, told, tmp_path):
    run = toy.written(toy.datagrams(seconds=1.0)[100:], tmp_path / "run")
    text = told(run)
    assert "fast is recorded from its tick 91 on" in text
    assert [row[:1] + row[3:5] for row in cells(text) if len(row) == 7] == [
        ["fast", "150", "499"],
        ["slow", "15", "49"],
    ]
