# SPDX-License-Identifier: Apache-2.0
"""The link between real zenoh sessions at one end, and the files and sockets of the control process at the other."""

from __future__ import annotations

import json
import struct
import threading
import time

import pytest
import zenoh
import zenoh.ext
from rosbags.typesys import Stores, get_typestore

from runtime.executors.shared_memory import SharedMemoryError
from runtime.executors.tick import entries, manifest_of, tick_record
from runtime.executors.tick_stream import RECORDER_SOCKET, TickListener, TickStreamError
from runtime.link.loop import link_loop
from runtime.link.topic_input import FAULT
from runtime.link.topics import TAKEN
from runtime.messages import definitions
from runtime.messages.battery import BatteryMessage
from runtime.messages.imu import ImuMessage
from runtime.messages.keys import Node, data_key
from runtime.messages.path import PathMessage
from runtime.messages.session import Publisher, SessionError
from runtime.messages.standard import encode_string
from runtime.messages.twist import TwistStampedMessage
from runtime.robots import topics
from runtime.signals import (
    Battery,
    BodyCommand,
    Fault,
    Imu,
    Mode,
    Motion,
    OperatorEvent,
    Path,
    Pose,
    Request,
)

STORE = get_typestore(Stores.ROS2_JAZZY)
TRUE, FALSE, EMPTY = b"\0\1\0\0\1", b"\0\1\0\0\0", b"\0\1\0\0\0"


def parsed(payload: bytes, type_name: str):
    return STORE.deserialize_cdr(payload, type_name)


def status(inbox, name: str):
    """Level, message and values of a part in the newest diagnostics, or None."""
    if not inbox.payloads:
        return None
    for part in parsed(inbox.payloads[-1], definitions.DIAGNOSTIC_ARRAY).status:
        if part.name == name:
            return part.level, part.message, {pair.key: pair.value for pair in part.values}
    return None


def kept(session, topic: str, type_name: str) -> list[bytes]:
    """What a subscriber that comes late is given, as it comes."""
    found: list[bytes] = []
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
    key = data_key(0, topic, type_name)
    take = zenoh.handlers.Callback(lambda sample: found.append(bytes(sample.payload)))
    zenoh.ext.declare_advanced_subscriber(session._session, key, take, history=history)
    return found


def test_an_imu_sample_reaches_the_control_loops(link, until, inbox_type):
    message, imu = ImuMessage(), Imu(topics.IMU)
    imu.angular_velocity, imu.linear_acceleration = (0.1, 0.2, 0.3), (1, 2, 9.81)
    with link.peer() as sensor:
        publisher = sensor.publisher("/imu/data", definitions.IMU)
        seen = Imu(topics.IMU)

        def send() -> None:
            imu.stamp_ns = time.time_ns()
            publisher.put(message.encode(imu))

        send()
        until(lambda: link.latest(seen), send)
    assert seen.angular_velocity.tolist() == [0.1, 0.2, 0.3]
    assert seen.linear_acceleration.tolist() == [1, 2, 9.81]
    assert 0 <= time.monotonic_ns() - seen.stamp_ns < 60 * 10**9


def test_pose_battery_and_path_reach_the_control_loops(link, until, inbox_type):
    pose = STORE.types[definitions.POSE_STAMPED]
    header = STORE.types["std_msgs/msg/Header"](STORE.types["builtin_interfaces/msg/Time"](0, 0), "odom")
    point, turn = STORE.types["geometry_msgs/msg/Point"], STORE.types["geometry_msgs/msg/Quaternion"]
    message = pose(header, STORE.types["geometry_msgs/msg/Pose"](point(1.0, 2.0, 3.0), turn(0.0, 0.0, 0.6, 0.8)))
    pose_payload = bytes(STORE.serialize_cdr(message, definitions.POSE_STAMPED))
    battery = Battery("/x")
    battery.voltage, battery.current, battery.charge = 28.0, 3.0, 0.5
    path = Path("/x", {"path": 4})
    path.count, path.x, path.y = 4, (0, 1, 1, 0), (0, 0, 1, 0)
    with link.peer() as peer:
        sent = (
            ("/localization/pose", definitions.POSE_STAMPED, pose_payload),
            ("/bms/battery_state", definitions.BATTERY_STATE, BatteryMessage().encode(battery)),
            ("/path/speed", definitions.FLOAT64, b"\0\1\0\0" + struct.pack("<d", 0.25)),
            ("/path", definitions.PATH, PathMessage().encode(path)),
        )
        publishers = [(peer.publisher(topic, name), payload) for topic, name, payload in sent]

        def send() -> None:
            for publisher, payload in publishers:
                publisher.put(payload)

        got_pose, got_battery = Pose(topics.LOCALIZATION), Battery(topics.BATTERY)
        got_path = link.record(topics.PATH)
        for record in (got_pose, got_battery):
            until(lambda record=record: link.latest(record), send)
        until(lambda: link.latest(got_path) and got_path.speed == 0.25, send)
    assert got_pose.position.tolist() == [1, 2, 3]
    assert got_pose.orientation.tolist() == pytest.approx([0, 0, 0.6, 0.8])
    assert (got_battery.voltage, got_battery.current, got_battery.charge) == (28, 3, 0.5)
    assert (got_path.count, got_path.closed) == (3, True), "its last point is its first"
    assert got_path.x[:3].tolist() == [0, 1, 1]


