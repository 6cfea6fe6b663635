# SPDX-License-Identifier: Apache-2.0
"""A client of rmw_zenoh's protocol that is not ours exchanges messages with the link, both ways.

It computes keys, tokens, type hashes and attachments by itself, from message definitions that it is given as files (it
would fetch them from the network otherwise).
"""

from __future__ import annotations

import importlib
import os
import time

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from runtime.messages import definitions
from runtime.robots import topics
from runtime.signals import Imu, OperatorEvent, Pose, Request

os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")  # it can fetch definitions with git, which is not wanted here
sdk = importlib.import_module("zenoh_ros2_sdk")
STORE = get_typestore(Stores.ROS2_JAZZY)
SEPARATOR = "=" * 80
EXCHANGED = (
    definitions.IMU,
    definitions.POSE_STAMPED,
    definitions.PATH,
    definitions.TWIST,
    definitions.TWIST_STAMPED,
    definitions.ODOMETRY,
    definitions.JOINT_STATE,
    definitions.TF,
    definitions.DIAGNOSTIC_ARRAY,
    definitions.BATTERY_STATE,
    definitions.BOOL,
    definitions.STRING,
)


@pytest.fixture(scope="module")
def message_files(tmp_path_factory):
    """Every message that is exchanged, as the .msg files of a distribution."""
    directory = tmp_path_factory.mktemp("messages")
    for name in EXCHANGED:
        text, _ = STORE.generate_msgdef(name, ros_version=2)
        first, *others = text.split(SEPARATOR)
        for part in (f"MSG: {name}\n{first}", *others):
            heading, _, lines = part.strip().partition("\n")
            package, message = heading.removeprefix("MSG: ").replace("/msg/", "/").split("/")
            path = directory / package / "msg" / f"{message}.msg"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(lines)
    return directory


@pytest.fixture
def client(link, message_files, monkeypatch):
    """How the client is to reach the link; its one session ends with the test."""
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", "transport/shared_memory/enabled=false")  # leaves no files behind
    monkeypatch.setattr("zenoh_ros2_sdk.message_registry._registry", None)
    sdk.ZenohSession._instance = None
    where = {"router_ip": "127.0.0.1", "router_port": link.port, "domain_id": 0}
    session = sdk.ZenohSession.get_instance("127.0.0.1", link.port)
    sdk.get_registry().messages_dir = message_files
    yield where
    session.close()


def stamp_now():
    return STORE.types["builtin_interfaces/msg/Time"](*divmod(time.time_ns(), 10**9))


def test_its_imu_and_its_requests_are_taken(link, client, until):
    imu = sdk.ROS2Publisher("/imu/data", definitions.IMU, **client)
    arm = sdk.ROS2Publisher("/operator/arm", definitions.BOOL, **client)
    motion = sdk.ROS2Publisher("/operator/motion", definitions.STRING, **client)
    store = sdk.ZenohSession.get_instance().store
    vector, turn = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Quaternion"]
    zeros = np.zeros(9)

    def send() -> None:
        header = store.types["std_msgs/msg/Header"](stamp_now(), "imu_link")
        imu.publish(
            header=header,
            orientation=turn(0.0, 0.0, 0.0, 1.0),
            orientation_covariance=zeros,
            angular_velocity=vector(0.1, 0.2, 0.3),
            angular_velocity_covariance=zeros,
            linear_acceleration=vector(0.0, 0.0, 9.81),
            linear_acceleration_covariance=zeros,
        )

    sample = Imu(topics.IMU)
    until(lambda: link.latest(sample), send)
    assert sample.angular_velocity.tolist() == [0.1, 0.2, 0.3]
    assert sample.linear_acceleration.tolist() == [0.0, 0.0, 9.81]

    event, port, found = OperatorEvent(topics.OPERATOR_EVENT), link.events(), {}

    def both() -> bool:
        while port.read(event, time.monotonic_ns()):
            found[event.request] = event.source
        return len(found) == 2

    def ask() -> None:
        arm.publish(data=True)
        motion.publish(data="stand")

    until(both, ask)
    assert set(found) == {Request.ARM, Request.MOTION}
    assert found[Request.ARM] == found[Request.MOTION], "its publishers have ids of their own, and one session"


def test_its_pose_and_its_path_are_taken(link, client, until):
    pose = sdk.ROS2Publisher("/localization/pose", definitions.POSE_STAMPED, **client)
    path = sdk.ROS2Publisher("/path", definitions.PATH, **client)
    types = sdk.ZenohSession.get_instance().store.types
    header, stamped, place = (
        types[name] for name in ("std_msgs/msg/Header", definitions.POSE_STAMPED, "geometry_msgs/msg/Pose")
    )
    point, turn = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]

    def at(x: float, y: float):
        return place(point(x, y, 0.3), turn(0.0, 0.0, 0.0, 1.0))

    def send() -> None:
        now = header(stamp_now(), "odom")
        pose.publish(header=now, pose=at(1.0, 2.0))
        path.publish(header=now, poses=[stamped(now, at(x, 0.0)) for x in (0.0, 1.0, 2.0)])

    seen, followed = Pose(topics.LOCALIZATION), link.record(topics.PATH)
    until(lambda: link.latest(seen), send)
    until(lambda: link.latest(followed), send)
    assert seen.position.tolist() == [1.0, 2.0, 0.3]
    assert followed.x[: followed.count].tolist() == [0.0, 1.0, 2.0]


