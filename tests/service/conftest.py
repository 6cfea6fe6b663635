# SPDX-License-Identifier: Apache-2.0
"""A host with systemd, on which the runtime is installed; `make test-service` boots it and says where the wheels are.

These tests install into /opt and /etc of the machine that they run on, so they refuse any other.
"""

import os
import resource
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RIGHTS = "CAP_SYS_NICE CAP_IPC_LOCK"
WHEELS = os.environ.get("UGV_SERVICE_WHEELS", "")
SYSTEM_PYTHON = Path("/opt/python/bin/python3")
"""The interpreter of the tests, where it was moved out of a home directory."""


def python():
    """An interpreter that the units can see."""
    return SYSTEM_PYTHON if SYSTEM_PYTHON.exists() else Path(sys.base_prefix) / "bin" / "python3"


@pytest.fixture(scope="session", autouse=True)
def _host():
    """Fails rather than skips: who runs these tests wants them run."""
    if not WHEELS and "UGV_SERVICE_UNITS_ONLY" not in os.environ:
        pytest.exit("these tests install a service: use make test-service, which boots a host for them", 2)


@pytest.fixture(scope="session")
def install():
    """Runs the installer with packages from the wheels alone, and returns what it says."""

    def run(*options):
        command = [ROOT / "deploy" / "install.sh", "--python", python(), "--wheels", WHEELS, *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def installed(install):
    """The runtime under /opt/ugv, nothing compiled, nothing started.

    In a guest, which is slow, the files alone, and of the runtime what the stand-in needs.
    """
    if WHEELS:
        install("--no-warm-up")
        return
    subprocess.run([ROOT / "deploy" / "install.sh"], env={**os.environ, "DESTDIR": "/"}, check=True)
    subprocess.run(["systemd-sysusers", "ugv.conf"], check=True)
    subprocess.run([python(), "-m", "venv", "--without-pip", "/opt/ugv/venv"], check=True)
    (packages,) = Path("/opt/ugv/venv/lib").glob("python3*/site-packages")
    for room in ("runtime", "runtime/executors"):
        (packages / room).mkdir()
        for file in ("__init__.py", "linux.py"):
            if (ROOT / room / file).exists():
                shutil.copy(ROOT / room / file, packages / room)
    Path("/opt/ugv/venv/bin/ugv").touch(0o755)
    subprocess.run(["systemctl", "daemon-reload"], check=True)


@pytest.fixture
def real_time_by_limits(installed):
    """Whether control and link get their rights by their limits; where root may not raise any, by capabilities.

    Then it is not seen whether the limits are right, but that everything else lets the calls pass.
    """
    enough = resource.getrlimit(resource.RLIMIT_RTPRIO)[1] >= 90
    if enough or subprocess.run(["prlimit", "--rtprio=90:90", "true"], capture_output=True).returncode == 0:
        yield True
        return
    warnings.warn("root may not raise limits on this host: capabilities instead of LimitRTPRIO", stacklevel=1)
    drop_ins = [Path(f"/run/systemd/system/ugv-{name}.service.d/capabilities.conf") for name in ("control", "link")]
    for drop_in in drop_ins:
        drop_in.parent.mkdir(parents=True, exist_ok=True)
        drop_in.write_text(f"[Service]\nAmbientCapabilities={RIGHTS}\nCapabilityBoundingSet={RIGHTS}\n")
    subprocess.run(["systemctl", "daemon-reload"], check=True)
    yield False
    for drop_in in drop_ins:
        drop_in.unlink()
    subprocess.run(["systemctl", "daemon-reload"], check=True)
