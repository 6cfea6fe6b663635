# SPDX-License-Identifier: Apache-2.0
"""A whole installation: the second time changes nothing, and the network files are understood by systemd."""

import hashlib
import subprocess
from pathlib import Path

TOUCHED = ("/opt/ugv", "/etc")


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


def test_the_installer_leaves_a_running_robot_alone(installed):
    install = Path(__file__).parents[2] / "deploy" / "install.sh"
    unit = Path("/run/systemd/system/ugv-recorder.service.d/running.conf")
    unit.parent.mkdir()
    unit.write_text("[Service]\nType=exec\nWatchdogSec=0\nExecStart=\nExecStart=/bin/sleep infinity\n")
    subprocess.run(["systemctl", "daemon-reload"], check=True)
    try:
        subprocess.run(["systemctl", "start", "ugv-recorder.service"], check=True)
        done = subprocess.run([install], capture_output=True, text=True, check=False)
        assert (done.returncode, "systemctl stop ugv.target" in done.stderr) == (2, True)
    finally:
        subprocess.run(["systemctl", "stop", "ugv-recorder.service"], check=True)
        unit.unlink()
        unit.parent.rmdir()
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
