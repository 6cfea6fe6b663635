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

from runtime.cli.fitness import buses
from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.executors.tick_stream import OBSERVER_SOCKET, TickListener
from runtime.recording.recorder_status import read_status
from runtime.robots import load_configuration, topics
from runtime.robots.uslgo1.assembly import assemble
from runtime.signals import Mode
from sim_bridge.faults.held_thread import WAIT, WAIT_FOR_THREADS, held, thread_of
from sim_bridge.tick_mirror import TickMirror

RUNTIME, LOGS, CONFIGURATION = Path("/run/ugv"), Path("/var/log/ugv"), Path("/etc/ugv/uslgo1.toml")
PYTHON, UGV = "/opt/ugv/venv/bin/python", "/opt/ugv/venv/bin/ugv"
UNITS = ("ugv-recorder.service", "ugv-link.service", "ugv-control.service")
LOOPS = ("wbc", "mpc")
PATIENCE_S = 120
AFTER_RESTART_S = 3
ATTEMPTS, ATTEMPT_S = 30, 5
TICKS_BESIDE = 10
"""Of the loop that goes on while another is stopped: a fifth of a second of the slow one."""


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
        self._listener = TickListener(RUNTIME / OBSERVER_SOCKET)
        (RUNTIME / OBSERVER_SOCKET).chmod(0o666)
        loops = assemble(load_configuration(str(CONFIGURATION))).loops
        ticks = [TICK_TOPIC_PREFIX + name for name in LOOPS]
        self._mirror = TickMirror(loops, [topics.SAFETY, *ticks], self)
        self._safety, *self._ticks = (self._mirror.records[topic] for topic in (topics.SAFETY, *ticks))
        self._waiting = None
        self.processes = 1

    def tick(self, loop):
        """The last tick of a loop."""
        return self._ticks[LOOPS.index(loop)]

    def receive(self, timeout_s):
        """One datagram at a time, for the mirror."""
        datagram, self._waiting = self._waiting, None
        return datagram

    def modes(self, seconds):
        """The mode of every tick of the next seconds; counts the processes that they come from."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            self._waiting = self._listener.receive(left)
            if self._waiting is not None:
                before = self.tick("wbc").index
                self._mirror.update()
                self.processes += self.tick("wbc").index < before
                yield Mode(self._safety.mode)

    def until(self, happened):
        """The modes until something has happened, which is told the last one."""
        seen = []
        for mode in self.modes(PATIENCE_S):
            seen.append(mode)
            if happened(mode):
                return set(seen)
        raise AssertionError(f"not within {PATIENCE_S} s, only {set(seen)}: {journal()}")

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
def robot(compiled, real_time_by_limits):
    """A simulated robot behind the buses, recorder and link at work; gives the simulator's process and the watch."""
    account = pwd.getpwnam("ugv")
    systemctl("start", "ugv-recorder.service", "ugv-link.service")
    watch = Watch()
    far_end = Path("/opt/far_end.py")
    far_end.write_bytes((Path(__file__).parent / "far_end.py").read_bytes())
    command = ["setpriv", f"--reuid={account.pw_uid}", f"--regid={account.pw_gid}", "--clear-groups"]
    command += ["--inh-caps=+sys_nice", "--ambient-caps=+sys_nice", PYTHON, "-I", far_end, CONFIGURATION, RUNTIME]
    environment = {**os.environ, "UGV_CACHE_DIR": "/var/cache/ugv"}
    simulator = subprocess.Popen(command, stdout=subprocess.PIPE, cwd="/", env=environment, umask=0o027)
    assert simulator.stdout.readline() == b"ready\n"
    yield simulator, watch
    systemctl("stop", "ugv.target", *UNITS)
    systemctl("reset-failed")
    simulator.terminate()
    simulator.wait()
    simulator.stdout.close()
    watch.close()


