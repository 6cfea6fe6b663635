# SPDX-License-Identifier: Apache-2.0
"""What systemd does with the units, with a stand-in for each process: rights, order, watchdog, restarts."""

import json
import os
import pwd
import select
import signal
import socket
import subprocess
from pathlib import Path

import pytest

from runtime.cli.fitness.buses import kernel_has_can

UNITS = ("ugv-recorder.service", "ugv-link.service", "ugv-control.service")
SHIPPED = sorted(path.name for path in (Path(__file__).parents[2] / "deploy" / "systemd").iterdir() if path.is_file())
DROP_INS = Path("/run/systemd/system")
STAND_IN = Path("/opt/stand_in.py")
PROBE = Path("/run/ugv/probe.sock")
PATIENCE_S = 60
STOPPED = "9d1aaa27d60140bd96365438aad20286"
"""What systemd's journal entries about a unit that has stopped are marked with."""


def systemctl(*arguments):
    return subprocess.run(["systemctl", *arguments], capture_output=True, text=True, check=True).stdout


def shown(unit, *names):
    """Properties of a unit."""
    lines = systemctl("show", unit, "--property", ",".join(names)).splitlines()
    found = dict(line.split("=", 1) for line in lines)
    return found[names[0]] if len(names) == 1 else [found[name] for name in names]


def journal(*options):
    """Lines of the journal, in order."""
    command = ["journalctl", "--no-pager", "--output=cat", *options]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()


class Probe:
    """Hears of every stand-in that has started."""

    def __init__(self):
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        PROBE.unlink(missing_ok=True)
        self._socket.bind(str(PROBE))
        PROBE.chmod(0o666)
        self._socket.settimeout(PATIENCE_S)

    def next(self):
        return json.loads(self._socket.recv(65536))

    def silent(self):
        return not select.select([self._socket], [], [], 0)[0]

    def close(self):
        self._socket.close()
        PROBE.unlink()


@pytest.fixture
def probe(installed):
    """The units with stand-ins, none of them running yet."""
    STAND_IN.write_bytes((Path(__file__).parent / "stand_in.py").read_bytes())
    account = pwd.getpwnam("ugv")
    PROBE.parent.mkdir(exist_ok=True)
    os.chown(PROBE.parent, account.pw_uid, account.pw_gid)
    for unit in UNITS:
        command = shown(unit, "ExecStart").split("argv[]=")[1].split(" ;")[0].split()[1:]
        drop_in = DROP_INS / f"{unit}.d" / "stand-in.conf"
        drop_in.parent.mkdir(parents=True, exist_ok=True)
        drop_in.write_text(
            f"[Service]\nExecStart=\nExecStart=/opt/ugv/venv/bin/python -I {STAND_IN} {' '.join(command)}\n"
        )
    systemctl("daemon-reload")
    listening = Probe()
    yield listening
    systemctl("stop", "ugv.target")
    listening.close()
    for unit in UNITS:
        (DROP_INS / f"{unit}.d" / "stand-in.conf").unlink()
    systemctl("daemon-reload")
    systemctl("reset-failed")


@pytest.fixture
def running(probe):
    """What each process found that it may do, by process; all three run."""
    return start(probe)


def start(probe):
    systemctl("start", "ugv.target")
    return {facts["process"]: facts for facts in (probe.next() for _ in UNITS)}


def kill(facts, number):
    os.kill(facts["pid"], number)


def test_the_units_have_no_flaws_and_little_exposure(installed):
    services = [unit for unit in SHIPPED if unit.endswith(".service")]
    assert set(services) == set(UNITS)
    verified = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", *SHIPPED], capture_output=True, text=True, check=False
    )
    assert (verified.returncode, verified.stdout, verified.stderr) == (0, "", "")
    for unit in services:
        rated = subprocess.run(
            ["systemd-analyze", "security", "--no-pager", "--threshold=20", unit],
            capture_output=True,
            text=True,
            check=False,
        )
        assert rated.returncode == 0, rated.stdout


def test_each_process_may_do_what_it_needs_and_nothing_else(running):
    user = pwd.getpwnam("ugv").pw_uid
    assert {facts["user"] for facts in running.values()} == {user}
    assert {facts["capabilities"] for facts in running.values()} == {0}
    assert {facts["cores"] for facts in running.values()} == {0}
    has_device = Path("/dev/cpu_dma_latency").exists()
    assert {name: facts["device"] for name, facts in running.items()} == {
        "control": has_device,
        "link": False,
        "recorder": False,
    }
    shared = ["/run/ugv", "/var/cache/ugv"]
    assert {name: facts["writable"] for name, facts in running.items()} == {
        "control": shared,
        "link": shared,
        "recorder": [*shared, "/var/log/ugv"],
    }


