# SPDX-License-Identifier: Apache-2.0
"""The control process: however it ends, what the drives hear last is damping."""

from pathlib import Path

import numpy as np
import pytest

from drivers import bus_socket
from drivers.can_frame import CAN_FRAME, FRAME_SIZE
from drivers.dialects import dialect_named
from drivers.joint_group import JointGroup
from drivers.unix_hub import UnixHub
from runtime.executors.control import control
from runtime.robots import load_configuration
from runtime.robots.uslgo1.assembly import assemble

CONFIG = load_configuration("uslgo1")
JOINTS = CONFIG.drives.joints(CONFIG.safety)
DIALECT = dialect_named(CONFIG.drives.dialect)
DAMPING = JointGroup(JOINTS, DIALECT, CONFIG.drives.command_age_max_ns).encode_damping().copy()


@pytest.fixture
def hubs(tmp_path):
    made = [UnixHub(Path(tmp_path / f"can{bus}")) for bus in range(CONFIG.drives.buses)]
    yield made
    for hub in made:
        hub.close()


@pytest.fixture
def roomy_buses(monkeypatch):
    """Nobody reads the buses while the loops run: room for every frame of a quarter of a second."""
    monkeypatch.setattr(bus_socket, "SEND_BUFFER_BYTES", 1 << 18)


def fail_at_once(now_ns):
    raise ZeroDivisionError("a task that fails")


def last_frames(hubs):
    """The last frame to each drive, in the order of the joints."""
    last = {}
    for bus, hub in enumerate(hubs):
        raw = b"".join(iter(hub.receive, b""))
        for begin in range(0, len(raw), FRAME_SIZE):
            frame = np.frombuffer(raw[begin : begin + FRAME_SIZE], CAN_FRAME)
            last[bus, int(frame["can_id"][0])] = frame
    return np.concatenate([last[joint.bus, DIALECT.command_id(joint.drive_id)] for joint in JOINTS])


@pytest.mark.usefixtures("roomy_buses")
@pytest.mark.parametrize("loop", ["wbc", "mpc"])
def test_a_task_that_fails_leaves_the_drives_damped(loop, hubs, tmp_path, monkeypatch):
    robot = assemble(CONFIG)
    (failing,) = [each for each in robot.loops if each.name == loop]
    monkeypatch.setattr(failing.schedule[0].task, "step", fail_at_once)
    channels = [str(hub.path) for hub in hubs]
    with pytest.raises(ZeroDivisionError, match="a task that fails"):
        control(robot, "ugv-unix", channels, tmp_path, CONFIG.drives.command_age_max_ns)
    assert last_frames(hubs).tobytes() == DAMPING.tobytes()
