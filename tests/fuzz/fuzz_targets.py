# SPDX-License-Identifier: Apache-2.0
"""Every decoder that faces a wire or a file, as a function of bytes that may only raise errors of ours.

A target is one line of `TARGETS`: a name, what takes the bytes, the modules that it is about, and where its seeds come
from. `test_decoders.py` gives each a few hundred inputs in `make test`, `campaign.py` many thousands in `make fuzz`.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import random
import socket
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from drivers.dialects import dialect_named
from drivers.errors import DriverError
from drivers.joint_group import JointGroup, Readings
from drivers.unix_hub import UnixHub
from drivers.vcu import UnitReadings, VehicleUnit
from drivers.vcu_database import OWN_DBC, UnitDatabase
from runtime.configuration import dump, loads, parse_overrides
from runtime.errors import UgvError
from runtime.executors.shared_memory import SharedReader, SharedWriter
from runtime.executors.tick import entries
from runtime.messages import attachment, battery, definitions, imu, path, pose, scan, standard, twist
from runtime.recording.bag import BagSink
from runtime.recording.bags import Bags
from runtime.recording.log import Log
from runtime.recording.loop_timing import read_loop_times
from runtime.recording.recorder_status import STATUS_FILE, RecorderStatus, read_status
from runtime.recording.recover import recover
from runtime.recording.replay import Replay
from runtime.recording.run_data import load_run
from runtime.robots import load_configuration
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Imu
from runtime.tracking.path_csv import read_path_csv

OURS = (UgvError, DriverError)
FRAMES, FRAME_BYTES = 64, 16
CELLS = 4
CDR = b"\0\1\0\0"


@dataclass(frozen=True)
class Target:
    """A decoder.

    Attributes:
        name: of the target.
        decode: takes the bytes; raises nothing but `OURS`.
        modules: that coverage is measured in.
        seeds: valid input, to be mutated.
        of_run: more of it, from a recorded run of the robot.
    """

    name: str
    decode: Callable[[bytes], object]
    modules: tuple[str, ...]
    seeds: Callable[[], list[bytes]]
    of_run: Callable[[Log], list[bytes]] = lambda log: []


@functools.cache
def toy() -> Any:
    """The tiny robot of the recording tests."""
    place = Path(__file__).parents[1] / "runtime" / "recording" / "conftest.py"
    spec = importlib.util.spec_from_file_location("toy_robot", place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["toy_robot"] = module
    spec.loader.exec_module(module)
    return module.Toy()


@functools.cache
def toy_setup() -> Any:
    """What its recorder is told."""
    return toy().setup()


@functools.cache
def room() -> Path:
    """A directory in memory, for decoders that take a file."""
    base = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    directory = tempfile.TemporaryDirectory(prefix="ugv-fuzz-", dir=base)
    _KEPT.append(directory)
    return Path(directory.name)


_KEPT: list[Any] = []


@contextmanager
def file_of(data: bytes, name: str) -> Iterator[Path]:
    """The bytes as a file, gone afterwards with what was made beside it."""
    with tempfile.TemporaryDirectory(dir=room()) as directory:
        place = Path(directory) / name
        place.write_bytes(data)
        yield place


# -- CAN ------------------------------------------------------------------------------------------------------------


@functools.cache
def joints() -> tuple[JointGroup, Readings]:
    """The joints of USLGO1."""
    config = load_configuration("uslgo1")
    group = JointGroup(config.drives.joints(config.safety), dialect_named(config.drives.dialect), 10_000_000)
    return group, Readings.empty(len(group.joints))


def decode_frames(data: bytes) -> None:
    """A batch: 16 bytes a frame, on the bus that its number says."""
    group, readings = joints()
    count = min(len(data) // FRAME_BYTES, FRAMES)
    frames = np.frombuffer(data[: count * FRAME_BYTES], group.frames.dtype)
    bus = np.arange(count, dtype=np.uint8) % 4
    before = int(group.counters.sum(dtype=np.int64))
    accepted = group.decode(frames, bus, np.full(count, 1, np.int64), count, readings)
    assert 0 <= accepted <= count
    assert accepted + int(group.counters.sum(dtype=np.int64)) - before >= count, "a frame was neither taken nor counted"
    assert np.isfinite(readings.position).all()
    assert np.isfinite(readings.velocity).all()


def frame_seeds() -> list[bytes]:
    """Frames to and from every drive."""
    group, _ = joints()
    commands = group.encode_damping().tobytes()
    replies = bytearray(commands)
    for place in range(0, len(replies), FRAME_BYTES):
        replies[place : place + 4] = struct.pack("<I", 0)
        replies[place + 8] = place // FRAME_BYTES % 3 + 1
    return [commands, bytes(replies), group.enable_frames().tobytes()]


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


# -- files ----------------------------------------------------------------------------------------------------------


def decode_config(data: bytes) -> None:
    """A configuration; one that is accepted says the same when it is written and read again."""
    config = loads(data.decode(errors="replace"), Uslgo1Config, place="fuzz")
    assert loads(dump(config), Uslgo1Config, place="fuzz") == config


def decode_overrides(data: bytes) -> None:
    """`--set` for each line."""
    overrides = parse_overrides(data.decode(errors="replace").split("\n"))
    loads(config_text(), Uslgo1Config, place="fuzz", overrides=overrides)


@functools.cache
def config_text() -> str:
    """USLGO1's configuration."""
    return dump(load_configuration("uslgo1"))


