# SPDX-License-Identifier: Apache-2.0
"""What one process of the robot takes from another: datagrams of ticks, and files that both map."""

from __future__ import annotations

import functools
import struct
import tempfile
from pathlib import Path

from fuzz_target import RECORDING, Target, file_of, room, toy, toy_setup

from runtime.executors.shared_memory import SharedReader, SharedWriter
from runtime.executors.tick import ENTRY, Manifest, Tick, entries, manifest_of
from runtime.link.control_monitor import ControlMonitor
from runtime.link.diagnosis import Diagnosis
from runtime.link.tally import Tally
from runtime.recording.bags import Bags
from runtime.recording.recorder_status import RecorderStatus
from runtime.records import Record
from runtime.robots import topics
from runtime.signals import Battery, BodyState, BusStatus, Imu, JointState, OperatorEvent, SafetyStatus
from runtime.tasks import Loop
from runtime.vehicle_signals import WheelState, WheelStatus

CELLS = 4
SIZES = {"joint": 2, "bus": 2, "wheel": 4, "foot": 4, "foot_xyz": 12, "foot_pair": 16, "axle_drive": 8, "unit_frame": 5}
SILENT_NS = 500_000_000


def decode_datagram(data: bytes) -> None:
    """A datagram on the recorder's socket."""
    try:
        for _, body in entries(data):
            assert len(body) <= len(data)
    except struct.error:
        pass
    with tempfile.TemporaryDirectory(dir=room()) as directory:
        status = RecorderStatus()
        bags = Bags(Path(directory), toy_setup(), status, lambda sentence: None)
        bags.write(data)
        bags.close()
        assert status.recorded + status.rejected == 1


def decode_shared(data: bytes) -> None:
    """A file that another process maps and writes."""
    record = Imu("/ugv/imu")
    with file_of(data, "ugv.imu") as place:
        for read in (SharedReader.latest, SharedReader.next):
            reader = SharedReader(place, record, CELLS)
            try:
                for _ in range(2 * CELLS):
                    read(reader, record)
            finally:
                reader.close()


def shared_seeds() -> list[bytes]:
    """Files with nothing, something and more than they hold."""
    record, found = Imu("/ugv/imu"), []
    for count in (0, 1, CELLS, 3 * CELLS):
        with tempfile.TemporaryDirectory(dir=room()) as directory:
            place = Path(directory) / "ugv.imu"
            writer = SharedWriter(place, record, CELLS)
            for number in range(count):
                record.sequence = number
                writer.write(record)
            writer.close()
            found.append(place.read_bytes())
    return found


@functools.cache
def loop_of_everything() -> tuple[Manifest, tuple[Record, ...]]:
    """A loop that logs all signals that the link looks at, and these."""
    records = (
        Imu(topics.IMU),
        SafetyStatus(topics.SAFETY),
        JointState(topics.JOINT_STATE, SIZES),
        WheelState(topics.WHEEL_STATE, SIZES),
        WheelStatus(topics.WHEEL_STATUS, SIZES),
        BusStatus(topics.BUS_STATUS, SIZES),
        BodyState(topics.BODY_STATE, SIZES),
        Battery(topics.BATTERY),
        OperatorEvent(topics.OPERATOR_EVENT),
    )
    return manifest_of((Loop("wbc", 2_000_000, 1_000_000, 80, records, (), (), ()),)), records


@functools.cache
def monitored() -> tuple[ControlMonitor, Diagnosis]:
    """The link's view of that loop."""
    monitor = ControlMonitor(loop_of_everything()[0])
    return monitor, Diagnosis(monitor, Tally(), SILENT_NS, lambda: None, 5_000_000_000)


def decode_tick(data: bytes) -> None:
    """A datagram on the link's socket, and what /diagnostics then says."""
    monitor, diagnosis = monitored()
    before = monitor.malformed, monitor.last_ns
    now_ns = (before[1] or 0) + 1
    monitor.take(data, now_ns)
    assert (monitor.malformed, monitor.last_ns) in ((before[0] + 1, before[1]), (before[0], now_ns))
    assert all(status.name for status in diagnosis.statuses(now_ns, {}))


def tick_seeds() -> list[bytes]:
    """A tick alone, one with each signal, one with all."""
    manifest, records = loop_of_everything()
    tick = next(c.record for c in manifest.channels if isinstance(c.record, Tick))
    parts = []
    for record in (tick, *records):
        body = record.to_bytes()
        parts.append(ENTRY.pack(manifest.of_topic(record.topic).number, len(body)) + body)
    return [parts[0], *(parts[0] + part for part in parts[1:]), b"".join(parts)]


TARGETS = (
    Target("datagram", decode_datagram, RECORDING, lambda: toy().datagrams(seconds=0.02)),
    Target("tick", decode_tick, ("runtime.link", "runtime.executors.tick"), tick_seeds),
    Target("shared", decode_shared, ("runtime.executors.shared_memory",), shared_seeds),
)