def examined(*options):
    """Exit code of the doctor, whether the host is fit, and what is found, by name."""
    command = [UGV, "doctor", "uslgo1", "--config", CONFIGURATION, "--json", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    told = json.loads(done.stdout)
    return done.returncode, told["fit"], {one["name"]: one for one in told["findings"]}


def test_the_host_is_fit_with_the_interface_of_sockets(compiled):
    code, fit, found = examined()
    assert [one for one in found.values() if one["verdict"] == "fail"] == []
    assert (code, fit) == (0, True)
    assert found["packages"]["verdict"] == "ok"
    assert (found["machine code"]["verdict"], "/var/cache/ugv" in found["machine code"]["sentence"]) == ("ok", True)
    assert found["log directory"]["verdict"] == found["runtime directory"]["verdict"] == "ok"
    assert "ugv-control.service" in found["locked memory"]["sentence"]


def test_the_host_is_unfit_without_the_channels_of_socketcan(compiled):
    """The container has none, whether its kernel has CAN or not."""
    channels = [f"can{bus}" for bus in range(4)]
    code, fit, found = examined(
        "--set", "drives.interface=socketcan", "--set", f"drives.channels={json.dumps(channels)}"
    )
    assert (code, fit) == (2, False)
    failed = {name for name, one in found.items() if one["verdict"] == "fail"}
    assert failed - {"kernel CAN"} == {f"CAN {channel}" for channel in channels}
    assert (found["kernel CAN"]["verdict"] == "fail") is not buses.kernel_has_can()


def stand_up(robot):
    """Have the robot stand, and give the modes until then; if this machine stalls and damps it, it is reset."""
    simulator, watch = robot
    seen = set()
    for _ in range(ATTEMPTS):
        for mode in watch.modes(ATTEMPT_S):
            seen.add(mode)
            if mode == Mode.STANDING:
                return seen
        if Mode.DAMPED in seen:
            simulator.send_signal(signal.SIGUSR2)
    raise AssertionError(f"it did not stand, only {seen}: {journal()}")


def test_a_killed_control_comes_back_in_standby_though_the_robot_stood(robot):
    simulator, watch = robot
    systemctl("start", "ugv.target")
    systemctl("start", "ugv-control.service")
    assert Mode.STANDBY in stand_up(robot)
    killed = main_pid("ugv-control.service")
    simulator.send_signal(signal.SIGUSR1)
    os.kill(killed, signal.SIGKILL)
    watch.until(lambda mode: watch.processes == 2)
    seen = watch.until(lambda mode: mode == Mode.STANDBY) | set(watch.modes(AFTER_RESTART_S))
    assert not seen & {Mode.STANDING, Mode.ACTIVE}, seen
    assert main_pid("ugv-control.service") not in (0, killed)
    assert systemctl("show", "ugv-control.service", "--property=NRestarts", "--value").strip() == "1"


def test_every_thread_of_control_but_the_main_one_is_a_loop_that_runs_first(robot):
    _, watch = robot
    systemctl("start", "ugv-control.service")
    control, begun = main_pid("ugv-control.service"), watch.tick("mpc").index
    watch.until(lambda mode: watch.tick("mpc").index > begun + TICKS_BESIDE)
    threads = [int(task.name) for task in Path(f"/proc/{control}/task").iterdir()]
    schedules = {
        thread: (os.sched_getscheduler(thread), os.sched_getparam(thread).sched_priority) for thread in threads
    }
    assert schedules.pop(control) == (os.SCHED_OTHER, 0)
    assert sorted(schedules.values()) == [(os.SCHED_FIFO, 60), (os.SCHED_FIFO, 80)]


@pytest.mark.parametrize(("loop", "other"), [LOOPS, LOOPS[::-1]])
def test_control_is_killed_and_comes_back_in_standby_if_only_one_of_its_loops_stops(loop, other, robot):
    simulator, watch = robot
    systemctl("start", "ugv.target")
    systemctl("start", "ugv-control.service")
    stand_up(robot)
    simulator.send_signal(signal.SIGUSR1)
    killed = main_pid("ugv-control.service")
    thread = thread_of(killed, getattr(load_configuration(str(CONFIGURATION)).loops, f"{loop}_priority"))
    with held(thread):
        stopped_ns = time.monotonic_ns()
        watch.until(lambda mode: watch.tick(other).now_ns > stopped_ns)
        last, beside = watch.tick(loop).index, watch.tick(other).index + TICKS_BESIDE
        watch.until(lambda mode: watch.tick(other).index >= beside)
        assert (watch.processes, watch.tick(loop).index) == (1, last)
        _, ended = os.waitpid(thread, WAIT_FOR_THREADS)
    assert os.WTERMSIG(ended) == signal.SIGABRT, "which is what the watchdog sends"
    watch.until(lambda mode: watch.processes == 2)
    seen = watch.until(lambda mode: mode == Mode.STANDBY) | set(watch.modes(AFTER_RESTART_S))
    assert not seen & {Mode.STANDING, Mode.ACTIVE}, seen
    assert main_pid("ugv-control.service") not in (0, killed)
    assert any("Watchdog timeout" in line for line in journal())


def started_again(unit, before):
    """Wait until a unit has another main process than before."""
    deadline = time.monotonic() + PATIENCE_S
    while main_pid(unit) in (0, before):
        assert time.monotonic() < deadline, journal()
    assert int(systemctl("show", unit, "--property=NRestarts", "--value")) == 1


def test_a_link_whose_loop_stops_is_killed_and_comes_back_and_the_robot_can_be_had_to_stand_again(robot):
    _, watch = robot
    systemctl("start", "ugv.target")
    systemctl("start", "ugv-control.service")
    stand_up(robot)
    link, control = main_pid("ugv-link.service"), main_pid("ugv-control.service")
    with held(link):  # the loop is its main thread; those of zenoh go on
        _, ended = os.waitpid(link, WAIT_FOR_THREADS)
    assert os.WTERMSIG(ended) == signal.SIGABRT, "which is what the watchdog sends"
    watch.until(lambda mode: mode == Mode.DAMPED)
    started_again("ugv-link.service", link)
    stand_up(robot)
    assert (main_pid("ugv-control.service"), watch.processes) == (control, 1)
    assert any("Watchdog timeout" in line for line in journal())


def test_a_recorder_whose_writer_is_stuck_is_killed_and_comes_back_and_the_robot_goes_on(robot):
    _, watch = robot
    systemctl("start", "ugv.target")
    systemctl("start", "ugv-control.service")
    stand_up(robot)
    recorder, control = main_pid("ugv-recorder.service"), main_pid("ugv-control.service")
    writer = sorted(int(task.name) for task in Path(f"/proc/{recorder}/task").iterdir())[1]
    bags = set(LOGS.iterdir())
    with held(writer, WAIT):
        stuck = read_status(RUNTIME)
        watch.until(lambda mode: read_status(RUNTIME).backlog_bytes > stuck.backlog_bytes)
        assert main_pid("ugv-recorder.service") == recorder
        _, ended = os.waitpid(writer, WAIT_FOR_THREADS)
    assert os.WTERMSIG(ended) == signal.SIGABRT, "which is what the watchdog sends"
    started_again("ugv-recorder.service", recorder)
    watch.until(lambda mode: set(LOGS.iterdir()) > bags)
    assert (main_pid("ugv-control.service"), watch.processes) == (control, 1)
    assert any("Watchdog timeout" in line for line in journal())


def test_the_run_is_recorded_where_the_unit_says(robot):
    systemctl("start", "ugv.target")
    systemctl("start", "ugv-control.service")
    stand_up(robot)
    systemctl("stop", *UNITS)
    newest = max((path for path in LOGS.iterdir() if path.is_dir()), key=lambda path: path.stat().st_mtime)
    done = subprocess.run([UGV, "log", "info", newest], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert newest.owner() == "ugv"
