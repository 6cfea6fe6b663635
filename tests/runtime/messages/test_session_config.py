# SPDX-License-Identifier: Apache-2.0
"""By default a session is met on this computer alone, and looks for nobody."""

from __future__ import annotations

import json

import pytest

from runtime.messages.session import session_config
from runtime.robots import ROBOTS, load_configuration

LOOKS_FOR_OTHERS = ("scouting/multicast/enabled", "scouting/gossip/enabled")


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robot_s_link_listens_on_the_loopback_alone_and_connects_to_nobody(robot):
    link = load_configuration(robot).link
    config = session_config(link.listen, link.connect)
    assert not link.zenoh_config, "a file would stand in place of all this"
    endpoints = json.loads(config.get_json("listen/endpoints"))
    assert endpoints
    assert all(endpoint.startswith("tcp/127.0.0.1:") for endpoint in endpoints)
    assert json.loads(config.get_json("connect/endpoints")) == []


@pytest.mark.parametrize("key", LOOKS_FOR_OTHERS)
@pytest.mark.parametrize(
    ("listen", "connect"),
    [(["tcp/127.0.0.1:7447"], []), ([], ["tcp/127.0.0.1:7447"]), (["tcp/0.0.0.0:7447"], ["tcp/192.0.2.1:7447"])],
    ids=["the robot", "a peer", "on a network"],
)
def test_wherever_it_listens_and_connects_it_looks_for_nobody(listen, connect, key):
    assert json.loads(session_config(listen, connect).get_json(key)) is False


def test_a_session_that_is_given_no_endpoint_has_none():
    config = session_config([], [])
    assert [json.loads(config.get_json(key)) for key in ("listen/endpoints", "connect/endpoints")] == [[], []]


@pytest.mark.parametrize("key", ["transport/shared_memory/enabled", "adminspace/enabled"])
def test_what_would_leave_files_behind_or_open_a_session_to_commands_is_off(key):
    assert json.loads(session_config(["tcp/127.0.0.1:7447"], []).get_json(key)) is False
