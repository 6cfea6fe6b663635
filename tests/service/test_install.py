# SPDX-License-Identifier: Apache-2.0
"""A whole installation: the second time changes nothing, and the network files are understood by systemd."""

import hashlib
import subprocess
import time
from pathlib import Path

import pytest

INSTALLER = Path(__file__).parents[2] / "deploy" / "install.sh"
TOUCHED = ("/opt/ugv", "/etc")
PATIENCE_S = 60


def tree():
    """Content and time of change of every file that installing could touch."""
    files = (path for root in TOUCHED for path in Path(root).rglob("*") if path.is_file() and not path.is_symlink())
    return {path: (path.stat().st_mtime_ns, hashlib.sha256(path.read_bytes()).digest()) for path in files}


def test_the_second_time_changes_nothing(installed, install):
    once = tree()
    told = install("--no-warm-up")
    changed = {path for path, state in tree().items() if once.get(path) != state} | (once.keys() - tree().keys())
    assert {path for path in changed if "__pycache__" not in path.parts} == set()
    assert not told.startswith(("new", "updated", "kept", "removed"))


def test_the_runtime_starts_from_its_place(installed):
    told = subprocess.run(["/opt/ugv/venv/bin/ugv", "--version"], capture_output=True, text=True, check=True, cwd="/")
    assert told.stdout.startswith("ugv ")


def come_to(unit, state):
    """Wait until systemd says that a unit is in a state."""
    command, deadline = ["systemctl", "show", unit, "--property=ActiveState", "--value"], time.monotonic() + PATIENCE_S
    while (now := subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()) != state:
        assert time.monotonic() < deadline, now


@pytest.mark.parametrize(
    ("behaviour", "state"),
    [
        ("ExecStart=/bin/sleep infinity", "active"),
        ("ExecStart=/bin/sleep infinity\nExecStartPost=/bin/sleep infinity", "activating"),
        ("ExecStart=/bin/false\nRestart=always\nRestartSec=1h", "activating"),
    ],
    ids=["runs", "is not ready yet", "waits to be started again"],
)
def test_the_installer_leaves_a_robot_alone_whose_process(behaviour, state, installed):
    unit = "ugv-recorder.service"
    drop_in = Path(f"/run/systemd/system/{unit}.d/running.conf")
    drop_in.parent.mkdir()
    drop_in.write_text(f"[Service]\nType=exec\nWatchdogSec=0\nExecStart=\n{behaviour}\n")
    subprocess.run(["systemctl", "daemon-reload"], check=True)
    try:
        subprocess.run(["systemctl", "start", "--no-block", unit], check=True)
        come_to(unit, state)
        done = subprocess.run([INSTALLER], capture_output=True, text=True, check=False)
        assert (done.returncode, "systemctl stop ugv.target" in done.stderr) == (2, True), done.stderr
    finally:
        subprocess.run(["systemctl", "stop", unit], check=True)
        drop_in.unlink()
        drop_in.parent.rmdir()
        subprocess.run(["systemctl", "daemon-reload"], check=True)


def test_networkd_understands_every_line(installed):
    subprocess.run(["systemctl", "start", "systemd-networkd.service"], check=True)
    told = subprocess.run(
        ["journalctl", "--no-pager", "--output=cat", "--unit=systemd-networkd.service"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    subprocess.run(["systemctl", "stop", "systemd-networkd.service"], check=True)
    assert "ugv" not in told
    links = subprocess.run(
        ["udevadm", "--debug", "test-builtin", "net_setup_link", "/sys/class/net/lo"],
        capture_output=True,
        text=True,
        check=False,
    ).stderr
    assert "60-ugv-can.link" in links
    assert not [line for line in links.splitlines() if "60-ugv-can.link:" in line]
