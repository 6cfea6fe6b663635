# SPDX-License-Identifier: Apache-2.0
"""Everything that an operator may ask for has a message, on a topic that the link takes."""

import pytest

from runtime.link.topics import CMD_VEL, TAKEN
from runtime.messages.twist import decode_twist
from runtime.signals import OperatorEvent, Request
from sim_bridge.ros_messages import TYPES, operator_message


@pytest.mark.parametrize("request_", Request)
def test_every_request_has_a_message(request_):
    event = OperatorEvent("/event")
    event.request = request_
    topic, payload = operator_message(event)
    assert topic in TYPES
    assert topic in TAKEN
    assert payload


def test_a_velocity_is_said_as_it_is_asked_for():
    event = OperatorEvent("/event")
    event.request, event.velocity = Request.VELOCITY, (0.4, -0.2, 0.1)
    topic, payload = operator_message(event)
    assert topic == CMD_VEL
    assert decode_twist(payload) == (0, "", 0.4, -0.2, 0.1)
