# SPDX-License-Identifier: Apache-2.0
"""What may reach the control loops, and what is turned away at the link, told by reason."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from runtime.link.clocks import Instant
from runtime.link.event_outlet import Event
from runtime.link.operator_inputs import RequestUse, VelocityUse
from runtime.link.path_input import PathUse
from runtime.link.rate_gate import RateGate
from runtime.link.senders import SenderBook, number_of
from runtime.link.sensor_inputs import BatteryUse, ImuUse, PoseUse
from runtime.link.tally import Tally
from runtime.link.topic_input import TopicInput, never
from runtime.messages.attachment import Attachment
from runtime.messages.battery import BatteryReport
from runtime.messages.errors import MessageError
from runtime.messages.imu import InertialSample
from runtime.messages.path import Waypoints
from runtime.messages.pose import StampedPose
from runtime.messages.standard import decode_bool
from runtime.messages.twist import Velocity
from runtime.robots.link_config import LinkConfig
from runtime.signals import Battery, Imu, Motion, Path, Pose, Request

NOW = Instant(5_000_000_000, 1_700_000_000_000_000_000)
CONFIG = LinkConfig()
CAPACITY = 5
TURN = (0.0, 0.0, 0.6, 0.8)
TRUE, FALSE = b"\0\1\0\0\1", b"\0\1\0\0\0"


def instants(step_ns: int = 2_000_000):
    for number in range(1000):
        yield Instant(NOW.monotonic_ns + number * step_ns, NOW.unix_ns + number * step_ns)


class Written:
    """Copies of what was handed on."""

    def __init__(self) -> None:
        self.records: list = []

    def __call__(self, record) -> None:
        copy = record.like()
        copy.copy_from(record)
        self.records.append(copy)


@pytest.fixture
def written() -> Written:
    return Written()


def sample(**changes) -> InertialSample:
    usual = InertialSample(NOW.unix_ns - 1_000_000, "imu_link", (0.1, 0.2, 0.3), (0.0, 0.0, 9.81))
    return usual._replace(**changes)


def test_a_sample_is_handed_on_with_the_time_it_was_taken(written):
    use = ImuUse(CONFIG, Imu("/imu"), written)
    use(sample(), 1, NOW)
    assert written.records[0].stamp_ns == NOW.monotonic_ns - 1_000_000
    assert written.records[0].sequence == 1
    assert written.records[0].angular_velocity.tolist() == [0.1, 0.2, 0.3]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"frame": "camera"}, "frame"),
        ({"angular_velocity": (math.nan, 0.0, 0.0)}, "finite"),
        ({"linear_acceleration": (0.0, math.inf, 0.0)}, "finite"),
        ({"stamp_ns": NOW.unix_ns - CONFIG.imu_age_max_ns - 1}, "too old"),
        ({"stamp_ns": NOW.unix_ns + CONFIG.future_max_ns + 1}, "future"),
        ({"stamp_ns": -1}, "too old"),
    ],
)
def test_a_sample_that_cannot_be_used_is_refused(written, changes, reason):
    use = ImuUse(CONFIG, Imu("/imu"), written)
    with pytest.raises(MessageError, match=reason):
        use(sample(**changes), 1, NOW)
    assert not written.records


def test_the_same_sample_twice_is_one_sample(written):
    use = ImuUse(CONFIG, Imu("/imu"), written)
    use(sample(), 1, NOW)
    with pytest.raises(MessageError, match="not newer"):
        use(sample(), 1, Instant(NOW.monotonic_ns + 5, NOW.unix_ns + 5))
    assert len(written.records) == 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"frame": "map"}, "frame"),
        ({"position": (math.nan, 0.0, 0.0)}, "finite"),
        ({"orientation": (0.0, 0.0, 0.0, 0.0)}, "unit"),
        ({"orientation": (0.0, 0.0, 1.0, 1.0)}, "unit"),
    ],
)
def test_a_pose_that_cannot_be_used_is_refused(written, changes, reason):
    use = PoseUse(CONFIG, Pose("/pose"), written)
    pose = StampedPose(0, "odom", (1.0, 2.0, 3.0), TURN)
    with pytest.raises(MessageError, match=reason):
        use(pose._replace(**changes), 1, NOW)
    use(pose._replace(orientation=(0.0, 0.0, 0.603, 0.804)), 1, NOW)
    assert math.hypot(*written.records[0].orientation) == pytest.approx(1.0, abs=1e-15)


def test_a_battery_must_know_its_voltage_alone(written):
    use = BatteryUse(CONFIG, Battery("/battery"), written)
    with pytest.raises(MessageError, match="finite"):
        use(BatteryReport(0, math.nan, 1.0, 0.5), 1, NOW)
    use(BatteryReport(0, 28.0, math.nan, math.nan), 1, NOW)
    assert written.records[0].voltage == 28.0


def path_use(written) -> PathUse:
    return PathUse(CONFIG, Path("/path", {"path": CAPACITY}), written)


FINITE = st.floats(-1e6, 1e6)


@settings(deadline=None)
@given(st.lists(st.tuples(FINITE, FINITE), max_size=CAPACITY + 2), st.booleans())
def test_paths(points, back):
    written = Written()
    if back and points:
        points = [*points, points[0]]
    try:
        path_use(written)(Waypoints(0, "odom", points), 1, NOW)
    except MessageError as error:
        assert str(error) in ("the path has fewer than two points", "the path has too many poses")
        assert not 2 <= len(points) <= CAPACITY
    else:
        path = written.records[0]
        count = path.count
        assert 2 <= count <= CAPACITY or not points, "one without poses takes back the one before"
        assert not path.closed or (len(points) > 2 and math.dist(points[0], points[-1]) < 1e-3)
        assert list(zip(path.x[:count], path.y[:count], strict=True)) == points[:count]
        assert count == len(points) - path.closed
        assert not path.x[count:].any()
        assert path.speed == (CONFIG.path_speed_mps if points else 0)


@pytest.mark.parametrize(
    ("points", "closed"),
    [
        ([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)], True),
        ([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 2e-3)], False),
        ([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (1.0, 0.1), (0.0, 0.0)], False),
        ([(0.0, 0.0), (2.0, 0.5), (2.0, -0.5), (0.0, 0.0)], False),
    ],
    ids=["a square", "one whose ends do not meet", "there and back", "one that turns back where its ends meet"],
)
def test_a_path_is_closed_that_leads_on_from_where_its_ends_meet(written, points, closed):
    path_use(written)(Waypoints(0, "odom", points), 1, NOW)
    (path,) = written.records
    assert (path.closed, path.count) == (closed, len(points) - closed)


def test_what_a_path_asks_for_loads_nothing():
    """Translating code, or loading what does, would hold up the inertial samples for a third of a second."""
    program = """
