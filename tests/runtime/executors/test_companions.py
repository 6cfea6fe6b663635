# SPDX-License-Identifier: Apache-2.0
"""The ticks of other processes stand in the log as those of the robot's own loops do."""

from runtime.executors.companions import SIM, CompanionTicks
from runtime.executors.tick import TICK_TOPIC_PREFIX, entries, manifest_of
from runtime.tasks import Loop

MS = 1_000_000
LOOPS = (Loop("fast", 2 * MS, MS, 80, (), (), (), ()),)


class Sink(list):
    dropped = 3

    def write(self, datagram):
        self.append(datagram)


def test_a_companion_skips_the_periods_that_it_was_late_for_and_says_so():
    sink = Sink()
    ticks = CompanionTicks(LOOPS, SIM, sink, start_ns=100 * MS)
    channel = manifest_of((*LOOPS, SIM)).of_topic(TICK_TOPIC_PREFIX + "sim")
    seen = []
    for late_ns, took_ns in ((10_000, 200_000), (20_000, 34_000_000), (0, 0)):
        began_ns = ticks.release_ns + late_ns
        ticks.done(began_ns, began_ns + took_ns, took_ns // 2)
        ((number, body),) = entries(sink[-1])
        assert number == channel.number
        record = channel.record.like()
        record.load(body)
        seen.append(record)
    assert [tick.index for tick in seen] == [0, 1, 5]
    assert [tick.skipped for tick in seen] == [0, 0, 3]
    assert [tick.release_ns // MS for tick in seen] == [100, 110, 150]
    assert [tick.wake_latency_ns for tick in seen] == [10_000, 20_000, 0]
    assert [tick.compute_ns for tick in seen] == [200_000, 34_000_000, 0]
    assert [tick.cpu_ns for tick in seen] == [100_000, 17_000_000, 0]
    assert [bool(tick.late) for tick in seen] == [False, True, False]
    assert [tick.dropped for tick in seen] == [3, 3, 3]


def test_a_companion_that_steps_more_often_tells_of_one_step_when_that_was():
    sink = Sink()
    ticks = CompanionTicks(LOOPS, SIM, sink, start_ns=100 * MS)
    ticks.log(93 * MS, 96 * MS, 97 * MS, 0, 101 * MS)
    assert (ticks.release_ns, ticks.index) == (110 * MS, 1)
    record = manifest_of((*LOOPS, SIM)).of_topic(TICK_TOPIC_PREFIX + "sim").record.like()
    record.load(next(iter(entries(sink[-1])))[1])
    assert (record.index, record.release_ns, record.now_ns) == (0, 93 * MS, 96 * MS)
    assert (record.wake_latency_ns, record.compute_ns, record.late) == (3 * MS, 1 * MS, 0)


def test_no_companion_runs_between_the_control_loops():
    from runtime.robots import load_configuration

    config = load_configuration("uslgo1")
    lowest = min(config.loops.wbc_priority, config.loops.mpc_priority)
    assert config.realtime.recorder_priority < config.realtime.link_priority < SIM.priority < lowest
