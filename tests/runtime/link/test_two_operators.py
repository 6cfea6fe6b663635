# SPDX-License-Identifier: Apache-2.0
"""Two operators on real zenoh sessions are two sources, be it that neither has spoken before."""

from __future__ import annotations

import time

from runtime.messages import definitions
from runtime.messages.standard import encode_string
from runtime.robots import topics
from runtime.signals import Motion, OperatorEvent, Request

TRUE, FALSE = b"\0\1\0\0\1", b"\0\1\0\0\0"


def test_two_operators_who_were_there_before_either_spoke_are_two_sources(link, until):
    found: dict[tuple[int, int], int] = {}
    event, port = OperatorEvent(topics.OPERATOR_EVENT), link.events()

    def take() -> bool:
        while port.read(event, time.monotonic_ns()):
            found[event.request, event.motion] = event.source
        return len(found) == 4

    with link.peer("ann") as ann, link.peer("ben") as ben:
        said = [
            (operator.publisher("/operator/arm", definitions.BOOL), arm)
            for operator, arm in ((ann, TRUE), (ben, FALSE))
        ] + [
            (operator.publisher("/operator/motion", definitions.STRING), encode_string(motion))
            for operator, motion in ((ann, "stand"), (ben, "sit"))
        ]

        def send() -> None:
            for publisher, payload in said:
                publisher.put(payload)

        until(take, send)
    assert found[Request.ARM, Motion.REST] == found[Request.MOTION, Motion.STAND], "one is ann"
    assert found[Request.DISARM, Motion.REST] == found[Request.MOTION, Motion.SIT], "one is ben"
    assert len(set(found.values())) == 2
