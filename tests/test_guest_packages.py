# SPDX-License-Identifier: Apache-2.0
"""What the scripts that boot something need is installed after the lists of packages were fetched, or named."""

import os
import subprocess
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
SCRIPTS = ("guest/boot", "guest/with-can", "service/in-systemd", "service/with-limits")


class Host:
    """A host with stand-ins for some programs; `asked` is what apt-get was asked for."""

    def __init__(self, directory: Path) -> None:
        self._programs, self._asked = directory / "bin", directory / "asked"
        self._programs.mkdir()
        self._asked.touch()

    def put(self, program: str, script: str) -> None:
        file = self._programs / program
        file.write_text(f"#!/bin/sh\n{script}\n")
        file.chmod(0o755)

    def put_apt_get(self, status: int = 0) -> None:
        self.put("apt-get", f"printf '%s\\n' \"$*\" >> {self._asked}\nexit {status}")

    def need(self, *pairs: str) -> subprocess.CompletedProcess[str]:
        command = ["bash", "-uc", f"source {TESTS / 'guest/packages'}; need {' '.join(pairs)}; echo has all"]
        path = f"{self._programs}:{os.environ['PATH']}"
        return subprocess.run(command, env={"PATH": path}, capture_output=True, text=True, check=False)

    @property
    def asked(self) -> list[str]:
        return self._asked.read_text().splitlines()


@pytest.fixture
def host(tmp_path: Path) -> Host:
    """With apt-get, for root."""
    host = Host(tmp_path)
    host.put("id", "echo 0")
    host.put_apt_get()
    return host


def test_root_has_the_lists_fetched_before_what_is_missing_is_installed(host: Host) -> None:
    done = host.need("one-package=no-such-program", "shell=sh", "headers=no-such-program")
    assert (done.returncode, done.stdout) == (0, "Installing one-package headers.\nhas all\n")
    assert [line.split()[0] for line in host.asked] == ["update", "install"]
    assert host.asked[1].split()[-2:] == ["one-package", "headers"]


def test_where_nothing_is_missing_nothing_is_asked_for(host: Host) -> None:
    assert host.need("shell=sh").stdout == "has all\n"
    assert host.asked == []


def test_who_is_not_root_is_told_what_is_missing(host: Host) -> None:
    host.put("id", "echo 1000")
    done = host.need("one-package=no-such-program")
    assert (done.returncode, done.stdout, host.asked) == (2, "", [])
    assert "one-package" in done.stderr


def test_what_cannot_be_installed_is_said(host: Host) -> None:
    host.put_apt_get(status=100)
    done = host.need("one-package=no-such-program")
    assert (done.returncode, done.stdout) == (2, "Installing one-package.\n")
    assert "could not install one-package" in done.stderr


@pytest.mark.parametrize("script", SCRIPTS)
def test_no_script_installs_anything_in_another_way(script: str) -> None:
    assert "apt-get" not in (TESTS / script).read_text()