import sys
from runtime.link.path_input import PathUse
from runtime.link.clocks import Instant
from runtime.messages.path import Waypoints
from runtime.robots.link_config import LinkConfig
from runtime.signals import Path
import runtime.link.process
loaded, got = set(sys.modules), []
use = PathUse(LinkConfig(), Path("/path", {"path": 8}), got.append)
use(Waypoints(0, "odom", [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 0.0)]), 1, Instant(10**9, 10**18))
assert got[0].closed
assert not set(sys.modules) - loaded, set(sys.modules) - loaded
"""
    subprocess.run([sys.executable, "-c", program], check=True)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_path_with_a_number_that_is_none_is_refused(written, bad):
    with pytest.raises(MessageError, match="finite"):
        path_use(written)(Waypoints(0, "odom", [(0.0, 0.0), (1.0, bad)]), 1, NOW)


def test_a_speed_holds_for_the_paths_after_it(written):
    use, points = path_use(written), [(0.0, 0.0), (1.0, 0.0)]
    use.set_speed(0.2, 1, NOW)
    use(Waypoints(0, "odom", points), 1, NOW)
    assert written.records[0].speed == 0.2
    for speed in (0.0, -1.0, CONFIG.path_speed_max_mps + 0.01, math.nan):
        with pytest.raises(MessageError, match=r"bounds|finite"):
            use.set_speed(speed, 1, NOW)


def test_a_speed_holds_for_the_paths_of_its_sender_alone(written):
    use, points = path_use(written), [(0.0, 0.0), (1.0, 0.0)]
    use.set_speed(0.2, 1, NOW)
    use(Waypoints(0, "odom", points), 2, NOW)
    use(Waypoints(0, "odom", points), 1, NOW)
    assert [(path.source, path.speed) for path in written.records] == [(2, CONFIG.path_speed_mps), (1, 0.2)]


def test_paths_of_two_senders_do_not_make_each_other_old(written):
    use = path_use(written)
    for stamp_ns, source, points in (
        (NOW.unix_ns, 1, [(0.0, 0.0), (1.0, 0.0)]),
        (NOW.unix_ns - 3_000_000, 2, [(0.0, 0.0), (2.0, 0.0)]),
        (NOW.unix_ns - 4_000_000, 3, []),
    ):
        use(Waypoints(stamp_ns, "odom", points), source, NOW)
    assert [(path.source, path.count) for path in written.records] == [(1, 2), (2, 2), (3, 0)]


class Offered(list):
    """Requests that were offered."""

    def __call__(self, event: Event, now_ns: int) -> None:
        self.append(event)


def test_what_an_operator_sends_becomes_requests():
    offered = Offered()
    use = RequestUse(offered, 20)
    use.arm(True, 5, NOW)
    use.arm(False, 5, NOW)
    use.motion(" Walk", 5, NOW)
    use.emergency_stop(True, 5, NOW)
    use.emergency_stop(False, 5, NOW)
    use.plain(Request.RESET)(None, 5, NOW)
    requests = [Request.ARM, Request.DISARM, Request.MOTION, Request.EMERGENCY_STOP, Request.RESET]
    assert [event.request for event in offered] == requests, "a button that is not pressed asks for nothing"
    assert offered[2].motion == Motion.WALK
    assert {(event.stamp_ns, event.source, event.priority) for event in offered} == {(NOW.monotonic_ns, 5, 20)}
    with pytest.raises(MessageError, match="none of"):
        use.motion("jump", 5, NOW)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"forward": math.nan}, "finite"),
        ({"yaw_rate": -math.inf}, "finite"),
        ({"frame": "map"}, "frame"),
        ({"stamp_ns": NOW.unix_ns - CONFIG.velocity_age_max_ns - 1}, "too old"),
    ],
)
def test_a_velocity_that_cannot_be_used_is_refused(changes, reason):
    offered = Offered()
    use = VelocityUse(CONFIG, offered, 10)
    with pytest.raises(MessageError, match=reason):
        use(Velocity(0, "", 0.1, 0.2, 0.3)._replace(**changes), 1, NOW)
    use(Velocity(NOW.unix_ns - 7, "base_link", 0.1, 0.2, 0.3), 1, NOW)
    assert [(event.stamp_ns, event.velocity) for event in offered] == [(NOW.monotonic_ns - 7, (0.1, 0.2, 0.3))]


def test_velocities_of_two_senders_do_not_make_each_other_old():
    offered = Offered()
    use = VelocityUse(CONFIG, offered, 10)
    for number, now in zip(range(5), instants(), strict=False):
        use(Velocity(now.unix_ns + CONFIG.future_max_ns - number, "", 0.0, 0.0, 0.0), 1, now)
        use(Velocity(now.unix_ns - 3_000_000, "", 0.1, 0.0, 0.0), 2, now)
    assert [event.source for event in offered] == [1, 2] * 5


class Topic:
    """A topic with flags, and what was used of it."""

    def __init__(self, rate_hz: float | None = None, burst: int = 3, is_stale=never, step_ns: int = 0) -> None:
        self.used: list[tuple[bool, int]] = []
        self.tally = Tally()
        clock = instants(step_ns)
        gate = None if rate_hz is None else lambda: RateGate(rate_hz, burst)
        self.input = TopicInput(
            "/arm", decode_bool, self._use, gate, self.tally, SenderBook(), lambda: next(clock), is_stale
        )

    def _use(self, flag: bool, source: int, now: Instant) -> None:
        self.used.append((flag, source))

    def send(self, sequence: int, gid: int = 1, payload: bytes = TRUE, sent_ns: int = 0) -> None:
        self.input.receive(payload, Attachment(sequence, sent_ns, gid.to_bytes(16, "little")).to_bytes())


def test_what_arrives_is_used_and_counted():
    topic = Topic()
    topic.send(1, gid=7)
    topic.input.receive(TRUE, b"")
    topic.input.receive(TRUE, b"rubbish")
    topic.input.receive(b"", b"")
    assert topic.used == [(True, 7), (True, number_of("/arm")), (True, number_of("/arm"))]
    assert topic.tally.accepted["/arm"] == 3
    reasons = {reason: number for (_, reason), number in topic.tally.rejected.items()}
    assert reasons == {
        "the message ends too early": 1,
        "the attachment has another length than rmw_zenoh's; used as from an unknown sender": 1,
    }


def test_a_message_that_was_too_long_on_its_way_is_counted_and_not_used():
    topic = Topic(is_stale=lambda flag, late_ns: flag and late_ns > 700_000_000)
    for sequence, sent_ns in enumerate((0, 1_000_000_000, 200_000_000, 250_000_000), 1):
        topic.send(sequence, sent_ns=sent_ns)
    assert len(topic.used) == 4, "a clock that was set back makes nothing late"
    topic = Topic(is_stale=lambda flag, late_ns: flag and late_ns > 700_000_000, step_ns=1_000_000_000)
    topic.send(1, sent_ns=0)
    topic.send(2, sent_ns=1)
    topic.send(3, sent_ns=2, payload=FALSE)
    topic.input.receive(TRUE, b"")
    assert [flag for flag, _ in topic.used] == [True, False, True]
    assert topic.tally.rejected == {("/arm", "the message was too long on its way"): 1}


def test_messages_that_never_came_are_counted():
    topic = Topic()
    for sequence in (1, 2, 5, 6, 3, 10**12):
        topic.send(sequence)
    topic.send(40, gid=2)
    assert topic.tally.lost["/arm"] == 2, "a publisher that counts in another way has lost nothing"


def test_a_publisher_that_floods_bounds_itself_alone():
    topic = Topic(rate_hz=1.0)
    for sequence in range(50):
        topic.send(sequence, gid=1)
    topic.send(1, gid=2)
    assert [source for _, source in topic.used] == [1, 1, 1, 2]
    assert topic.tally.rejected["/arm", "more messages than are read"] == 47


def test_a_flood_under_many_names_is_bounded_too():
    topic = Topic(rate_hz=1.0)
    topic.send(1, gid=1)
    for gid in range(2, 200):
        topic.send(1, gid=gid)
    few = len(topic.used)
    assert few < 50
    topic.send(2, gid=1)
    assert topic.used[-1] == (True, 1), "who was there before is heard"


def test_a_fault_of_ours_is_told_as_such_and_the_topic_goes_on(monkeypatch):
    topic = Topic()
    monkeypatch.setattr(topic.input, "_use", lambda *parts: 1 / 0)
    topic.send(1)
    assert topic.tally.rejected["/arm", "a fault of the link: ZeroDivisionError"] == 1


@settings(deadline=None, max_examples=200)
@given(st.binary(max_size=64), st.binary(max_size=40))
def test_any_bytes_are_used_or_counted(payload, attachment):
    tally, used = Tally(), []
    topic = TopicInput("/arm", decode_bool, lambda *parts: used.append(parts), None, tally, SenderBook())
    topic.receive(payload, attachment)
    counted = sum(number for (_, reason), number in tally.rejected.items() if "unknown sender" not in reason)
    assert len(used) + counted == 1
    assert not any("fault of the link" in reason for _, reason in tally.rejected)
