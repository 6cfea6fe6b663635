# SPDX-License-Identifier: Apache-2.0
"""The report stands on its own, shows what the log holds, and says what it lacks."""

from __future__ import annotations

import io
import json
import re
import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from runtime import signals
from runtime.executors.lockstep import Lockstep
from runtime.recording.bag import BagSink
from runtime.recording.counters import counters
from runtime.recording.errors import LogError, RecordingError
from runtime.recording.figure_style import thinned
from runtime.recording.log import Log
from runtime.recording.report import write_report
from runtime.recording.report_safety import safety_warnings
from runtime.recording.report_wheels import stuck_wheels
from runtime.recording.run_data import SAFETY, WHEEL_STATUS, load_run
from runtime.recording.setup import TERRAIN, Attachment, recording_setup
from runtime.records import Record, float64
from runtime.tasks import Loop, Scheduled, Task

SIZES = {"joint": 3, "foot": 4, "foot_xyz": 12, "foot_pair": 16, "path": 8}


class Walk(Task):
    """Writes what a robot that walks 5 cm beside a line would."""

    name = "walk"

    def __init__(self) -> None:
        self.truth, self.path = signals.Truth("/ugv/truth", SIZES), signals.Path("/ugv/path", SIZES)
        self.joints = signals.JointState("/ugv/joint_state", SIZES)
        self.command = signals.BodyCommand("/ugv/body_command", SIZES)
        self.safety = signals.SafetyStatus("/ugv/safety", SIZES)
        self.body = signals.BodyState("/ugv/body_state", SIZES)
        self.writes = (self.truth, self.path, self.joints, self.command, self.safety, self.body)

    def step(self, now_ns: int) -> None:
        t = now_ns / 1e9
        self.truth.position, self.truth.orientation = (0.6 * t, 0.05, 0.3), (0.0, 0.0, 0.0, 1.0)
        self.body.position, self.body.orientation = (0.6 * t, 0.06, 0.3), (0.0, 0.0, 0.0, 1.0)
        self.truth.linear_velocity = (0.6, 0.0, 0.0)
        self.path.count, self.path.x = 2, (0.0, 3.0, 0, 0, 0, 0, 0, 0)
        self.body.stamp_ns = now_ns
        self.command.look_ahead, self.command.k_v = 1.2, 4.0
        self.joints.rejected, self.safety.limited = int(t > 1.0), 7 * int(t > 0.5)
        self.joints.effort = np.sin(30 * t + np.arange(3))
        self.safety.mode = signals.Mode.ACTIVE if t < 1.5 else signals.Mode.DAMPED
        self.safety.fault = 0 if t < 1.5 else signals.Fault.TILT


class ThereAndBack(Walk):
    """Drives a metre and half of it back, beside the line; then it refuses a path to somewhere else."""

    def step(self, now_ns: int) -> None:
        super().step(now_ns)
        t = now_ns / 1e9
        self.truth.position = (min(t, 2.0 - t), 0.05, 0.3)
        self.path.count, self.path.x = 3, (0.0, 1.0, 0.5, 0, 0, 0, 0, 0)
        if t > 1.5:
            self.path.count, self.path.x = 2, (0.0, 70.0, 0, 0, 0, 0, 0, 0)
            self.command.rejected_paths = 1


class Laps(Walk):
    """Walks a line, is given no path for a moment, and walks the line again from its start."""

    def step(self, now_ns: int) -> None:
        super().step(now_ns)
        t = now_ns / 1e9
        self.truth.position = (0.6 * (t % 1.0), 0.05, 0.3)
        if 0.9 < t < 1.0:
            self.path.count = 0


class NoLaps(Walk):
    """Walks a line, and refuses to have it withdrawn for a moment."""

    def step(self, now_ns: int) -> None:
        super().step(now_ns)
        self.command.rejected_paths = int(now_ns > 0.9e9)
        if 0.9e9 < now_ns < 1.0e9:
            self.path.count = 0


class EarlierCommand(Record):
    """A command as a version wrote it that did not count refused paths."""

    look_ahead, k_v = float64("m"), float64()


class Place(Record):
    """A truth that says where the robot is in another way."""

    position = float64("m")


class Walked(Walk):
    """The same walk with one of its records laid out otherwise."""

    def __init__(self, command: Record, truth: Record) -> None:
        super().__init__()
        self.writes = (truth, self.path, self.joints, command, self.safety, self.body)


