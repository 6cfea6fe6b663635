# SPDX-License-Identifier: Apache-2.0
"""A recorder that begins several bags in one run costs neither its figures nor its report."""

import pytest

from runtime.executors.processes import ProcessError
from runtime.executors.resources import Resources
from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording.log import Log
from runtime.recording.report import write_report
from sim_bridge.live_run import growth, timings
from sim_bridge.run_bags import RunBags

TICK = TICK_TOPIC_PREFIX + "wbc"


@pytest.fixture
def out(tmp_path):
    directory = tmp_path / "run-7"
    directory.mkdir()
    return directory


def test_the_one_bag_of_a_run_becomes_the_log_of_its_directory(out, write_bag):
    write_bag(out / "toy-1", range(10))
    said = []
    bags = RunBags(out, said.append)
    assert (said, bags.others) == ([], [])
    assert sorted(path.name for path in out.iterdir()) == ["metadata.yaml", "run-7_0.mcap"]
    assert "toy-1" not in (out / "metadata.yaml").read_text()
    assert bags.longest.path == Log(out).path


def test_of_several_bags_the_longest_is_the_log_and_all_count(out, write_bag):
    write_bag(out / "toy-1", range(10), late=[3], late_ns=7_000_000)
    write_bag(out / "toy-2", range(20, 120))
    write_bag(out / "toy-3", range(130, 150))
    said = []
    bags = RunBags(out, said.append)
    assert said == ["the log is in 3 bags; the report is of the longest, run-7_0.mcap"]
    assert [directory.name for directory in bags.others] == ["toy-1", "toy-3"]
    assert Log(out).read_signal(TICK).values["index"].tolist() == list(range(20, 120))
    assert bags.read(TICK).values["index"].tolist() == [*range(10), *range(20, 120), *range(130, 150)]
    assert [len(log.read_signal(TICK).values) for log in bags] == [10, 100, 20]
    assert timings(bags, ["wbc"])["missed_deadlines"] == {"wbc": 0}
    assert write_report(out).exists()


def test_a_bag_that_cannot_be_read_is_told_and_the_rest_is_used(out, write_bag):
    write_bag(out / "toy-1", range(10))
    (out / "toy-2").mkdir()
    said = []
    assert RunBags(out, said.append).others == []
    assert len(said) == 1
    assert "toy-2 holds no .mcap file" in said[0]


def test_without_a_bag_there_is_one_sentence(out):
    with pytest.raises(ProcessError, match="made no bag of the run"):
        RunBags(out, lambda sentence: None)


def test_a_process_that_is_missing_at_a_sample_is_told():
    held = Resources(1000, 800, 10, 5)
    rows = [(1.0, {"link": held, "control": held}), (5.0, {"link": held}), (10.0, {"control": held})]
    assert growth(rows) == {
        "control": {"begun": held._asdict(), "early": None, "late": held._asdict()},
        "link": {"begun": held._asdict(), "early": held._asdict(), "late": None},
    }
