# SPDX-License-Identifier: Apache-2.0
"""Faults on the wires of a whole run: each is counted or changes the run; none is passed over in silence."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.can_frame import as_frames
from drivers.memory_ports import MemoryReader
from runtime.recording.compare import first_log_difference
from runtime.recording.counters import counters
from runtime.recording.log import Log
from runtime.recording.replay import Replay
from runtime.recording.run_data import load_run
from runtime.robots import assemble
from runtime.signals import CanFrames, Imu, Mode, Pose
from sim_bridge.run import run_scenario
from sim_bridge.sensors import InertialSensor, LocalizationSensor

pytestmark = pytest.mark.xdist_group("walk")

FAULT_NS = 300_000_000
UNTIL_S = 0.5
Tamper = Callable[[Any], None]
Run = Callable[..., Path]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Half a second of standing, one input tampered with at `FAULT_NS`; gives the run's directory."""
    # the steps in vain before a process's first run must not be tampered with
    run_scenario("uslgo1", "flat", until_s=0.001)

    def start(port: type[Any] = MemoryReader, tamper: Tamper | None = None) -> Path:
        read = port.read
        done = tamper is None

        def reading(self: Any, record: Any, now_ns: int) -> bool:
            nonlocal done
            fresh = bool(read(self, record, now_ns))
            if fresh and not done and now_ns >= FAULT_NS and getattr(record, "count", 1):
                assert tamper is not None
                tamper(record)
                done = True
            return fresh

        out = tmp_path / ("clean" if tamper is None else tamper.__name__)
        with monkeypatch.context() as patched:
            patched.setattr(port, "read", reading)
            run_scenario("uslgo1", "flat", seed=1, out=out, until_s=UNTIL_S)
        assert done
        return out

    return start


def counted(directory: Path) -> list[tuple[int, str]]:
    return [(total, sentence) for total, sentence in counters(load_run(directory)) if total]


def still_stands(directory: Path) -> bool:
    return bool(load_run(directory).signals["/ugv/safety"].values["mode"][-1] == Mode.STANDING)


def wrong_length(batch: CanFrames) -> None:
    as_frames(batch.data)["length"][0] = 5


def unknown_id(batch: CanFrames) -> None:
    as_frames(batch.data)["can_id"][0] = 0x7F0


def error_flag(batch: CanFrames) -> None:
    as_frames(batch.data)["can_id"][0] |= 0x2000_0000


@pytest.mark.parametrize("tamper", [wrong_length, unknown_id, error_flag])
def test_a_frame_that_is_no_reply_is_rejected_and_counted(run: Run, tamper: Tamper) -> None:
    directory = run(MemoryReader, tamper)
    ((total, sentence),) = counted(directory)
    assert total == 1
    assert sentence.startswith("CAN frame was rejected")
    assert still_stands(directory)


def nan_sample(sample: Imu) -> None:
    sample.angular_velocity[1] = np.nan


def infinite_sample(sample: Imu) -> None:
    sample.linear_acceleration[2] = np.inf


@pytest.mark.parametrize("tamper", [nan_sample, infinite_sample])
def test_an_imu_sample_that_is_not_finite_is_replaced_and_counted(run: Run, tamper: Tamper) -> None:
    directory = run(InertialSensor, tamper)
    ((total, sentence),) = counted(directory)
    assert total == 1
    assert sentence.startswith("IMU sample was not finite")
    assert still_stands(directory)
    assert "Warning of non finite sensor in 1 tick, first at 0.30 s" in (write_report_of(directory))


def write_report_of(directory: Path) -> str:
    from runtime.recording.report import write_report

    return write_report(directory).read_text()


def nan_pose(pose: Pose) -> None:
    pose.position[0] = np.nan


def far_pose(pose: Pose) -> None:
    pose.position[0] += 5.0


@pytest.mark.parametrize("tamper", [nan_pose, far_pose])
def test_a_pose_that_cannot_be_is_rejected_and_counted(run: Run, tamper: Tamper) -> None:
    directory = run(LocalizationSensor, tamper)
    ((total, sentence),) = counted(directory)
    assert total == 1
    assert sentence.startswith("localisation pose was rejected")
    assert still_stands(directory)


def flipped_bit(batch: CanFrames) -> None:
    as_frames(batch.data)["data"][0, 2] ^= 0x10


def test_one_flipped_bit_of_a_measurement_changes_the_run(run: Run) -> None:
    tampered = run(MemoryReader, flipped_bit)
    difference = first_log_difference(Log(run()), Log(tampered))
    assert difference is not None
    assert "/ugv/can_received at 0.3" in difference


@pytest.mark.parametrize(("port", "tamper"), [(MemoryReader, wrong_length), (InertialSensor, nan_sample)])
def test_a_faulty_run_replays_as_it_was(run: Run, port: type[Any], tamper: Tamper) -> None:
    log = Log(run(port, tamper))
    result = Replay(log, assemble(log.robot, log.config), log.robot).run()
    assert result.identical
    assert {task.verdict for task in result.tasks.values()} == {"identical"}
