# SPDX-License-Identifier: Apache-2.0
"""The process of control on CAN interfaces of the kernel, with its drives in the test.

Its loops are slow and have no priority, so that a guest, which has one slow processor, gets to everything else as well.
"""

import dataclasses
import json
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from drivers.bus_health import BusState
from drivers.device_end import open_device_end
from drivers.dialects import dialect_named
from drivers.memory_bus import End
from drivers.opening import SOCKETCAN
from runtime.executors.tick_stream import OBSERVER_SOCKET, TickListener
from runtime.robots import assembled, load_configuration, topics
from sim_bridge.quadruped_world import drive_model
from sim_bridge.tick_mirror import TickMirror
from sim_bridge.virtual_drive import VirtualDrives

CONFIG = load_configuration("uslgo1")
BUSES = [f"vcan{bus}" for bus in range(CONFIG.drives.buses)]
SLOW = {"loops.wbc_hz": "100", "loops.mpc_hz": "10", "loops.tracker_hz": "5", "drives.channels": json.dumps(BUSES)}
ANGLES = CONFIG.quadruped.standing_angles(0.29)
JOINTS = CONFIG.drives.joints(CONFIG.safety)
QUIET = dataclasses.replace(drive_model(CONFIG.simulation), velocity_noise=0.0)
ROOT = Path(__file__).parents[2]
AT_NORMAL_PRIORITY = ("setpriv", "--inh-caps=-sys_nice", "--bounding-set=-sys_nice")
BROKEN, BEGINS_WITHIN_S = 1, 300.0


class FarEnd:
    """Drives that hold still, and the last tick of control that they have heard of."""

    def __init__(self, directory):
        self._wires = open_device_end(SOCKETCAN, BUSES)
        self.drives = VirtualDrives(JOINTS, dialect_named(CONFIG.drives.dialect), QUIET, 0)
        self.drives.torque(ANGLES, np.zeros(len(JOINTS)), time.monotonic_ns())
        self._ticks = TickListener(directory / OBSERVER_SOCKET)
        told = [topics.JOINT_STATE, topics.BUS_STATUS]
        self._mirror = TickMirror(assembled(load_configuration("uslgo1", SLOW)).loops, told, self._ticks)
        self.joints, self.buses = (self._mirror.records[topic] for topic in told)

    def first_tick(self):
        """Whether control has begun."""
        return self._ticks.receive(BEGINS_WITHIN_S) is not None

    def exchange(self):
        """Answer the frames that have come, and take up the ticks that have."""
        arrived = self._wires.receive(End.DEVICE, time.monotonic_ns())
        if len(arrived.bus):
            frames, bus, at_ns = self.drives.answer(*arrived)
            self._wires.send(End.DEVICE, bus, frames, at_ns)
        self._mirror.update()

    def close(self):
        self._ticks.close()
        self._wires.close()


@pytest.fixture
def far_end(links, tmp_path):
    """The far end of four interfaces, the second of which is `far_end.broken`."""
    made = links(len(BUSES))
    with closing(FarEnd(tmp_path)) as far:
        far.broken = made[BROKEN]
        yield far


@pytest.fixture
def control(far_end, tmp_path):
    """The process, once its loops begin."""
    command = [*AT_NORMAL_PRIORITY, sys.executable, "-m", "runtime.cli.main", "run", "uslgo1", "--process", "control"]
    command += ["--runtime-dir", str(tmp_path)]
    command += [part for key, value in SLOW.items() for part in ("--set", f"{key}={value}")]
    with subprocess.Popen(command, cwd=ROOT) as process:
        try:
            assert far_end.first_tick()
            yield process
        finally:
            process.kill()


def test_control_reads_what_its_drives_answer_and_says_which_bus_is_down_until_it_is_told_to_stop(
    control, far_end, until
):
    def hears(state):
        far_end.exchange()
        assert control.poll() is None
        near = np.allclose(far_end.joints.position, ANGLES, atol=5e-4)
        return near and far_end.buses.state[BROKEN] == state

    until(lambda: hears(BusState.UP), "every joint's position")
    far_end.broken.down()
    until(lambda: hears(BusState.DOWN), "the bus that is down")
    far_end.broken.up()
    until(lambda: hears(BusState.UP), "the bus that is back")
    assert not far_end.joints.rejected
    assert not far_end.drives.rejections.any()
    control.send_signal(signal.SIGTERM)
    assert control.wait() == 0
    far_end.exchange()
    assert not far_end.drives.driven, "control moves nothing by itself"
