# SPDX-License-Identifier: Apache-2.0
"""A stop watch changes nothing of a task."""

from runtime.cli.timed_task import timed
from runtime.records import Record, int64
from runtime.tasks import Loop, Scheduled, Task


class Sum(Record):
    """A running sum."""

    value = int64()


class Adder(Task):
    """Adds up the times of its steps."""

    name = "adder"

    def __init__(self) -> None:
        self.state: Sum = Sum("/ugv/state/adder")
        self.output = Sum("/sum")
        self.writes = (self.output,)

    def step(self, now_ns: int) -> None:
        self.state.value += now_ns
        self.output.value = self.state.value


def test_a_timed_task_does_what_the_task_does_and_keeps_the_time_of_each_step() -> None:
    adder = Adder()
    loop = Loop("slow", 20, 10, 1, (), (), (Scheduled(adder, 2),), (adder.output,))
    (wrapped,), tasks = timed([loop])
    (item,) = wrapped.schedule
    item.task.step(5)
    saved = item.task.save()
    item.task.step(7)
    assert adder.output.value == 12
    item.task.restore(saved)
    assert adder.state.value == 5
    assert (item.every, item.task.name, wrapped.writes, wrapped.period_ns) == (2, "adder", (adder.output,), 20)
    assert [now_ns for now_ns, _ in tasks["adder"].steps] == [5, 7]
    assert all(taken > 0 for _, taken in tasks["adder"].steps)
