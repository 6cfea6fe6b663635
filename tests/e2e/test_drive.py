# SPDX-License-Identifier: Apache-2.0
"""The vehicle through `ugv`: it drives, what it recorded is reported and replayed, and its wheels are told of."""

import json
import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.xdist_group("drive")


@pytest.fixture(scope="module")
def drive(ugv, tmp_path_factory):
    """Three metres along a line: exit code and what was printed; `drive.args[-1]` is its directory."""
    return ugv("sil", "4ws4wd", "straight-3", "--seed", 2, "--out", tmp_path_factory.mktemp("runs") / "drive")


@pytest.fixture(scope="module")
def recorded(drive):
    """The directory of the drive; read only."""
    assert drive.returncode == 0, drive.stderr + drive.stdout
    return Path(drive.args[-1])


def test_it_arrives_and_says_how(recorded, drive):
    summary = json.loads((recorded / "summary.json").read_text())
    assert summary["robot"] == "4ws4wd"
    assert summary["controller"] == "fuzzy-ldc"
    assert summary["completed"]
    assert not summary["fell"]
    assert summary["fault"] == ""
    assert summary["lateral_error_m"]["max"] < 0.1
    assert set(summary["missed_deadlines"]) == {"drive"}
    assert "drive tick" in drive.stdout


def test_the_report_shows_wheels_and_no_legs(recorded):
    text = (recorded / "report.html").read_text()
    for title in ("Steering angles", "Wheel speeds", "Slip", "Grip", "Look-ahead", "Estimate"):
        assert f"<h2>{title}</h2>" in text
    for word in ("Joint torques", "k_v", "swing", "trunk", "MPC", "WBC"):
        assert word not in text


def test_every_task_replays_bit_for_bit(ugv, recorded):
    done = ugv("replay", recorded)
    assert done.returncode == 0, done.stderr + done.stdout
    assert done.stdout.rstrip().endswith("identical")
    for task in ("decode", "authority", "estimator", "tracker", "steering", "safety", "encode"):
        assert task in done.stdout


def how_outputs_move(ugv, run, setting):
    """How many fields move, and by what root mean square the commanded velocity does."""
    done = ugv("replay", run, "--task", "tracker", "--set", setting)
    assert done.returncode == 0, done.stderr
    count = re.search(r"signals compared: (\d+) fields move", done.stdout)
    velocity = re.search(r"/ugv/body_command\W+velocity\W+\d+\W+([0-9.e-]+)", done.stdout)
    return int(count[1]), float(velocity[1])


def test_a_change_moves_the_outputs(ugv, recorded):
    fields, velocity_mps = how_outputs_move(ugv, recorded, "tracker.following.speed.acceleration_mps2=0.4")
    assert fields > 0
    assert velocity_mps > 0.01


def test_a_change_to_what_it_is_already_moves_nothing(ugv, recorded):
    assert how_outputs_move(ugv, recorded, "tracker.following.speed.acceleration_mps2=0.8") == (0, 0.0)


def test_a_path_of_ones_own_that_turns_back_is_driven_judged_and_replayed(ugv, tmp_path):
    file, run = tmp_path / "cusp.csv", tmp_path / "run"
    file.write_text("x,y\n0,0\n1,0\n2,0\n1,0.1\n0.5,0.2\n")
    done = ugv("sil", "4ws4wd", file, "--out", run)
    assert done.returncode == 0, done.stderr + done.stdout
    summary = json.loads((run / "summary.json").read_text())
    assert summary["completed"]
    assert summary["path_length_m"] == pytest.approx(3.5, abs=0.02)
    assert summary["lateral_error_m"]["rms"] < 0.03
    assert summary["heading_error_rad"]["rms"] < 0.2
    assert "<h2>Tracking errors</h2>" in (run / "report.html").read_text()
    assert ugv("replay", run).stdout.rstrip().endswith("identical")


@pytest.mark.parametrize("scenario", ["crab", "spin", "reverse"])
def test_a_velocity_is_driven_to_where_it_is_to_end(ugv, tmp_path, scenario):
    done = ugv("sil", "4ws4wd", scenario, "--estimator", "truth", "--out", tmp_path / scenario)
    assert done.returncode == 0, done.stderr + done.stdout


def test_its_configuration_is_checked(ugv):
    done = ugv("config", "check", "4ws4wd")
    assert (done.returncode, done.stdout, done.stderr) == (0, "4ws4wd: ok\n", "")
    done = ugv("config", "check", "4ws4wd", "--set", "delay.maximum_s=1.9")
    assert (done.returncode, done.stdout) == (2, "")
    assert "delay.maximum_s = 1.9 is above 1.6" in done.stderr


def test_controllers_that_there_are_not_are_refused(ugv, tmp_path):
    done = ugv("sil", "4ws4wd", "flat", "--controller", "FpMW", "--out", tmp_path / "run")
    assert done.returncode == 2
    assert "variant.controller" in done.stderr
    assert "fuzzy-ldc" in done.stderr