def test_an_operator_s_messages_become_requests_of_one_source(link, until, inbox_type):
    velocity = BodyCommand("/x")
    velocity.velocity, velocity.yaw_rate = (0.3, 0.1), 0.2
    twist = b"\0\1\0\0" + struct.pack("<6d", 0.5, 0.0, 0, 0, 0, -0.5)
    sent = (
        ("/operator/heartbeat", definitions.EMPTY, EMPTY, Request.LIFE),
        ("/operator/arm", definitions.BOOL, TRUE, Request.ARM),
        ("/operator/motion", definitions.STRING, encode_string("walk"), Request.MOTION),
        ("/cmd_vel", definitions.TWIST, twist, Request.VELOCITY),
        ("/teleop/cmd_vel", definitions.TWIST_STAMPED, TwistStampedMessage().encode(velocity), Request.VELOCITY),
        ("/operator/arm", definitions.BOOL, FALSE, Request.DISARM),
        ("/operator/reset", definitions.EMPTY, EMPTY, Request.RESET),
        ("/operator/release", definitions.EMPTY, EMPTY, Request.RELEASE),
        ("/operator/e_stop", definitions.BOOL, TRUE, Request.EMERGENCY_STOP),
    )
    found: dict[tuple[int, int], tuple] = {}
    event, port = OperatorEvent(topics.OPERATOR_EVENT), link.events()

    def take() -> bool:
        while port.read(event, time.monotonic_ns()):
            found[event.request, event.priority] = (event.source, event.motion, event.velocity.tolist())
        return len(found) == len(said)

    with link.peer() as operator:
        said: list[tuple[Publisher, bytes]] = []

        def send() -> None:
            for publisher, payload in said:
                publisher.put(payload)

        *others, stop = [(operator.publisher(topic, name), payload) for topic, name, payload, _ in sent]
        for more in (others, [stop]):  # the stop last, since resets that wait when it comes are dropped
            said += more
            until(take, send)
    assert {request for request, _ in found} == {request for *_, request in sent}
    assert len({source for source, *_ in found.values()}) == 1, "one operator is one source"
    config = link.setup.config
    assert found[Request.VELOCITY, config.cmd_vel_priority][2] == [0.5, 0.0, -0.5]
    assert found[Request.VELOCITY, config.teleop_priority][2] == [0.3, 0.1, 0.2]
    assert found[Request.MOTION, config.operator_priority][1] == Motion.WALK