def test_each_process_opens_sockets_of_the_families_that_it_needs_and_control_of_can_where_the_kernel_has_it(running):
    families = {
        "control": ["AF_UNIX", "AF_CAN"],
        "link": ["AF_UNIX", "AF_INET", "AF_INET6", "AF_NETLINK"],
        "recorder": ["AF_UNIX"],
    }
    assert {name: facts["let_by"] for name, facts in running.items()} == families
    if not kernel_has_can():
        families["control"].remove("AF_CAN")
    assert {name: facts["opened"] for name, facts in running.items()} == families


def test_the_limits_let_each_run_first_as_far_as_it_needs_and_two_lock_memory(real_time_by_limits, probe):
    facts = start(probe)
    priorities = [20, 40, 60, 80, 90] if real_time_by_limits else [20, 40, 60, 80, 90, 91]
    assert {name: found["fifo"] for name, found in facts.items()} == {
        "control": priorities,
        "link": priorities,
        "recorder": [20] if real_time_by_limits else [],
    }
    assert [facts[name]["memory"] for name in ("control", "link")] == ["", ""]
    for name in ("control", "link"):
        assert shown(f"ugv-{name}.service", "LimitRTPRIO", "LimitMEMLOCK") == ["90", "infinity"]


def test_each_process_is_told_its_robot_and_its_directories(running):
    for name, facts in running.items():
        assert facts["arguments"] == ["run", "uslgo1", "--config", "/etc/ugv/uslgo1.toml", "--process", name]
        assert facts["environment"] == {
            "RUNTIME_DIRECTORY": "/run/ugv",
            "LOGS_DIRECTORY": "/var/log/ugv" if name == "recorder" else None,
            "UGV_CACHE_DIR": "/var/cache/ugv",
        }


def test_control_starts_last_and_stops_first(running):
    started = [int(shown(unit, "ActiveEnterTimestampMonotonic")) for unit in UNITS]
    assert started == sorted(started)
    systemctl("stop", "ugv.target")
    systemctl("stop", *UNITS)
    stopped = [json.loads(line)["UNIT"] for line in journal("--output=json", f"MESSAGE_ID={STOPPED}")]
    assert stopped[-3:] == list(reversed(UNITS))
    assert [shown(unit, "Result") for unit in UNITS] == ["success"] * 3


def test_a_process_that_hangs_is_killed_and_started_again(running, probe):
    kill(running["control"], signal.SIGSTOP)
    again = probe.next()
    assert (again["process"], shown("ugv-control.service", "NRestarts")) == ("control", "1")
    assert again["pid"] != running["control"]["pid"]
    with pytest.raises(ProcessLookupError):
        os.kill(running["control"]["pid"], 0)
    assert any("Watchdog timeout" in line for line in journal("--unit=ugv-control.service"))


@pytest.mark.parametrize("name", ["control", "link", "recorder"])
def test_a_killed_process_comes_back_alone(running, probe, name):
    left = Path("/run/ugv/left-by-the-first")
    left.touch()
    kill(running[name], signal.SIGKILL)
    again = probe.next()
    assert (again["process"], again["pid"] != running[name]["pid"]) == (name, True)
    assert probe.silent()
    for other, facts in running.items():
        if other != name:
            assert shown(f"ugv-{other}.service", "MainPID") == str(facts["pid"])
    assert left.exists()
    left.unlink()


def test_a_process_that_keeps_dying_is_given_up(running, probe):
    facts = running["control"]
    burst = int(shown("ugv-control.service", "StartLimitBurst"))
    for _ in range(burst - 1):
        kill(facts, signal.SIGKILL)
        facts = probe.next()
    gone = os.pidfd_open(facts["pid"])
    kill(facts, signal.SIGKILL)
    assert select.select([gone], [], [], PATIENCE_S)[0]
    os.close(gone)
    follow = ["journalctl", "--follow", "--output=cat", "--unit=ugv-control.service"]
    with subprocess.Popen(follow, stdout=subprocess.PIPE, text=True) as following:
        assert any("Start request repeated too quickly" in line for line in following.stdout)
        following.kill()
    assert shown("ugv-control.service", "ActiveState") == "failed"
    assert shown("ugv-link.service", "MainPID") == str(running["link"]["pid"])


def test_nothing_starts_a_sibling(probe):
    systemctl("start", "ugv-control.service")
    assert probe.next()["process"] == "control"
    assert probe.silent()
    assert [shown(unit, "ActiveState") for unit in UNITS] == ["inactive", "inactive", "active"]
    systemctl("stop", "ugv-control.service")