def decode_path(data: bytes) -> None:
    """A path file."""
    with file_of(data, "path.csv") as place:
        points = read_path_csv(place, capacity=100)
        assert np.isfinite(points).all()
        assert 2 <= len(points) <= 100


def decode_status(data: bytes) -> None:
    """What another process says of the recorder."""
    with file_of(data, STATUS_FILE) as place:
        assert isinstance(read_status(place.parent), (RecorderStatus, type(None)))


# -- logs -----------------------------------------------------------------------------------------------------------


def decode_log(data: bytes) -> None:
    """Everything that reads a log, but for its replay."""
    with file_of(data, "run_0.mcap") as place:
        log = Log(place)
        for topic in log.channels:
            try:
                log.read_signal(topic)
            except UgvError:
                continue
        log.counts()
        recover(log, place.parent / "recovered")
        read_loop_times(log)
        load_run(place)


def decode_replay(data: bytes) -> None:
    """A replay of a log that was altered."""
    with file_of(data, "run_0.mcap") as place:
        Replay(Log(place), toy().loops(), "toy").run()


@functools.cache
def log_seeds() -> list[bytes]:
    """Logs of a short run, whole and cut off, compressed and not."""
    found = []
    for compression in ("", "zstd"):
        with tempfile.TemporaryDirectory(dir=room()) as directory:
            options = SimpleNamespace(chunk_bytes=4096, chunk_span_ns=20_000_000, sync_ns=0, compression=compression)
            sink = BagSink(Path(directory) / "run", toy().setup(), options)  # type: ignore[arg-type]
            for datagram in toy().datagrams(seconds=0.06, key_frame_ns=20_000_000):
                sink.write(datagram)
            sink.close()
            data = sink.path.read_bytes()
            found += [data, data[: 2 * len(data) // 3]]
    return found


# -- between processes ----------------------------------------------------------------------------------------------


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


def sized(decode: Callable[[bytes, int], object]) -> Callable[[bytes], object]:
    """A decoder with the capacity of the robot's path."""
    return lambda data: decode(data, 100)


STORE = get_typestore(Stores.ROS2_JAZZY)


def message(type_name: str) -> Callable[[], list[bytes]]:
    """Messages of a type as an independent implementation writes them: with empty lists, and with some of one."""
    return lambda: [bytes(STORE.serialize_cdr(sample(type_name, length), type_name)) for length in (0, 1, 3)]


def sample(type_name: str, length: int) -> Any:
    """A message of plain values."""
    values = {name: _value(node, length) for name, node in STORE.fielddefs[type_name][1]}
    return STORE.types[type_name](**values)


def _value(node: Any, length: int) -> Any:
    kind, content = node
    if kind is Nodetype.BASE:
        return {"string": "odom", "bool": True}.get(content[0], 1)
    if kind is Nodetype.NAME:
        return sample(content, length)
    part, number = content
    count = number if kind is Nodetype.ARRAY else length
    if part[0] is Nodetype.BASE and part[1][0] != "string":
        return np.ones(count, part[1][0])
    return [_value(part, length) for _ in range(count)]


def clouds() -> list[bytes]:
    """Clouds of points with x, y and z, of none and of two."""
    found = []
    for count in (0, 2):
        cloud = sample(definitions.POINT_CLOUD2, 0)
        part = STORE.types["sensor_msgs/msg/PointField"]
        cloud.fields = [part(name, 4 * place, 7, 1) for place, name in enumerate("xyz")]
        cloud.height, cloud.width, cloud.point_step, cloud.row_step = 1, count, 12, 12 * count
        cloud.is_bigendian, cloud.data = False, np.ones(12 * count, np.uint8)
        found.append(bytes(STORE.serialize_cdr(cloud, definitions.POINT_CLOUD2)))
    return found


def bodies(topic: str, head: bytes = b"") -> Callable[[Log], list[bytes]]:
    """Some messages of a topic of a recorded run."""
    return lambda log: [head + bytes(message.body) for message in islice(log.messages([topic]), 0, 200, 20)]


def batches(log: Log) -> list[bytes]:
    """Batches of CAN frames that a robot received."""
    rows = log.read_signal("/ugv/can_received").values[::50]
    return [row["data"].tobytes()[: FRAME_BYTES * int(row["count"])] for row in rows]


MESSAGES, RECORDING = ("runtime.messages",), ("runtime.recording", "mcap")

TARGETS = (
    Target("frames", decode_frames, ("drivers",), frame_seeds, batches),
    Target("unit_states", decode_states, ("drivers",), state_seeds),
    Target("dbc", decode_dbc, ("drivers.vcu_database", "cantools"), lambda: [OWN_DBC.read_bytes()]),
    Target("packets", decode_packets, ("drivers",), lambda: [b"\x10" + bytes(16) + b"\x05abcde"]),
    Target("config", decode_config, ("runtime.configuration", "tomllib"), lambda: [config_text().encode()]),
    Target(
        "overrides",
        decode_overrides,
        ("runtime.configuration",),
        lambda: [b"gait.period_ns=500000000\nvariant.controller=FpM"],
    ),
    Target("path", decode_path, ("runtime.tracking.path_csv",), lambda: [b"x,y\n0,0\n1.5,2\n# c\n-1e1, 2\n"]),
    Target("status", decode_status, ("runtime.recording.recorder_status",), lambda: [b'{"bags": 1, "error": "e"}']),
    Target("log", decode_log, RECORDING, log_seeds),
    Target("replay", decode_replay, RECORDING, log_seeds),
    Target("datagram", decode_datagram, RECORDING, lambda: toy().datagrams(seconds=0.02)),
    Target("shared", decode_shared, ("runtime.executors.shared_memory",), shared_seeds),
    Target(
        "attachment", attachment.parse_attachment, MESSAGES, lambda: [attachment.Attachment(1, 2, bytes(16)).to_bytes()]
    ),
    Target("imu", imu.decode_imu, MESSAGES, message(definitions.IMU), bodies("/imu/data", CDR)),
    Target("pose", pose.decode_pose_stamped, MESSAGES, message(definitions.POSE_STAMPED)),
    Target(
        "pose_covariance",
        pose.decode_pose_with_covariance_stamped,
        MESSAGES,
        message(definitions.POSE_WITH_COVARIANCE_STAMPED),
    ),
    Target("twist", twist.decode_twist, MESSAGES, message(definitions.TWIST)),
    Target(
        "twist_stamped",
        twist.decode_twist_stamped,
        MESSAGES,
        message(definitions.TWIST_STAMPED),
        bodies("/cmd_vel", CDR),
    ),
    Target("path_message", sized(path.decode_path), MESSAGES, message(definitions.PATH), bodies("/path", CDR)),
    Target("battery", battery.decode_battery_state, MESSAGES, message(definitions.BATTERY_STATE)),
    Target("scan", scan.decode_laser_scan, MESSAGES, message(definitions.LASER_SCAN)),
    Target("cloud", scan.decode_point_cloud, MESSAGES, clouds),
    Target("bool", standard.decode_bool, MESSAGES, message(definitions.BOOL)),
    Target("string", standard.decode_string, MESSAGES, message(definitions.STRING)),
    Target("float64", standard.decode_float64, MESSAGES, message(definitions.FLOAT64)),
)


def mutated(seed: bytes, choice: random.Random) -> bytes:
    """A seed with a few things done to it that break decoders: other bytes, lengths, cuts, repeats."""
    data = bytearray(seed)
    for _ in range(choice.randint(1, 4)):
        place = choice.randrange(len(data) + 1)
        kind = choice.randrange(6)
        if kind == 0 and data:
            data[place % len(data)] ^= 1 << choice.randrange(8)
        elif kind == 1:
            data[place : place + 1] = choice.randbytes(choice.randint(0, 4))
        elif kind == 2:
            data[place : place + 8] = choice.choice((b"\xff" * 8, b"\0" * 8, b"\xff" * 7 + b"\x7f", b"\0\0\0\x80" * 2))
        elif kind == 3:
            del data[place:]
        elif kind == 4:
            data[place:place] = data[place : place + choice.randint(1, 64)]
        else:
            del data[place : place + choice.randint(1, 64)]
    return bytes(data)
