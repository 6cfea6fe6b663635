# SPDX-License-Identifier: Apache-2.0
"""The log of a robot that walks in real time, made up, for what judges such logs."""

import numpy as np

from runtime.executors.tick import TICK_TOPIC_PREFIX, tick_record
from runtime.recording.log import Signal
from runtime.robots import load_configuration, topics
from runtime.robots.uslgo1.assembly import assemble
from runtime.signals import Fault, Mode
from sim_bridge.faults.live_logs import FAST, LiveLogs
from sim_bridge.faults.live_session import Episode, Frames
from sim_bridge.faults.live_table import LIVE_ROWS

MS = 1_000_000
CONFIG = load_configuration("uslgo1")
LOOPS = assemble(CONFIG).loops
PERIOD_NS = CONFIG.loops.wbc_period_ns
AT_NS = 1000 * PERIOD_NS
NO_FRAMES = Frames(np.zeros(0, np.int64), np.zeros(0, np.uint8), np.zeros((0, 16), np.uint8))


class Story(LiveLogs):
    """A log that is made up: a robot that walks at first, tick by tick."""

    def __init__(self, ticks=2000):
        records = {record.topic: record for loop in LOOPS for record in (*loop.writes, *loop.port_inputs)}
        records[TICK_TOPIC_PREFIX + FAST] = tick_record(LOOPS[0])
        wanted = (topics.SAFETY, topics.GAIT, topics.JOINT_COMMAND_SAFE, topics.CAN_SENT, TICK_TOPIC_PREFIX + FAST)
        self.bags, self.stalls = [], []
        times = np.arange(ticks) * PERIOD_NS
        self._signals = {}
        for topic in wanted:
            values = np.zeros(ticks, records[topic].dtype)
            if "stamp_ns" in values.dtype.names:
                values["stamp_ns"] = times
            self._signals[topic] = Signal(times, values)
        self.tick = self._signals[TICK_TOPIC_PREFIX + FAST].values
        self.tick["index"], self.tick["now_ns"] = np.arange(ticks), times
        self.status, self.gait = self._signals[topics.SAFETY].values, self._signals[topics.GAIT].values
        self.command = self._signals[topics.JOINT_COMMAND_SAFE].values
        self.status["mode"], self.gait["walking"] = Mode.ACTIVE, True
        self.command["stiffness"] = 30.0
        self.status["mode"][:1], self.command["stiffness"][:1] = Mode.STANDBY, 0.0

    def becomes(self, after_ns, mode):
        first = (AT_NS + after_ns) // PERIOD_NS
        self.status["mode"][first:] = mode
        self.command["stiffness"][first:] = 0.0 if mode == Mode.DAMPED else 30.0

    def loses(self, first, last):
        """Take ticks out of the log."""
        for topic, signal in self._signals.items():
            self._signals[topic] = Signal(*(np.delete(part, np.s_[first:last]) for part in signal))


def row_of(name):
    return next(row for row in LIVE_ROWS if row.name == name)


def episode_of(name, released_ms=None, joints_kept=True, fell=False):
    released_ns = None if released_ms is None else AT_NS + released_ms * MS
    until_ns = AT_NS + 900 * MS
    return Episode(row_of(name), AT_NS, until_ns, until_ns, released_ns, joints_kept, fell, NO_FRAMES, None)


def damped(after_ms, fault=Fault.EMERGENCY_STOP):
    story = Story()
    story.becomes(after_ms * MS, Mode.DAMPED)
    story.status["fault"][(AT_NS + after_ms * MS) // PERIOD_NS :] = fault
    return story
