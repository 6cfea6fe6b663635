# SPDX-License-Identifier: Apache-2.0
"""A host with systemd, on which the runtime is installed; `make test-service` boots it and says where the wheels are.

These tests install into /opt and /etc of the machine that they run on, so they refuse any other.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WHEELS = os.environ.get("UGV_SERVICE_WHEELS", "")
SYSTEM_PYTHON = Path("/opt/python/bin/python3")
"""The interpreter of the tests, where it was moved out of a home directory."""


@pytest.fixture(scope="session", autouse=True)
def _host():
    """Fails rather than skips: who runs these tests wants them run."""
    if not WHEELS:
        pytest.exit("these tests install a service: use make test-service, which boots a host for them", 2)


@pytest.fixture(scope="session")
def install():
    """Runs the installer with packages from the wheels alone, and returns what it says."""
    python = SYSTEM_PYTHON if SYSTEM_PYTHON.exists() else Path(sys.base_prefix) / "bin" / "python3"

    def run(*options):
        command = [ROOT / "deploy" / "install.sh", "--python", python, "--wheels", WHEELS, *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def installed(install):
    """The runtime under /opt/ugv, nothing compiled, nothing started."""
    install("--no-warm-up")