def test_its_velocities_of_either_type_and_its_emergency_stop_are_taken(link, client, until):
    plain = sdk.ROS2Publisher("/cmd_vel", definitions.TWIST, **client)
    stamped = sdk.ROS2Publisher("/cmd_vel", definitions.TWIST_STAMPED, **client)
    stop = sdk.ROS2Publisher("/operator/e_stop", definitions.BOOL, **client)
    types = sdk.ZenohSession.get_instance().store.types
    header, twist, vector = (
        types[name] for name in ("std_msgs/msg/Header", definitions.TWIST, "geometry_msgs/msg/Vector3")
    )
    event, port, asked = OperatorEvent(topics.OPERATOR_EVENT), link.events(), set()

    def send() -> None:
        plain.publish(linear=vector(0.25, 0.0, 0.0), angular=vector(0.0, 0.0, 0.0))
        faster = twist(vector(0.5, 0.0, 0.0), vector(0.0, 0.0, 0.125))
        stamped.publish(header=header(stamp_now(), "base_link"), twist=faster)
        stop.publish(data=True)

    def all_came() -> bool:
        while port.read(event, time.monotonic_ns()):
            asked.add((event.request, *event.velocity.tolist()))
        return len(asked) == 3

    until(all_came, send)
    assert asked == {
        (Request.VELOCITY, 0.25, 0.0, 0.0),
        (Request.VELOCITY, 0.5, 0.0, 0.125),
        (Request.EMERGENCY_STOP, 0.0, 0.0, 0.0),
    }


def test_it_reads_transforms_diagnostics_and_the_battery(link, client, until):
    types = {"/tf": definitions.TF, "/diagnostics": definitions.DIAGNOSTIC_ARRAY}
    types["/battery_state"] = definitions.BATTERY_STATE
    got: dict[str, list] = {topic: [] for topic in types}
    subscribers = [sdk.ROS2Subscriber(topic, name, got[topic].append, **client) for topic, name in types.items()]
    body, battery = link.record(topics.BODY_STATE), link.record(topics.BATTERY)
    body.orientation[3], body.position, battery.voltage = 1.0, (1, 2, 0.29), 28.5
    counter = iter(range(10**9))

    def tick() -> None:
        body.stamp_ns = battery.stamp_ns = time.monotonic_ns()
        link.tick("wbc", next(counter), body, battery)

    until(lambda: all(got.values()), tick)
    (transform,) = got["/tf"][-1].transforms
    assert (transform.child_frame_id, transform.transform.translation.y) == ("base_link", 2.0)
    assert got["/battery_state"][-1].voltage == 28.5
    assert {part.name for part in got["/diagnostics"][-1].status} >= {"link", "battery", "loop mpc"}
    for subscriber in subscribers:
        subscriber.close()


def test_it_reads_joint_states_odometry_and_the_kept_description(link, client, until):
    got: dict[str, list] = {"/joint_states": [], "/odom": [], "/robot_description": []}
    subscribers = [
        sdk.ROS2Subscriber("/joint_states", definitions.JOINT_STATE, got["/joint_states"].append, **client),
        sdk.ROS2Subscriber("/odom", definitions.ODOMETRY, got["/odom"].append, **client),
    ]
    body, joints = link.record(topics.BODY_STATE), link.record(topics.JOINT_STATE)
    body.orientation[3] = 1.0
    body.position, joints.position = (1, 2, 0.29), range(12)
    counter = iter(range(10**9))

    def tick() -> None:
        body.stamp_ns = joints.stamp_ns = time.monotonic_ns()
        link.tick("wbc", next(counter), body, joints)

    until(lambda: got["/joint_states"] and got["/odom"], tick)
    assert got["/joint_states"][-1].position.tolist() == list(range(12))
    assert list(got["/joint_states"][-1].name) == list(link.setup.joint_names)
    assert got["/odom"][-1].pose.pose.position.y == 2

    kept = ":1:,1:,:,:,,"
    subscribers.append(
        sdk.ROS2Subscriber(
            "/robot_description", definitions.STRING, got["/robot_description"].append, qos=kept, **client
        )
    )
    until(lambda: got["/robot_description"])
    assert got["/robot_description"][-1].data == link.setup.description
    for subscriber in subscribers:
        subscriber.close()


def test_it_finds_the_link_in_the_ros_graph(link, client, until):
    names: dict[str, list[str]] = {}
    until(lambda: names.update(sdk.get_topic_names_and_types(**client)) or "/odom" in names)
    assert any("Odometry" in name for name in names["/odom"])
    assert "/imu/data" in names