def test_what_control_does_is_published(link, until, inbox_type):
    state, joints = link.record(topics.BODY_STATE), link.record(topics.JOINT_STATE)
    state.orientation[3] = 1.0
    with link.peer() as viewer:
        boxes = {}
        for topic, name in (
            ("/joint_states", definitions.JOINT_STATE),
            ("/odom", definitions.ODOMETRY),
            ("/tf", definitions.TF),
            ("/battery_state", definitions.BATTERY_STATE),
            ("/ugv/state", definitions.STRING),
        ):
            boxes[topic] = inbox_type()
            viewer.subscribe(topic, name, boxes[topic])
        battery = link.record(topics.BATTERY)
        battery.voltage = 28.5
        counter = iter(range(10**9))

        def tick() -> None:
            state.stamp_ns = joints.stamp_ns = battery.stamp_ns = time.monotonic_ns()
            state.position, joints.position = (1, 2, 0.29), range(12)
            link.tick("wbc", next(counter), state, joints, battery)

        until(lambda: all(box.payloads for box in boxes.values()), tick)
        until(lambda: "position" in json.loads(parsed(boxes["/ugv/state"].payloads[-1], definitions.STRING).data), tick)
    joint_state = parsed(boxes["/joint_states"].payloads[-1], definitions.JOINT_STATE)
    assert list(joint_state.name) == list(link.setup.joint_names)
    assert joint_state.position.tolist() == list(range(12))
    stamp_ns = joint_state.header.stamp.sec * 10**9 + joint_state.header.stamp.nanosec
    assert abs(time.time_ns() - stamp_ns) < 60 * 10**9, "in unix time"
    odometry = parsed(boxes["/odom"].payloads[-1], definitions.ODOMETRY)
    assert odometry.pose.pose.position.y == 2
    assert parsed(boxes["/tf"].payloads[-1], definitions.TF).transforms[0].child_frame_id == "base_link"
    assert parsed(boxes["/battery_state"].payloads[-1], definitions.BATTERY_STATE).voltage == 28.5
    assert json.loads(parsed(boxes["/ugv/state"].payloads[-1], definitions.STRING).data)["position"] == [1, 2, 0.29]
    assert all(len(attachment) == 33 for box in boxes.values() for attachment in box.attachments)


def test_diagnostics_tell_silence_and_damping_at_once(link, until, inbox_type):
    with link.peer() as viewer:
        inbox = inbox_type()
        viewer.subscribe("/diagnostics", definitions.DIAGNOSTIC_ARRAY, inbox)
        until(lambda: status(inbox, "control") is not None)
        assert status(inbox, "control")[:2] == (2, "control is silent")
        safety = link.record(topics.SAFETY)
        counter = iter(range(10**9))

        def tick() -> None:
            link.tick("wbc", next(counter), safety)

        safety.mode = Mode.STANDING
        until(lambda: status(inbox, "control")[:2] == (0, "standing"), tick)
        safety.mode, safety.fault = Mode.DAMPED, Fault.TILT | Fault.STALE_IMU
        until(lambda: status(inbox, "control")[:2] == (2, "damped: tilt stale_imu"), tick)
        until(lambda: status(inbox, "control")[:2] == (2, "control is silent"))


def test_what_is_rejected_is_counted_by_topic_and_reason(link, until, inbox_type):
    with link.peer() as peer:
        inbox = inbox_type()
        peer.subscribe("/diagnostics", definitions.DIAGNOSTIC_ARRAY, inbox)
        motion = peer.publisher("/operator/motion", definitions.STRING)

        def told() -> bool:
            found = status(inbox, "input /operator/motion")
            return found is not None and int(found[2].get("the motion is none of rest, stand, walk, sit", 0)) > 0

        until(told, lambda: motion.put(encode_string("fly")))


def test_the_description_waits_for_late_joiners(link, until):
    with link.peer() as viewer:
        description, fixed = (
            kept(viewer, "/robot_description", definitions.STRING),
            kept(viewer, "/tf_static", definitions.TF),
        )
        until(lambda: description and fixed)
        assert parsed(description[0], definitions.STRING).data == link.setup.description
        assert parsed(fixed[0], definitions.TF).transforms[0].child_frame_id == "imu_link"


def test_the_link_is_part_of_the_ros_graph(link, until, inbox_type):
    with link.peer() as viewer:
        tokens: list[str] = []
        viewer.watch_publishers(lambda token, alive: tokens.append(token))
        until(lambda: any("%odom" in token for token in tokens))
        session = next(token for token in tokens if "%odom" in token).split("/")[2]
        number = int(next(token for token in tokens if "%odom" in token).split("/")[4])
        assert Node(0, session, "ugv_link").endpoint_token(number, "MP", "/odom", definitions.ODOMETRY) in tokens


