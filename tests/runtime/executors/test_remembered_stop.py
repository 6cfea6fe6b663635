# SPDX-License-Identifier: Apache-2.0
"""Whatever becomes of control, a robot that was stopped stays stopped until it is reset."""

from types import SimpleNamespace

import pytest

from runtime.executors.remembered_stop import RememberedStop
from runtime.link.event_outlet import Event
from runtime.link.inputs import Inputs, records_of
from runtime.robots import assembled, load_configuration, topics
from runtime.signals import OperatorEvent, OperatorRequest, Request

TICK_NS = 2_000_000
TICK_HZ = 500
CONFIG = load_configuration("uslgo1")
RECORDS = records_of(assembled(CONFIG).loops)


class Control:
    """The part of a control process that takes up the operator's events, tick by tick."""

    def __init__(self, directory, now_ns):
        self.request, self.now_ns, self.taken, self.said = OperatorRequest("/ugv/operator"), now_ns, [], []
        self._event = OperatorEvent(topics.OPERATOR_EVENT)
        self._port = RememberedStop(directory, [SimpleNamespace(writes=(self.request,))], self.said.append)

    def run(self, ticks=8):
        for _ in range(ticks):
            if self._port.read(self._event, self.now_ns):
                self.taken.append(Request(self._event.request))
                self.request.emergency_stop |= self._event.request == Request.EMERGENCY_STOP
                self.request.emergency_stop &= self._event.request != Request.RESET
            self.now_ns += TICK_NS
        return self


class Operator:
    """What he asks for comes through a link, in time for its bounded rate."""

    def __init__(self, directory):
        self._inputs, self._at_ns = Inputs(CONFIG.link, RECORDS, directory, TICK_HZ), 0

    def says(self, *requests, now_ns):
        for request in requests:
            self._at_ns += 4 * TICK_NS
            self._inputs.outlet.offer(Event(now_ns, 1, 20, request), self._at_ns)

    def close(self):
        self._inputs.close()


@pytest.fixture
def operator(tmp_path):
    made = Operator(tmp_path)
    yield made
    made.close()


def test_a_stop_is_given_to_each_control_that_is_started_until_it_is_reset(tmp_path, operator):
    first = Control(tmp_path, 0).run()
    operator.says(Request.EMERGENCY_STOP, now_ns=first.now_ns)
    assert first.run().request.emergency_stop
    operator.says(*[Request.LIFE] * 100, now_ns=first.now_ns)
    assert first.run(100).request.emergency_stop
    second = Control(tmp_path, first.now_ns).run()
    assert second.taken == [Request.EMERGENCY_STOP]
    third = Control(tmp_path, second.now_ns).run()
    assert third.taken == [Request.EMERGENCY_STOP]
    operator.says(Request.RESET, now_ns=third.now_ns)
    assert not third.run().request.emergency_stop
    assert Control(tmp_path, third.now_ns).run().taken == []


def test_a_stop_that_came_while_control_was_away_is_given_to_the_next(tmp_path, operator):
    first = Control(tmp_path, 0).run()
    operator.says(Request.EMERGENCY_STOP, Request.LIFE, Request.ARM, now_ns=first.now_ns + 1)
    assert Control(tmp_path, first.now_ns + 2).run().taken == [Request.EMERGENCY_STOP]


def test_a_stop_that_came_while_control_was_away_outlives_what_else_is_said_meanwhile(tmp_path, operator):
    first = Control(tmp_path, 0).run()
    operator.says(Request.EMERGENCY_STOP, *[Request.LIFE, Request.VELOCITY] * 300, now_ns=first.now_ns + 1)
    assert Control(tmp_path, first.now_ns + 10**9).run().taken == [Request.EMERGENCY_STOP]


def test_a_stop_that_was_reset_is_over(tmp_path, operator):
    first = Control(tmp_path, 0).run()
    operator.says(Request.EMERGENCY_STOP, Request.RESET, Request.LIFE, now_ns=first.now_ns)
    first.run()
    assert Control(tmp_path, first.now_ns).run().taken == []


def test_other_events_of_the_time_before_are_not_given_again(tmp_path, operator):
    operator.says(Request.ARM, Request.MOTION, now_ns=0)
    control = Control(tmp_path, 1).run()
    assert control.taken == []
    operator.says(Request.LIFE, now_ns=control.now_ns)
    assert control.run().taken == [Request.LIFE]


def test_a_stop_that_cannot_be_kept_is_told(tmp_path):
    directory = tmp_path / "run"
    directory.mkdir()
    operator, control = Operator(directory), Control(directory, 0).run()
    operator.says(Request.EMERGENCY_STOP, now_ns=control.now_ns)
    directory.rename(tmp_path / "away")
    control.run()
    operator.close()
    assert control.taken == [Request.EMERGENCY_STOP]
    (sentence,) = control.said
    assert sentence.startswith("the emergency stop cannot be kept")
