# SPDX-License-Identifier: Apache-2.0
"""A runtime directory goes with its run, whatever becomes of the process that made it."""

import os
import select
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from runtime.executors import runtime_directory as module
from runtime.executors.runtime_directory import runtime_directory

TIMEOUT_S = 30.0


@pytest.fixture(autouse=True)
def base(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_base", lambda: tmp_path)
    return tmp_path


def maker(base):
    """A process that makes a directory, and says which and who its heir is, and then waits."""
    code = "from runtime.executors import runtime_directory as m; from pathlib import Path; import signal\n"
    code += f"m._base = lambda: Path({str(base)!r})\n"
    code += "with m.runtime_directory() as d: print(d, flush=True); signal.pause()"
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)


def heir_of(directory):
    """Process id of the one that waits for the end of a directory's maker."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if (process / "cmdline").read_bytes().decode().split("\0")[-2:] == [directory, ""]:
                return int(process.name)
    raise AssertionError(f"nobody waits for the end of {directory}")


def test_it_is_there_during_the_run_and_gone_after_it(base):
    with runtime_directory() as directory:
        (directory / "file").write_text("something")
        assert list(base.iterdir()) == [directory]
    assert list(base.iterdir()) == []


def test_what_fails_leaves_none(base):
    with pytest.raises(ZeroDivisionError), runtime_directory():
        _ = 1 // 0
    assert list(base.iterdir()) == []


def test_its_heir_removes_what_a_killed_run_left(base):
    with maker(base) as process:
        directory = process.stdout.readline().strip()
        heir = os.pidfd_open(heir_of(directory))
        process.kill()
    assert select.select([heir], [], [], TIMEOUT_S)[0]
    os.close(heir)
    assert list(base.iterdir()) == []


def test_the_next_run_removes_what_a_killed_one_and_its_heir_left_and_nothing_else(base):
    (base / "ugv-run-of-nobody").mkdir()
    with maker(base) as process:
        left = process.stdout.readline().strip()
        with runtime_directory() as ours:
            assert sorted(map(str, base.iterdir())) == sorted((left, str(ours), str(base / "ugv-run-of-nobody")))
        os.kill(heir_of(left), signal.SIGKILL)
        process.kill()
    with runtime_directory() as ours:
        assert sorted(base.iterdir()) == sorted((ours, base / "ugv-run-of-nobody"))