def test_the_link_s_own_ticks_and_status_are_logged(link, until):
    loop = link_loop(link.setup.config, link.setup.priority)
    manifest, (status,) = manifest_of((*link.setup.loops, loop)), loop.port_inputs
    tick, recorder, before = tick_record(loop), TickListener(link.directory / RECORDER_SOCKET), -1
    try:
        for _ in range(2):
            (channel, body), *_ = entries(recorder.receive(30.0))
            assert channel == manifest.of_topic("/ugv/tick/link").number
            tick.load(body)
            assert tick.index > before
            before = tick.index
        assert tick.wake_latency_ns >= 0
        with link.peer() as peer:
            motion = peer.publisher("/operator/motion", definitions.STRING)

            def told() -> bool:
                """The status comes after the tick whenever it has changed."""
                _, *more = entries(recorder.receive(30.0))
                for channel, body in more:
                    assert channel == manifest.of_topic(status.topic).number
                    status.load(body)
                return status.rejected[TAKEN.index("/operator/motion")] > 0

            until(told, lambda: motion.put(encode_string("fly")))
    finally:
        recorder.close()


def test_a_flood_does_not_keep_an_emergency_stop(link, until):
    event, port, over = OperatorEvent(topics.OPERATOR_EVENT), link.events(), threading.Event()
    with link.peer("flood") as flooding, link.peer("operator") as operator:
        beats = flooding.publisher("/operator/heartbeat", definitions.EMPTY)
        teleop = flooding.publisher("/teleop/cmd_vel", definitions.TWIST)
        stop = operator.publisher("/operator/e_stop", definitions.BOOL)

        def flood() -> None:
            while not over.is_set():
                beats.put(EMPTY)
                teleop.put(b"\0\1\0\0" + bytes(48))

        def read(*requests: Request) -> bool:
            """As the control loop does, take one a tick."""
            return port.read(event, time.monotonic_ns()) and event.request in requests

        flooder = threading.Thread(target=flood)
        flooder.start()
        try:
            until(lambda: read(Request.LIFE, Request.VELOCITY))
            until(lambda: read(Request.EMERGENCY_STOP), lambda: stop.put(TRUE))
        finally:
            over.set()
            flooder.join()


def test_messages_of_any_bytes_leave_the_link_at_work(link, until, inbox_type):
    """Such as are refused at their first byte, in the midst of a field, and at their end."""
    plain, noise = b"\0\1\0\0", bytes(range(256)) * 8
    long, late = "the message is longer than its type", "a stamp has a second's worth of nanoseconds or more"
    flag, points = "a flag is neither true nor false", "the cloud's points have no x, y and z"
    kinds = {
        "/imu/data": definitions.IMU,
        "/path": definitions.PATH,
        "/operator/arm": definitions.BOOL,
        "/points": definitions.POINT_CLOUD2,
    }
    with link.peer() as peer:
        inbox = inbox_type()
        peer.subscribe("/diagnostics", definitions.DIAGNOSTIC_ARRAY, inbox)
        publishers = {topic: peer.publisher(topic, name) for topic, name in kinds.items()}

        def reasons(topic) -> set[str]:
            found = status(inbox, f"input {topic}")
            return set() if found is None else set(found[2])

        for message, told in (
            (b"\1" + noise, dict.fromkeys(kinds, "the encapsulation is not plain CDR")),
            (plain + noise[:20], dict.fromkeys(kinds, "the message ends too early") | {"/operator/arm": long}),
            (plain + b"\xff" * 2048, dict.fromkeys(kinds, late) | {"/operator/arm": flag}),
            (plain + bytes(2048), dict.fromkeys(kinds, long) | {"/points": points}),
        ):

            def put(message=message) -> None:
                for publisher in publishers.values():
                    publisher.put(message)

            until(lambda told=told: all(told[topic] in reasons(topic) for topic in kinds), put)
        assert not any(reason.startswith(FAULT) for topic in kinds for reason in reasons(topic))


def test_a_second_link_is_refused(link, start_link):
    with pytest.raises((SharedMemoryError, TickStreamError)):
        start_link(link.directory)


def test_an_address_in_use_is_said(link, start_link, tmp_path_factory):
    with pytest.raises(SessionError, match="Address already in use"):
        start_link(tmp_path_factory.mktemp("other"), link.port)


def test_after_the_end_nothing_is_left_but_the_files(start_link, tmp_path):
    before = threading.active_count()
    link = start_link()
    link.stop()
    assert threading.active_count() == before
    assert not list(tmp_path.glob("*.sock"))
    start_link(port=link.port)
