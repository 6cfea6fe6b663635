# SPDX-License-Identifier: Apache-2.0
"""Uninstalling stops the robot's processes and leaves nothing but logs and what was edited. Runs after all others."""

import pwd
import subprocess
from pathlib import Path

import pytest

CONFIGURATION = Path("/etc/ugv/uslgo1.toml")
INSTALLED = ("/opt/ugv", "/etc/systemd/system/ugv.target", "/etc/systemd/network/60-ugv-can.link", "/var/cache/ugv")


def uninstall(script, *options):
    return subprocess.run([script, *options], capture_output=True, text=True, check=True).stdout


def test_everything_goes_but_logs_and_edited_files(installed, tmp_path):
    script = tmp_path / "uninstall.sh"
    script.write_bytes(Path("/opt/ugv/uninstall.sh").read_bytes())
    script.chmod(0o755)
    CONFIGURATION.write_text(CONFIGURATION.read_text() + "# edited\n")
    logs = Path("/var/log/ugv")
    logs.mkdir(exist_ok=True)
    told = uninstall(script)
    assert f"kept     {CONFIGURATION}" in told
    assert [path for path in INSTALLED if Path(path).exists()] == []
    assert CONFIGURATION.exists()
    assert logs.is_dir()
    assert subprocess.run(["systemctl", "cat", "ugv-control.service"], capture_output=True).returncode != 0


def test_purging_takes_the_rest(installed, install):
    install("--no-warm-up")
    uninstall("/opt/ugv/uninstall.sh", "--purge")
    assert not CONFIGURATION.exists()
    assert not Path("/var/log/ugv").exists()
    with pytest.raises(KeyError):
        pwd.getpwnam("ugv")
