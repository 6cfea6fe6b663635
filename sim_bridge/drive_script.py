# SPDX-License-Identifier: Apache-2.0
"""The operator who steers a simulated vehicle by velocity: lets go where it should come to a stand."""

from __future__ import annotations

import math

from runtime.models.rotations import wrapped
from runtime.records import Record
from runtime.signals import Motion, OperatorEvent, Request
from sim_bridge.scenario import Scenario
from sim_bridge.script import ARM_NS, PERIOD_NS, PRIORITY, SOURCE, STAND_NS, WALK_NS
from sim_bridge.world import World

BEGIN_NS = WALK_NS + PERIOD_NS
ORDERS = (
    (STAND_NS, Request.MOTION, Motion.STAND),
    (ARM_NS, Request.ARM, Motion.STAND),
    (WALK_NS, Request.MOTION, Motion.WALK),
)


class ScriptedDriver:
    """Input port of the operator's events.

    Args:
        scenario: with a velocity.
        world: the true vehicle, which the operator sees.
        lead_s: of the way at full speed that is left when he lets go.
    """

    def __init__(self, scenario: Scenario, world: World, lead_s: float) -> None:
        assert scenario.velocity is not None
        self._scenario, self._velocity, self._world, self._lead_s = scenario, scenario.velocity, world, lead_s
        self._orders = list(ORDERS)
        self._next_ns, self._sequence = 0, 0
        self._yaw, self._turned = scenario.start_pose[2], 0.0
        self._gone = False

    def read(self, record: Record, now_ns: int) -> bool:
        """Give the next event."""
        assert isinstance(record, OperatorEvent)
        gone = self._gone
        self._look()
        if self._gone and not gone:
            self._next_ns = now_ns  # he lets go at once
        record.clear()
        if self._orders and now_ns >= self._orders[0][0]:
            _, record.request, record.motion = self._orders.pop(0)
        elif now_ns >= self._next_ns:
            self._next_ns = now_ns + PERIOD_NS
            record.request = Request.VELOCITY if now_ns >= BEGIN_NS else Request.LIFE
            if now_ns >= BEGIN_NS and not self._gone:
                record.velocity = self._velocity
        else:
            return False
        self._sequence += 1
        record.stamp_ns, record.sequence, record.source, record.priority = now_ns, self._sequence, SOURCE, PRIORITY
        return True

    def _look(self) -> None:
        """See how far the vehicle has come."""
        yaw = self._world.yaw
        self._turned += wrapped(yaw - self._yaw)
        self._yaw = yaw
        scenario, (forward, lateral, yaw_rate) = self._scenario, self._velocity
        if not scenario.waypoints:
            left, speed = scenario.turn_rad - abs(self._turned), abs(yaw_rate)
        else:
            (x0, y0), (x1, y1) = scenario.waypoints[0], scenario.waypoints[-1]
            x, y, _ = self._world.position.tolist()
            length = math.hypot(x1 - x0, y1 - y0)
            left = length - ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length
            speed = math.hypot(forward, lateral)
        self._gone = self._gone or left <= self._lead_s * speed
