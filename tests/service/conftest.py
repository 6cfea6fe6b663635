# SPDX-License-Identifier: Apache-2.0
"""A host with systemd, on which the runtime is installed; `make test-service` boots it and sets UGV_SERVICE_HOST.

Elsewhere these tests are not collected: they install into /opt and /etc of the machine that they run on.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WHEELS = Path(os.environ.get("UGV_SERVICE_HOST", ""))
SYSTEM_PYTHON = Path("/opt/python/bin/python3")
"""The interpreter of the tests, where it was moved out of a home directory."""

collect_ignore_glob = [] if "UGV_SERVICE_HOST" in os.environ else ["test_*.py"]


def install(*options: str) -> str:
    """Run the installer with packages from the wheels alone, and return what it says."""
    python = SYSTEM_PYTHON if SYSTEM_PYTHON.exists() else Path(sys.base_prefix) / "bin" / "python3"
    command = [ROOT / "deploy" / "install.sh", "--python", python, "--wheels", WHEELS, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def installed() -> None:
    """The runtime under /opt/ugv, nothing compiled, nothing started."""
    install("--no-warm-up")
