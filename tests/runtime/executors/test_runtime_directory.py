# SPDX-License-Identifier: Apache-2.0
"""A runtime directory goes with its run, whatever becomes of the process that made it."""

import signal
import subprocess
import sys

import pytest

from runtime.executors import runtime_directory as module
from runtime.executors.runtime_directory import remove_if_orphaned, runtime_directory


@pytest.fixture(autouse=True)
def base(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_base", lambda: tmp_path)
    return tmp_path


def test_it_is_there_during_the_run_and_gone_after_it(base):
    with runtime_directory() as directory:
        (directory / "file").write_text("something")
        assert not remove_if_orphaned(directory)
        assert list(base.iterdir()) == [directory]
    assert list(base.iterdir()) == []


def test_the_next_run_removes_what_a_killed_one_left_and_nothing_else(base):
    code = "from runtime.executors import runtime_directory as m; from pathlib import Path; import signal\n"
    code += f"m._base = lambda: Path({str(base)!r})\n"
    code += "with m.runtime_directory() as d: print(d, flush=True); signal.pause()"
    (base / "ugv-run-of-nobody").mkdir()
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        left = process.stdout.readline().strip()
        with runtime_directory() as ours:
            assert sorted(map(str, base.iterdir())) == sorted((left, str(ours), str(base / "ugv-run-of-nobody")))
        process.send_signal(signal.SIGKILL)
    with runtime_directory() as ours:
        assert sorted(base.iterdir()) == sorted((ours, base / "ugv-run-of-nobody"))
