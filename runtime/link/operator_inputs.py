# SPDX-License-Identifier: Apache-2.0
"""What an operator sends, as requests to the control loop."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from runtime.link.checks import check_finite, check_frame
from runtime.link.clocks import Instant, StampWindow
from runtime.link.event_outlet import Event
from runtime.link.per_source import PerSource
from runtime.messages.errors import MessageError
from runtime.messages.twist import Velocity
from runtime.robots.link_config import LinkConfig
from runtime.signals import Motion, Request

Offer = Callable[[Event, int], None]
_MOTIONS = {motion.name.lower(): motion for motion in Motion}


class RequestUse:
    """Turns messages of one priority into requests, as of the time of their arrival.

    Args:
        offer: takes a request, and the present.
        priority: of the topic.
    """

    def __init__(self, offer: Offer, priority: int) -> None:
        self._offer, self._priority = offer, priority

    def _request(self, request: Request, source: int, now: Instant, motion: Motion = Motion.REST) -> None:
        event = Event(now.monotonic_ns, source, self._priority, request, motion)
        self._offer(event, now.monotonic_ns)

    def arm(self, armed: bool, source: int, now: Instant) -> None:
        """Arm, or withdraw the arm."""
        self._request(Request.ARM if armed else Request.DISARM, source, now)

    def motion(self, name: str, source: int, now: Instant) -> None:
        """Rest, stand, walk or sit."""
        motion = _MOTIONS.get(name.strip().lower())
        if motion is None:
            raise MessageError("the motion is none of rest, stand, walk, sit")
        self._request(Request.MOTION, source, now, motion)

    def emergency_stop(self, pressed: bool, source: int, now: Instant) -> None:
        """Stop; a button that is not pressed asks for nothing."""
        if pressed:
            self._request(Request.EMERGENCY_STOP, source, now)

    def plain(self, request: Request) -> Callable[[None, int, Instant], None]:
        """What uses a message without content as a request."""
        return lambda _, source, now: self._request(request, source, now)


class VelocityUse:
    """Turns twists of one topic into requests; only forward, lateral and yaw velocity can be asked for.

    Stamps are put in order sender by sender, since two differ in their clocks and in their delays. One that was
    forgotten, being one of many, may begin anew with any stamp that is not too old.

    Args:
        config: frames and age.
        offer: takes a request, and the present.
        priority: of the topic.
    """

    def __init__(self, config: LinkConfig, offer: Offer, priority: int) -> None:
        self._frames, self._offer, self._priority = config.velocity_frames, offer, priority
        self._windows = PerSource(partial(StampWindow, config.velocity_age_max_ns, config.future_max_ns))

    def __call__(self, velocity: Velocity, source: int, now: Instant) -> None:
        """Use a twist."""
        check_frame(velocity.frame, self._frames)
        asked = velocity.forward, velocity.lateral, velocity.yaw_rate
        check_finite(*asked)
        stamp_ns = self._windows.of(source).monotonic_ns(velocity.stamp_ns, now)
        event = Event(stamp_ns, source, self._priority, Request.VELOCITY, velocity=asked)
        self._offer(event, now.monotonic_ns)
