# SPDX-License-Identifier: Apache-2.0
"""What comes by the buses: frames of drives and of a control unit, what controllers say of their errors, packets."""

from __future__ import annotations

import functools
import socket
from collections.abc import Callable

import can
import numpy as np
from fuzz_target import Target, file_of, room

from drivers.bus_health import BusHealth, BusState, heed_errors
from drivers.can_frame import CAN_EFF_FLAG, CAN_ERR_FLAG, CAN_RTR_FLAG, make_frames
from drivers.dialects import DIALECTS, dialect_named
from drivers.joint_group import JointGroup, Readings
from drivers.unix_can import pack, unpack
from drivers.unix_hub import UnixHub
from drivers.vcu import UnitReadings, VehicleUnit
from drivers.vcu_database import OWN_DBC, UnitDatabase
from runtime.recording.log import Log
from runtime.robots import load_configuration

FRAMES, FRAME_BYTES = 64, 16


@functools.cache
def joints(dialect: str) -> tuple[JointGroup, Readings]:
    """The joints of USLGO1, with drives of a dialect."""
    config = load_configuration("uslgo1")
    group = JointGroup(config.drives.joints(config.safety), dialect_named(dialect), 10_000_000)
    return group, Readings.empty(len(group.joints))


def decode_frames(dialect: str) -> Callable[[bytes], None]:
    """A batch: 16 bytes a frame, on the bus that its number says."""

    def decode(data: bytes) -> None:
        group, readings = joints(dialect)
        count = min(len(data) // FRAME_BYTES, FRAMES)
        frames = np.frombuffer(data[: count * FRAME_BYTES], group.frames.dtype)
        bus = np.arange(count, dtype=np.uint8) % 4
        before = int(group.counters.sum(dtype=np.int64))
        accepted = group.decode(frames, bus, np.full(count, 1, np.int64), count, readings)
        assert 0 <= accepted <= count
        counted = int(group.counters.sum(dtype=np.int64)) - before
        assert accepted + counted >= count, "a frame was neither taken nor counted"
        assert np.isfinite(readings.position).all()
        assert np.isfinite(readings.velocity).all()

    return decode


def frame_seeds(dialect: str) -> Callable[[], list[bytes]]:
    """Frames to and from every drive."""

    def seeds() -> list[bytes]:
        group, _ = joints(dialect)
        replies = group.encode_damping().copy()
        for row, joint in enumerate(group.joints):
            replies["can_id"][row] = group.dialect.reply_id(joint.drive_id, joint.master_id)
            replies["length"][row] = group.dialect.reply_length
            replies["data"][row, 0] = joint.drive_id
        return [group.encode_damping().tobytes(), replies.tobytes(), group.enable_frames().tobytes()]

    return seeds


def decode_errors(data: bytes) -> None:
    """A batch among which are what controllers say of their troubles."""
    count = min(len(data) // FRAME_BYTES, FRAMES)
    frames, health = data[: count * FRAME_BYTES], [BusHealth() for _ in range(4)]
    heed_errors(frames, np.arange(count, dtype=np.uint8) % len(health), health)
    flags = frames[3::FRAME_BYTES]
    assert sum(bus.errors for bus in health) == sum(bool(flag & CAN_ERR_FLAG >> 24) for flag in flags)
    assert all(bus.state in (BusState.UP, BusState.PASSIVE, BusState.OFF) for bus in health)


def error_seeds() -> list[bytes]:
    """Bus-off, restart, each state of the controller, and a frame that is no error."""
    found = []
    for classes, details in ((0x40, 0), (0x100, 0), (0x4, 0x30), (0x4, 0x0C), (0x4, 0x40), (0x2, 0)):
        frame = bytearray(make_frames([CAN_ERR_FLAG | classes], 8).tobytes())
        frame[9] = details
        found.append(bytes(frame))
    return [*found, b"".join(found) + make_frames([1], 8).tobytes()]


def frame_rows() -> list[bytes]:
    """Single frames: data, extended, remote, error."""
    return [
        make_frames([identifier], length).tobytes()
        for identifier, length in ((1, 8), (CAN_EFF_FLAG | 0x2901, 3), (CAN_RTR_FLAG | 5, 0), (CAN_ERR_FLAG | 0x40, 8))
    ]


def decode_can_message(data: bytes) -> None:
    """A packet that python-can reads from a hub; what it takes it shows, and sends as it came."""
    try:
        message = unpack(data, 0.0, "hub")
    except can.CanOperationError:
        return
    assert str(message)
    assert message.dlc <= 8
    again = unpack(pack(message), 0.0, "hub")
    assert again.equals(message, timestamp_delta=None), (again, message)


@functools.cache
def control_unit() -> tuple[VehicleUnit, UnitReadings]:
    """The control unit of the vehicle."""
    return VehicleUnit(10_000_000), UnitReadings.empty()


def decode_states(data: bytes) -> None:
    """A batch of a control unit's frames, on its bus."""
    unit, readings = control_unit()
    count = min(len(data) // FRAME_BYTES, FRAMES)
    frames = np.frombuffer(data[: count * FRAME_BYTES], unit.frames.dtype)
    before = int(unit.counters.sum(dtype=np.int64))
    accepted = unit.decode(frames, np.zeros(count, np.uint8), np.full(count, 1, np.int64), count, readings)
    assert 0 <= accepted <= count
    assert accepted + int(unit.counters.sum(dtype=np.int64)) - before >= count, "a frame was neither taken nor counted"
    assert np.isfinite(readings.steering).all()
    assert np.isfinite(readings.speed).all()


def state_seeds() -> list[bytes]:
    """One frame of each kind, all alive counters."""
    unit, _ = control_unit()
    seeds = [unit.encode_braking(True).tobytes()]
    for alive in range(4):
        frames = np.zeros(len(unit.database.states), unit.frames.dtype)
        for row, message in enumerate(unit.database.states):
            content = message.encode({name: bounds.high for name, bounds in message.ranges.items()}, alive)
            frames[row] = message.can_id, message.length, 0, np.frombuffer(content.ljust(8, b"\0"), np.uint8)
        seeds.append(frames.tobytes())
    return seeds


def decode_dbc(data: bytes) -> None:
    """The description of a control unit's frames."""
    with file_of(data, "unit.dbc") as place:
        UnitDatabase(place)


@functools.cache
def hub() -> tuple[UnixHub, socket.socket]:
    """A bus over a socket file, and one end of it."""
    bus = UnixHub(room() / "bus")
    end = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    end.connect(str(room() / "bus"))
    return bus, end


def decode_packets(data: bytes) -> None:
    """Packets of any length on a bus: the first byte of each says how long it is."""
    bus, end = hub()
    rejected, sent, place, whole = bus.rejected, 0, 0, b""
    while place < len(data) and sent < FRAMES:
        packet = data[place + 1 : place + 1 + max(1, data[place] % 40)]
        place += 1 + len(packet)
        if packet:
            end.send(packet)
            sent += 1
            whole += packet if len(packet) == FRAME_BYTES else b""
    assert bus.receive() == whole
    assert bus.rejected - rejected == sent - len(whole) // FRAME_BYTES


def batches(log: Log) -> list[bytes]:
    """Batches of CAN frames that a robot received."""
    rows = log.read_signal("/ugv/can_received").values[::50]
    return [row["data"].tobytes()[: FRAME_BYTES * int(row["count"])] for row in rows]


OF_THE_ROBOT = load_configuration("uslgo1").drives.dialect

TARGETS = (
    Target("frames", decode_frames(OF_THE_ROBOT), ("drivers",), frame_seeds(OF_THE_ROBOT), batches),
    *(
        Target(f"frames_{name}", decode_frames(name), ("drivers",), frame_seeds(name))
        for name in DIALECTS
        if name != OF_THE_ROBOT
    ),
    Target("error_frames", decode_errors, ("drivers.bus_health",), error_seeds, batches),
    Target("can_message", decode_can_message, ("drivers.unix_can", "can.message"), frame_rows),
    Target("unit_states", decode_states, ("drivers",), state_seeds),
    Target("dbc", decode_dbc, ("drivers.vcu_database", "cantools"), lambda: [OWN_DBC.read_bytes()]),
    Target("packets", decode_packets, ("drivers",), lambda: [b"\x10" + bytes(16) + b"\x05abcde"]),
)
