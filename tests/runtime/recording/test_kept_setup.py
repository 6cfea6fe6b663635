# SPDX-License-Identifier: Apache-2.0
"""A recorder that is started again takes up what the one before it knew, unless anything has changed since."""

import os
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from runtime.recording import kept_setup as kept
from runtime.recording.kept_setup import SETUP_FILE, Prepared, kept_setup, origin

PATIENCE_S = 120.0


@pytest.fixture
def setup(toy):
    return Prepared(toy.setup(), 1)


def never():
    raise AssertionError("a setup is made though one is kept")


def test_what_is_kept_is_taken_up_as_it_was(setup, tmp_path):
    assert kept_setup(tmp_path, "a", lambda: setup) is setup
    assert kept_setup(tmp_path, "a", never) == setup


def test_one_of_another_origin_is_replaced(setup, tmp_path):
    kept_setup(tmp_path, "a", lambda: setup)
    other = Prepared(replace(setup.setup, robot="other"), 2)
    assert kept_setup(tmp_path, "b", lambda: other) == other
    assert kept_setup(tmp_path, "b", never) == other


@pytest.mark.parametrize(
    "content", [b"", b"\x00", b"\x81\xa6origin\xa1a", b"\x81\xa6origin\xa1\x80", bytes(range(256))]
)
def test_one_that_cannot_be_read_is_replaced(content, setup, tmp_path):
    (tmp_path / SETUP_FILE).write_bytes(content)
    assert kept_setup(tmp_path, "a", lambda: setup) == setup
    assert kept_setup(tmp_path, "a", never) == setup


def test_one_that_cannot_be_kept_does_no_harm(setup, tmp_path):
    assert kept_setup(tmp_path / "missing", "a", lambda: setup) == setup


def test_the_origin_tells_every_choice_and_every_source_apart(tmp_path, monkeypatch):
    choices = [(), (b"",), (b"a", b"b"), (b"ab",), (b"b", b"a")]
    assert len({origin(*choice) for choice in choices}) == len(choices)
    assert origin(b"a") == origin(b"a")
    before, file = origin(), tmp_path / "runtime" / "robots" / "a.toml"
    monkeypatch.setattr(kept, "_PACKAGES", tmp_path)
    file.parent.mkdir(parents=True)
    file.write_text("mass_kg = 1")
    first = origin()
    file.write_text("mass_kg = 2")
    assert len({before, first, origin()}) == 3


def recorder(directory: Path, manager: socket.socket, *options: str) -> tuple[subprocess.Popen[bytes], str]:
    """The robot's recorder, ready, and what is mapped into it."""
    command = [sys.executable, "-m", "runtime.cli.main", "run", "uslgo1", "--process", "recorder", *options]
    command += ["--runtime-dir", str(directory), "--log-dir", str(directory / "logs")]
    environment = {**os.environ, "NOTIFY_SOCKET": manager.getsockname()}
    process = subprocess.Popen(command, env=environment, cwd=Path(__file__).parents[3])
    while manager.recv(100) != b"READY=1":
        pass
    return process, Path(f"/proc/{process.pid}/maps").read_text()


def test_the_robots_recorder_loads_no_robot_when_it_is_started_again(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "manager.sock"))
        manager.settimeout(PATIENCE_S)
        loaded = []
        for options in ((), (), ("--set", "loops.wbc_priority=81")):
            process, mapped = recorder(tmp_path, manager, *options)
            process.send_signal(signal.SIGKILL)
            process.wait()
            loaded.append("pinocchio" in mapped and "llvmlite" in mapped)
        assert loaded == [True, False, True]
