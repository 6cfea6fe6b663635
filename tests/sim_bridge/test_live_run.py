# SPDX-License-Identifier: Apache-2.0
"""The summary of a run in real time tells how old the inertial samples were that the estimator used."""

from runtime.executors.tick import ENTRY, manifest_of
from runtime.recording.bag import BagSink
from runtime.recording.log import Log
from runtime.recording.setup import recording_setup
from runtime.robots import topics
from runtime.signals import BodyState
from runtime.tasks import Loop
from sim_bridge.live_run import imu_age_ms

SIZES = {"foot": 4, "foot_xyz": 12, "foot_pair": 16}


def bag(directory, rows):
    """A log of the estimator's outputs: stamp and age, ms."""
    body = BodyState(topics.BODY_STATE, SIZES)
    loop = Loop("wbc", 2_000_000, 1_000_000, 80, (body,), (), (), ())
    sink, number = BagSink(directory, recording_setup((loop,), "toy", "", 0)), manifest_of((loop,)).of_topic(body.topic)
    for stamp_ms, age_ms in rows:
        body.stamp_ns, body.imu_age_ns = int(stamp_ms * 1e6), int(age_ms * 1e6)
        raw = body.to_bytes()
        sink.write(ENTRY.pack(number.number, len(raw)) + raw)
    sink.close()
    return Log(directory)


def test_ages_are_of_all_bags_and_of_the_ticks_alone_that_had_a_sample(tmp_path):
    first = bag(tmp_path / "a", [(0, 0)] * 50 + [(2, 3.0)] * 3)
    second = bag(tmp_path / "b", [(0, 0)] * 50 + [(2, 5.0)] * 4)
    assert imu_age_ms([first, second]) == {"median": 5.0, "p99": 5.0, "max": 5.0}
    assert imu_age_ms([first]) == {"median": 3.0, "p99": 3.0, "max": 3.0}


def test_a_run_that_never_had_a_sample_has_no_age(tmp_path):
    assert imu_age_ms([bag(tmp_path / "a", [(0, 0)] * 5)]) is None
