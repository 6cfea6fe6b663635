# SPDX-License-Identifier: Apache-2.0
"""What the link makes of the ticks of the control loops, and what it says of them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.executors.tick import ENTRY, Tick, manifest_of
from runtime.link.control_monitor import ControlMonitor
from runtime.link.diagnosis import RECORDER_SILENT_NS, Diagnosis, fault_names
from runtime.link.tally import Tally
from runtime.messages.diagnostics import Level
from runtime.recording.recorder_status import RecorderStatus
from runtime.robots import topics
from runtime.signals import (
    Battery,
    BodyCommand,
    BusState,
    BusStatus,
    Fault,
    Imu,
    JointState,
    Mode,
    OperatorEvent,
    SafetyStatus,
)
from runtime.tasks import Loop
from runtime.vehicle_signals import WheelState, WheelStatus

SIZES = {"joint": 2, "bus": 2}
WHEEL_SIZES = {"wheel": 4, "axle_drive": 8, "unit_frame": 5}
IMU, SAFETY = Imu(topics.IMU), SafetyStatus(topics.SAFETY)
JOINTS, BUSES = JointState(topics.JOINT_STATE, SIZES), BusStatus(topics.BUS_STATUS, SIZES)
EVENT, BATTERY = OperatorEvent(topics.OPERATOR_EVENT), Battery(topics.BATTERY)
COMMAND = BodyCommand(topics.BODY_COMMAND)
LOOP = Loop("wbc", 2_000_000, 1_000_000, 80, (IMU, SAFETY, JOINTS, BUSES, EVENT, BATTERY, COMMAND), (), (), ())
MANIFEST = manifest_of((LOOP,))
SILENT_NS, BATTERY_AGE_MAX_NS = 500_000_000, 5_000_000_000


def datagram(index: int, *records, now_ns: int = 0, **tick_fields: int) -> bytes:
    tick = Tick("/ugv/tick/wbc", {"received": 0})
    tick.index, tick.now_ns = index, now_ns
    for name, value in tick_fields.items():
        setattr(tick, name, value)
    parts = []
    for record in (tick, *records):
        body = record.to_bytes()
        parts.append(ENTRY.pack(MANIFEST.of_topic(record.topic).number, len(body)) + body)
    return b"".join(parts)


@pytest.fixture
def monitor() -> ControlMonitor:
    return ControlMonitor(MANIFEST)


@pytest.fixture
def diagnosis(monitor) -> Diagnosis:
    return Diagnosis(monitor, Tally(), SILENT_NS, lambda: None, BATTERY_AGE_MAX_NS)


def part(diagnosis: Diagnosis, name: str, now_ns: int = 0):
    return next(status for status in diagnosis.statuses(now_ns, {}) if status.name == name)


def test_skipped_and_missing_ticks_are_told_apart(monitor):
    for index, skipped in ((0, 0), (1, 0), (4, 2), (7, 1)):
        monitor.take(datagram(index, skipped=skipped, wake_latency_ns=1000 * index, compute_ns=5000), 0)
    figures = monitor.loops["wbc"].figures()
    assert (figures["ticks"], figures["skipped"], figures["missed"]) == (4, 3, 1)
    assert figures["wake_us_max"] == 7.0
    assert figures["compute_us_p50"] == 5.0


def test_the_age_at_which_samples_are_used_is_kept(monitor):
    imu = IMU.like()
    imu.stamp_ns = 1_000
    monitor.take(datagram(0, imu, now_ns=301_000), 0)
    monitor.take(datagram(1, now_ns=999_000), 0)
    assert list(monitor.imu_age_ns) == [300_000], "a tick without a sample tells nothing of ages"


def test_samples_that_no_tick_used_are_counted_and_a_link_that_begins_anew_passes_none_over(monitor, diagnosis):
    imu = IMU.like()
    for index, sequence in enumerate((5, 6, 9, 1, 2, 4)):
        imu.sequence = sequence
        monitor.take(datagram(index, imu), 0)
    assert monitor.imu_passed_over == 2 + 1
    assert part(diagnosis, "imu").values["passed_over"] == 3


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_any_datagram_is_taken_or_counted(data):
    monitor = ControlMonitor(MANIFEST)
    monitor.take(data, 5)
    assert monitor.malformed == 1
    assert monitor.last_ns is None


@settings(deadline=None)
@given(st.data())
def test_a_damaged_datagram_is_taken_or_counted(data):
    whole = bytearray(datagram(3, IMU, SAFETY))
    whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    monitor = ControlMonitor(MANIFEST)
    monitor.take(bytes(whole[: data.draw(st.integers(0, len(whole)))]), 5)
    assert monitor.malformed + monitor.loops["wbc"].ticks == 1


def test_wheels_that_are_stuck_or_whose_motors_fail_are_named():
    wheels, status = WheelState(topics.WHEEL_STATE, WHEEL_SIZES), WheelStatus(topics.WHEEL_STATUS, WHEEL_SIZES)
    manifest = manifest_of((Loop("drive", 10_000_000, 5_000_000, 80, (wheels, status), (), (), ()),))
    monitor = ControlMonitor(manifest)
    diagnosis = Diagnosis(monitor, Tally(), SILENT_NS, lambda: None, BATTERY_AGE_MAX_NS)

    def told(index):
        tick = Tick("/ugv/tick/drive", {"received": 0})
        tick.index = index
        entries = ((manifest.of_topic(record.topic).number, record.to_bytes()) for record in (tick, wheels, status))
        monitor.take(b"".join(ENTRY.pack(number, len(body)) + body for number, body in entries), 0)
        return part(diagnosis, "wheels")

    wheels.temperature = [math.nan, 62.0] * 2
    assert (told(0).level, told(1).message) == (Level.OK, "")
    assert told(1).values["hottest_degc"] == 62.0
    status.stuck[1] = True
    assert (told(2).level, told(3).message) == (Level.ERROR, "front_right stuck")
    wheels.fault[[2, 7]] = 5, 3
    assert told(4).message == "rear_left steering fault 5, rear_right drive fault 3, front_right stuck"


def test_silence_is_an_error_before_the_first_tick_and_after_the_last(monitor, diagnosis):
    assert diagnosis.state(0) == ("silent", "none")
    safety = SAFETY.like()
    safety.mode = Mode.ACTIVE
    monitor.take(datagram(0, safety), 1_000)
    assert diagnosis.state(1_000 + SILENT_NS) == ("active", "none")
    assert part(diagnosis, "control").level == Level.OK
    assert diagnosis.state(1_001 + SILENT_NS) == ("silent", "none")
    assert part(diagnosis, "control", 1_001 + SILENT_NS).level == Level.ERROR


def test_damping_is_an_error_with_its_faults_and_a_warning_a_warning(monitor, diagnosis):
    safety = SAFETY.like()
    safety.mode, safety.warning = Mode.ACTIVE, Fault.STALE_LOCALIZATION
    monitor.take(datagram(0, safety), 0)
    told = part(diagnosis, "control")
    assert (told.level, told.message) == (Level.WARN, "active, warning: stale_localization")
    safety.mode, safety.fault = Mode.DAMPED, Fault.TILT | Fault.MOTOR_FAULT
    monitor.take(datagram(1, safety), 0)
    told = part(diagnosis, "control")
    assert (told.level, told.message) == (Level.ERROR, "damped: tilt motor_fault")


def test_a_mode_that_nobody_knows_does_not_stop_the_link(monitor, diagnosis):
    safety = SAFETY.like()
    safety.mode = 77
    monitor.take(datagram(0, safety), 0)
    assert diagnosis.state(0)[0] == "77"


def test_every_bus_that_is_not_up_is_an_error(monitor, diagnosis):
    buses = BUSES.like()
    buses.state = (BusState.UP, BusState.OFF)
    buses.purged, buses.withheld = (0, 3), (0, 6)
    monitor.take(datagram(0, buses), 0)
    assert part(diagnosis, "bus 0").level == Level.OK
    told = part(diagnosis, "bus 1")
    assert told.level == Level.ERROR
    assert told.values["state"] == "off"
    assert (told.values["purged"], told.values["withheld"]) == (3, 6)


def test_events_that_control_has_lost_are_a_warning(monitor, diagnosis):
    event = EVENT.like()
    event.lost = 2
    monitor.take(datagram(0, event), 0)
    told = part(diagnosis, "operator")
    assert (told.level, told.values["lost_events"]) == (Level.WARN, 2)


def test_paths_of_others_than_the_lease_s_holder_are_a_warning(monitor, diagnosis):
    command = COMMAND.like()
    command.rejected_paths, command.foreign_paths = 3, 2
    monitor.take(datagram(0, command), 0)
    told = part(diagnosis, "tracker")
    assert (told.level, told.message) == (Level.WARN, "more: rejected_paths, more: foreign_paths")
    assert (told.values["rejected_paths"], told.values["foreign_paths"]) == (3, 2)


def test_a_counter_warns_once_after_it_has_grown(monitor, diagnosis):
    joints = JOINTS.like()
    joints.temperature = (math.nan, 40.0)
    joints.rejected = 2
    monitor.take(datagram(0, joints), 0)
    assert part(diagnosis, "joints").level == Level.WARN
    assert part(diagnosis, "joints").level == Level.OK
    joints.rejected = 3
    monitor.take(datagram(1, joints, dropped=4), 0)
    assert part(diagnosis, "joints").message == "more: rejected_frames"
    assert part(diagnosis, "loop wbc").values["recorder_drops"] == 4


@pytest.mark.parametrize(
    ("temperatures", "told"),
    [((math.nan, 91.0), 91.0), ((91.0, math.nan), 91.0), ((40.0, 91.0), 91.0), ((math.nan, math.nan), math.nan)],
)
def test_a_drive_that_has_not_replied_hides_no_hot_motor(monitor, diagnosis, temperatures, told):
    joints = JOINTS.like()
    joints.temperature = temperatures
    monitor.take(datagram(0, joints), 0)
    assert part(diagnosis, "joints").values["hottest_degc"] == pytest.approx(told, nan_ok=True)


def test_rejections_are_told_by_topic_and_reason(monitor):
    tally = Tally()
    diagnosis = Diagnosis(monitor, tally, SILENT_NS, lambda: None, BATTERY_AGE_MAX_NS)
    tally.accept("/imu/data", 10)
    tally.reject("/imu/data", "the stamp is too old")
    tally.reject("/imu/data", "the stamp is too old")
    tally.miss("/path", 3)
    imu = part(diagnosis, "input /imu/data", 2_000_010)
    assert imu.level == Level.WARN
    assert imu.values == {"accepted": 1, "age_ms": 2.0, "the stamp is too old": 2, "lost": 0}
    tally.reject("/imu/data", "the stamp is too old")
    paths = part(diagnosis, "input /path")
    assert (paths.level, paths.values["lost"]) == (Level.OK, 3), "told a moment ago"


@given(st.integers(0, 2**32 - 1))
def test_every_fault_has_a_name(bits):
    names = fault_names(bits).split()
    assert (names == ["none"]) == (bits == 0)
    assert len(names) == max(1, sum(bool(bits & fault) for fault in Fault) + bool(bits & ~sum(Fault)))


def test_a_recorder_that_fails_or_falls_silent_is_an_error(monitor):
    said: list[RecorderStatus] = []
    diagnosis = Diagnosis(monitor, Tally(), SILENT_NS, lambda: said[-1] if said else None, BATTERY_AGE_MAX_NS)
    assert part(diagnosis, "recorder").level == Level.WARN
    said.append(RecorderStatus(recording="log", bag="log", updated_ns=10))
    assert part(diagnosis, "recorder", 10 + RECORDER_SILENT_NS).level == Level.OK
    assert part(diagnosis, "recorder", 11 + RECORDER_SILENT_NS).message == "the recorder is silent"
    said.append(RecorderStatus(error="no space left on device", failed=3))
    told = part(diagnosis, "recorder")
    assert (told.level, told.message) == (Level.ERROR, "no space left on device, more: failed")
    said.append(RecorderStatus(recording="another", error="no space left on device", failed=3))
    assert part(diagnosis, "recorder").level == Level.OK


def test_a_battery_that_says_nothing_is_told_since_its_voltage_is_not_watched(monitor, diagnosis):
    silent = part(diagnosis, "battery")
    assert (silent.level, silent.message) == (Level.WARN, "the battery has said nothing: its voltage is not watched")
    battery = BATTERY.like()
    battery.stamp_ns, battery.voltage = 1_000_000_000, 29.0
    monitor.take(datagram(0, battery), 0)
    heard = part(diagnosis, "battery", now_ns=1_000_000_000 + BATTERY_AGE_MAX_NS)
    assert (heard.level, heard.values["voltage_v"]) == (Level.OK, 29.0)
    old = part(diagnosis, "battery", now_ns=1_000_000_001 + BATTERY_AGE_MAX_NS)
    assert (old.level, old.message) == (Level.WARN, "the battery is silent: its voltage is no longer watched")