class Nothing:
    """A world without content."""

    def advance(self, until_ns: int) -> None:
        """Let time pass."""


def terrain(heights) -> Attachment:
    stream = io.BytesIO()
    np.savez(stream, x0=-2.0, y0=-2.0, spacing=0.1, heights=heights)
    return Attachment(TERRAIN, "application/octet-stream", stream.getvalue())


def record(run, walk):
    """Record two seconds of it."""
    loops = (Loop("wbc", 10_000_000, 1_000_000, 80, (), (), (Scheduled(walk),), ()),)
    ground = terrain(np.random.default_rng(0).uniform(-0.03, 0.03, (50, 80)))
    sink = BagSink(run, recording_setup(loops, "toy", "a < b & c\n", 3, ("hip", "thigh", "calf"), extra=[ground]))
    Lockstep(loops, {}, {}, Nothing(), sink).run(2_000_000_000, lambda now_ns: False)
    sink.close()


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    run = tmp_path_factory.mktemp("walks") / "line"
    record(run, Walk())
    summary = {
        "robot": "toy",
        "scenario": "line <6 cm>",
        "completed": False,
        "fell": True,
        "fault": "tilt",
        "lateral_error_m": {"rms": 0.05, "mean": None},
    }
    (run / "summary.json").write_text(json.dumps(summary))
    return run


def test_the_report_stands_on_its_own(walked):
    path = write_report(walked)
    assert path == walked / "report.html"
    text = path.read_text()
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", text)
    assert "<script" not in text
    assert "<h1>toy · line &lt;6 cm&gt;</h1>" in text
    assert "a &lt; b &amp; c" in text
    assert "5.00 cm" in text
    for svg in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
        ElementTree.fromstring(svg)


def test_the_report_has_the_figures_of_the_paper(walked):
    text = write_report(walked).read_text()
    titles = re.findall(r"<h2>(.*?)</h2>", text)
    assert titles == [
        "Worth knowing",
        "Path",
        "Tracking errors",
        "Velocities",
        "Joint torques",
        "Look-ahead",
        "Estimate",
        "Loop times",
        "Safety",
        "Time",
        "Counted",
        "Summary",
        "Log",
    ]
    assert "The robot was damped at 1.50 s: tilt." in text


def test_each_damping_is_told_with_its_time_up_to_a_dozen():
    status = np.zeros(64, [("mode", "u1"), ("fault", "<u4"), ("warning", "<u4")])
    status["mode"][:], status["mode"][2::4], status["mode"][3::4] = signals.Mode.ACTIVE, *[signals.Mode.DAMPED] * 2
    status["fault"][2::4] = signals.Fault.BUS | signals.Fault.TILT
    safety = SimpleNamespace(values=status, log_ns=np.arange(64) * 10**9)
    said = safety_warnings(SimpleNamespace(signals={SAFETY: safety}))
    assert said[0] == "The robot was damped at 2.00 s: tilt, bus."
    assert said[11:] == ["The robot was damped at 46.00 s: tilt, bus.", "It was damped 4 times more."]
    assert safety_warnings(SimpleNamespace(signals={})) == []


def test_wheels_that_were_stuck_are_named_with_the_time():
    stuck = np.zeros(3, [("stuck", np.bool_, 4)])
    stuck["stuck"][1:, 2] = True
    status = SimpleNamespace(values=stuck, log_ns=np.array([1, 2, 3]) * 10**9)
    data = SimpleNamespace(signals={WHEEL_STATUS: status})
    assert stuck_wheels(data) == ["The steering of the rear left wheel was stuck, first at 2.00 s."]
    assert stuck_wheels(SimpleNamespace(signals={})) == []


def test_what_is_counted_is_said_the_most_frequent_first(walked):
    counted = counters(load_run(walked))
    assert counted[0] == (7, "joint values of commands were altered by a limit")
    assert counted[1] == (1, "CAN frame was rejected: wrong length, unknown id, error frame, or a value out of range")
    assert (0, "paths were rejected") in counted
    text = write_report(walked).read_text()
    assert '<tr class="some"><td>7</td>' in text
    assert '<tr class="none"><td>no</td><td>paths were rejected</td>' in text


