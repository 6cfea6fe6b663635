# SPDX-License-Identifier: Apache-2.0
"""Whose path is followed: the lease holder's, or anyone's while nobody holds it."""

from __future__ import annotations

import pytest

from runtime.signals import OperatorRequest, Path
from runtime.tracking.followed_path import FollowedPath, FollowedPathMemory
from runtime.tracking.polyline import Polyline

SIZES = {"path": 8}
ANN, BEN = 11, 22
AGE_MAX_NS = 1000


class Rig:
    """A path that is followed, and who asks for it."""

    def __init__(self) -> None:
        self.path, self.request = Path("/path", SIZES), OperatorRequest("/request")
        self.now_ns = 1
        self.memory = FollowedPathMemory("/memory", SIZES)
        self.followed = FollowedPath(self.memory, Polyline, AGE_MAX_NS)

    def hold(self, holder: int | None) -> None:
        self.request.held, self.request.holder = holder is not None, holder or 0

    def send(self, source: int, goal_m: float | None, speed: float = 0.5) -> bool:
        """A straight path to a goal, or a withdrawal."""
        path = self.path
        self.now_ns += 1
        path.stamp_ns, path.source, path.speed = self.now_ns, source, speed
        path.count = 0 if goal_m is None else 2
        path.x[1] = goal_m or 0.0
        return self.take()

    def take(self) -> bool:
        return self.followed.take(self.path, self.request, self.now_ns)

    @property
    def goal_m(self) -> float | None:
        return None if self.followed.line is None else self.followed.line.length

    @property
    def refused(self) -> tuple[int, int]:
        return self.memory.rejected_paths, self.memory.foreign_paths


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_anyone_s_path_is_followed_while_nobody_holds_the_lease(rig):
    assert rig.send(ANN, 3.0)
    assert rig.send(BEN, 4.0)
    assert (rig.goal_m, rig.refused) == (4.0, (0, 0))


@pytest.mark.parametrize("goal_m", [4.0, None], ids=["another path", "a withdrawal"])
def test_under_a_lease_what_others_send_is_counted_and_changes_nothing(rig, goal_m):
    rig.hold(ANN)
    rig.send(ANN, 3.0)
    assert not rig.send(BEN, goal_m)
    assert (rig.goal_m, rig.refused) == (3.0, (1, 1))
    assert not rig.take()
    assert rig.refused == (1, 1), "it is counted once"


def test_another_s_speed_along_the_same_path_is_refused_too(rig):
    rig.hold(ANN)
    rig.send(ANN, 3.0, speed=0.5)
    rig.send(BEN, 3.0, speed=1.5)
    assert rig.memory.path_speed == 0.5


def test_what_was_refused_is_not_followed_when_its_sender_takes_the_lease_but_when_it_is_sent_anew(rig):
    rig.hold(ANN)
    rig.send(BEN, 4.0)
    for holder in (None, BEN):
        rig.hold(holder)
        assert not rig.take()
    assert rig.send(BEN, 4.0)
    assert rig.goal_m == 4.0


def test_a_path_that_was_never_sent_is_nobody_s(rig):
    rig.hold(ANN)
    rig.take()
    assert rig.refused == (0, 0)


def test_a_holder_s_path_that_cannot_be_followed_is_not_told_as_another_s(rig):
    rig.hold(ANN)
    rig.send(ANN, 3.0, speed=-1.0)
    assert rig.refused == (1, 0)


@pytest.mark.parametrize(("age_ns", "refused"), [(AGE_MAX_NS, 0), (AGE_MAX_NS + 1, 1)])
def test_a_path_of_long_ago_is_counted_and_not_followed(rig, age_ns, refused):
    """As it waits for a control that is started again."""
    rig.path.stamp_ns, rig.path.source, rig.path.speed, rig.path.count = 7, ANN, 0.5, 2
    rig.path.x[1], rig.now_ns = 3.0, 7 + age_ns
    assert rig.take() == (not refused)
    rig.now_ns += AGE_MAX_NS
    rig.take()
    assert (rig.goal_m, rig.refused) == (None if refused else 3.0, (refused, 0))
