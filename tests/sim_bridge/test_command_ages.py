# SPDX-License-Identifier: Apache-2.0
"""A command that was held up on its way to the drives is seen to be old, whoever held it up."""

import numpy as np
import pytest

from drivers.can_frame import make_frames
from drivers.memory_bus import End, MemoryBus
from drivers.memory_ports import MemoryWriter
from runtime.signals import CanFrames
from sim_bridge.faults.command_ages import CommandAges

MS = 1_000_000


class HeldUp:
    """A port that hands each record on the time after, when another is written."""

    def __init__(self, port):
        self._port, self._kept = port, None

    def write(self, record, now_ns):
        if self._kept is not None:
            self._port.write(self._kept, now_ns)
        self._kept = record.like()
        self._kept.copy_from(record)


@pytest.mark.parametrize(("between", "least_ms", "most_ms"), [(lambda port: port, 0.0, 0.5), (HeldUp, 30.0, 30.5)])
def test_the_age_is_that_at_the_drives(between, least_ms, most_ms):
    bus = MemoryBus(1)
    ages = CommandAges(bus)
    port = ages.noted(between(MemoryWriter(bus)))
    record = CanFrames("/sent", {"frame": 1, "frame_byte": 16})
    for number in range(4):
        now_ns = number * 30 * MS
        record.stamp_ns, record.count = now_ns, 1
        record.data[:] = np.frombuffer(make_frames([number + 1], 8).tobytes(), np.uint8)
        port.write(record, now_ns)
        bus.receive(End.DEVICE, now_ns + MS)
    assert least_ms <= ages.oldest_ns / MS <= most_ms
