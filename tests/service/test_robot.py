# SPDX-License-Identifier: Apache-2.0
"""The robot's own processes under their units, with a simulated robot at the far end of the buses."""

import json
import os
import pwd
import signal
import subprocess
import time
from pathlib import Path

import pytest

from runtime.executors.control import OBSERVER
from runtime.executors.tick_stream import TickListener
from runtime.robots import load_configuration, topics
from runtime.robots.uslgo1.assembly import assemble
from runtime.signals import Mode
from sim_bridge.tick_mirror import TickMirror

RUNTIME, LOGS, CONFIGURATION = Path("/run/ugv"), Path("/var/log/ugv"), Path("/etc/ugv/uslgo1.toml")
PYTHON, UGV = "/opt/ugv/venv/bin/python", "/opt/ugv/venv/bin/ugv"
UNITS = ("ugv-recorder.service", "ugv-control.service")
PATIENCE_S = 120
AFTER_RESTART_S = 3


def systemctl(*arguments):
    done = subprocess.run(["systemctl", *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr + "\n".join(journal())
    return done.stdout


def journal():
    command = ["journalctl", "--no-pager", "--output=cat", "--lines=40", "--unit=ugv-*"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()


def main_pid(unit):
    return int(systemctl("show", unit, "--property=MainPID", "--value"))


class Watch:
    """Follows the modes that control goes through, from its ticks."""

    def __init__(self):
        self._listener = TickListener(RUNTIME / OBSERVER)
        (RUNTIME / OBSERVER).chmod(0o666)
        self._mirror = TickMirror(assemble(load_configuration(str(CONFIGURATION))).loops, [topics.SAFETY], self)
        self._safety = self._mirror.records[topics.SAFETY]
        self._waiting = None

    def receive(self, timeout_s):
        """One datagram at a time, for the mirror."""
        datagram, self._waiting = self._waiting, None
        return datagram

    def modes(self, seconds):
        """The mode of every tick of the next seconds."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            self._waiting = self._listener.receive(left)
            if self._waiting is not None:
                self._mirror.update()
                yield Mode(self._safety.mode)

    def until(self, wanted):
        seen = set()
        for mode in self.modes(PATIENCE_S):
            seen.add(mode)
            if mode == wanted:
                return seen
        raise AssertionError(f"not {wanted!r} within {PATIENCE_S} s, but {seen}: {journal()}")

    def close(self):
        self._listener.close()


@pytest.fixture(scope="module")
def compiled(installed, install):
    """The loops compiled by the installer, and buses that need no hardware."""
    install()
    channels = json.dumps([str(RUNTIME / f"can{bus}") for bus in range(4)])
    lines = CONFIGURATION.read_text().splitlines()
    changed = {"interface = ": 'interface = "ugv-unix"', "channels = ": f"channels = {channels}"}
    CONFIGURATION.write_text(
        "\n".join(next((new for old, new in changed.items() if line.startswith(old)), line) for line in lines)
    )


@pytest.fixture
def robot(compiled):
    """A simulated robot behind the buses, and the units that run it; gives the simulator's process and the watch."""
    account = pwd.getpwnam("ugv")
    systemctl("start", "ugv-recorder.service")
    watch = Watch()
    far_end = Path("/opt/far_end.py")
    far_end.write_bytes((Path(__file__).parent / "far_end.py").read_bytes())
    command = [PYTHON, "-I", far_end, str(CONFIGURATION), str(RUNTIME)]
    environment = {**os.environ, "UGV_CACHE_DIR": "/var/cache/ugv"}
    simulator = subprocess.Popen(
        command,
        user=account.pw_uid,
        group=account.pw_gid,
        extra_groups=(),
        stdout=subprocess.PIPE,
        cwd="/",
        env=environment,
        umask=0o027,
    )
    assert simulator.stdout.readline() == b"ready\n"
    yield simulator, watch
    systemctl("stop", *UNITS)
    simulator.terminate()
    simulator.wait()
    simulator.stdout.close()
    watch.close()


def test_the_host_is_found_unfit_without_can_and_fit_otherwise(compiled):
    done = subprocess.run(
        [UGV, "doctor", "uslgo1", "--config", CONFIGURATION, "--json"], capture_output=True, text=True, check=False
    )
    found = {one["name"]: one for one in json.loads(done.stdout)["findings"]}
    assert found["packages"]["verdict"] == "ok"
    assert (found["machine code"]["verdict"], "/var/cache/ugv" in found["machine code"]["sentence"]) == ("ok", True)
    assert found["log directory"]["verdict"] == found["runtime directory"]["verdict"] == "ok"
    assert "ugv-control.service" in found["locked memory"]["sentence"]


def test_a_killed_control_comes_back_in_standby_though_the_robot_stood(robot):
    simulator, watch = robot
    systemctl("start", "ugv-control.service")
    assert {Mode.STANDBY, Mode.STANDING} <= watch.until(Mode.STANDING)
    killed = main_pid("ugv-control.service")
    simulator.send_signal(signal.SIGUSR1)
    os.kill(killed, signal.SIGKILL)
    seen = watch.until(Mode.STANDBY)
    seen |= set(watch.modes(AFTER_RESTART_S))
    assert seen <= {Mode.OFF, Mode.STANDBY}
    assert main_pid("ugv-control.service") not in (0, killed)
    assert systemctl("show", "ugv-control.service", "--property=NRestarts", "--value").strip() == "1"


def test_the_run_is_recorded_where_the_unit_says(robot):
    _, watch = robot
    systemctl("start", "ugv-control.service")
    watch.until(Mode.STANDING)
    systemctl("stop", *UNITS)
    newest = max((path for path in LOGS.iterdir() if path.is_dir()), key=lambda path: path.stat().st_mtime)
    done = subprocess.run([UGV, "log", "info", newest], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert newest.owner() == "ugv"