def test_errors_are_those_of_the_true_pose(walked):
    seen = load_run(walked).against_path
    np.testing.assert_allclose(seen.y_error, 0.05)
    np.testing.assert_allclose(seen.x_error, 0.0, atol=1e-12)
    np.testing.assert_allclose(seen.projection.progress, 0.6 * seen.t)


def test_each_lap_is_judged_from_the_start_of_the_path(tmp_path):
    record(tmp_path / "run", Laps())
    seen = load_run(tmp_path / "run").against_path
    np.testing.assert_allclose(seen.y_error, 0.05)
    np.testing.assert_allclose(seen.projection.progress, 0.6 * (seen.t % 1.0), atol=1e-9)


def test_a_withdrawal_that_was_refused_makes_no_lap(tmp_path):
    record(tmp_path / "run", NoLaps())
    seen = load_run(tmp_path / "run").against_path
    np.testing.assert_allclose(seen.projection.progress, 0.6 * seen.t, atol=1e-9)


def test_a_path_that_turns_back_is_drawn_and_judged_and_one_that_was_refused_is_not(tmp_path):
    record(tmp_path / "run", ThereAndBack())
    data = load_run(tmp_path / "run")
    assert data.path_points.tolist() == [[0.0, 0.0], [1.0, 0.0], [0.5, 0.0]]
    seen = data.against_path
    np.testing.assert_allclose(seen.y_error, 0.05)
    np.testing.assert_allclose(seen.projection.progress, np.minimum(seen.t, 1.5), atol=1e-9)
    assert "<h2>Tracking errors</h2>" in write_report(tmp_path / "run").read_text()


def test_a_log_of_an_earlier_version_is_judged_by_what_it_holds(tmp_path):
    walk = Walked(EarlierCommand("/ugv/body_command"), signals.Truth("/ugv/truth", SIZES))
    walk.truth = walk.writes[0]
    record(tmp_path / "run", walk)
    np.testing.assert_allclose(load_run(tmp_path / "run").against_path.y_error, 0.05)


def test_a_pose_that_is_laid_out_otherwise_is_named(tmp_path):
    record(tmp_path / "run", Walked(signals.BodyCommand("/ugv/body_command", SIZES), Place("/ugv/truth")))
    with pytest.raises(LogError, match="path or pose are not laid out"):
        load_run(tmp_path / "run")


def test_a_log_without_the_usual_topics_still_gets_a_report(recorded, tmp_path):
    shutil.copytree(recorded, tmp_path / "run")
    text = write_report(tmp_path / "run").read_text()
    for sentence in (
        "There is no summary.json beside the log.",
        "The log has no true pose, so errors are those of the estimate.",
        "The log has no safety status (/ugv/safety).",
    ):
        assert sentence in text


def test_a_cut_off_log_gets_a_report_that_says_so(walked, tmp_path):
    data = Log(walked).path.read_bytes()
    (tmp_path / "x.mcap").write_bytes(data[: len(data) // 2])
    assert "The log was cut off; it is whole up to" in write_report(tmp_path / "x.mcap").read_text()


def test_a_broken_summary_or_terrain_is_named(toy, tmp_path):
    run = toy.bag(tmp_path / "run")
    (run / "summary.json").write_text("{")
    with pytest.raises(LogError, match=r"summary\.json cannot be read"):
        write_report(run)
    broken = replace(toy.setup(), attachments=(Attachment(TERRAIN, "application/octet-stream", b"PK no"),))
    sink = BagSink(tmp_path / "other", broken)
    sink.write(toy.datagrams(0.05)[0])
    sink.close()
    with pytest.raises(LogError, match=r"terrain\.npz cannot be read"):
        write_report(tmp_path / "other")


def test_a_report_that_cannot_be_written_is_named(toy, tmp_path):
    run = toy.bag(tmp_path / "run", seconds=0.05)
    (run / "report.html").mkdir()
    with pytest.raises(RecordingError, match=r"cannot write .*report\.html: is a directory"):
        write_report(run)


def test_thinning_keeps_the_extremes():
    t = np.arange(10_000.0)
    y = np.sin(t)
    y[4321] = 7.0
    y[9000:9100] = np.nan
    short, values = thinned(t, y, columns=50)
    assert len(short) <= 100
    assert np.nanmax(values) == 7.0
    assert np.all(np.diff(short) > 0)
