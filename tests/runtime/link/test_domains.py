# SPDX-License-Identifier: Apache-2.0
"""A link belongs to one ROS domain and tells types as one ROS release does: it hears nobody else, nor is it heard."""

import time

import pytest

from runtime.messages import definitions
from runtime.messages.imu import ImuMessage
from runtime.messages.session import RosSession, session_config
from runtime.robots import topics
from runtime.signals import Imu

OTHERS = {"another domain": (0, "humble"), "types as Jazzy tells them": (7, "rihs01")}


@pytest.fixture
def humble(start_link):
    return start_link(domain_id="7", type_hashes='"humble"')


def peer(link, domain, hashes):
    return RosSession("peer", domain, session_config([], [f"tcp/127.0.0.1:{link.port}"]), hashes)


def samples(session, rate):
    """Sends an inertial sample that is known by its rate."""
    publisher, message, imu = session.publisher("/imu/data", definitions.IMU), ImuMessage(), Imu(topics.IMU)
    imu.angular_velocity, imu.linear_acceleration = (0.0, 0.0, rate), (0.0, 0.0, 9.81)

    def send():
        imu.stamp_ns = time.time_ns()
        publisher.put(message.encode(imu))

    return send


@pytest.mark.parametrize("other", OTHERS)
def test_only_those_of_its_domain_and_release_are_heard_by_it(humble, other, until):
    seen, rates = Imu(topics.IMU), set()

    def heard():
        if humble.latest(seen):
            rates.add(float(seen.angular_velocity[2]))
        return 0.5 in rates

    with peer(humble, 7, "humble") as own, peer(humble, *OTHERS[other]) as foreign:
        sends = samples(foreign, 0.25), samples(own, 0.5)
        until(heard, lambda: [send() for send in sends])
        for _ in range(3):
            rates.clear()
            until(heard, lambda: [send() for send in sends])
    assert rates == {0.5}


@pytest.mark.parametrize("other", OTHERS)
def test_only_those_of_its_domain_and_release_hear_it(humble, other, until, inbox_type):
    boxes = inbox_type(), inbox_type()
    joints = humble.record(topics.JOINT_STATE)
    with peer(humble, 7, "humble") as own, peer(humble, *OTHERS[other]) as foreign:
        for session, box in zip((foreign, own), boxes, strict=True):
            session.subscribe("/joint_states", definitions.JOINT_STATE, box)
        numbers = iter(range(10**6))

        def tick():
            joints.stamp_ns = time.monotonic_ns()
            humble.tick("wbc", next(numbers), joints)

        until(lambda: len(boxes[1].payloads) >= 3, tick)
    assert not boxes[0].payloads
