# SPDX-License-Identifier: Apache-2.0
"""Kept machine code is that of the sources as they are, whoever compiled it and however many did."""

import os
import subprocess
import sys

import pytest

from runtime import kernel_cache
from runtime.kernel_cache import source_digest

SCRIPT = """
import sys
import numpy as np
from runtime.optimization.linear import solve_positive
size = int(sys.argv[1])
matrix = np.diag(4.0 ** np.arange(size))
# processes ask for different signatures of one kernel: rows in order, by columns, and as a view
right = (np.ones((size, 2)), np.ones((2, size)).T, np.ones((size, 4))[:, ::2])[size % 3]
print(solve_positive(matrix, right)[:, 0].tolist(), sum(solve_positive.stats.cache_hits.values()))
"""


@pytest.fixture
def sources(tmp_path, monkeypatch):
    """Files of which a imports b, b imports c, and c two submodules in parentheses and one of the drivers."""
    monkeypatch.setattr(kernel_cache, "_PACKAGES", tmp_path)
    room = tmp_path / "runtime" / "room"
    room.mkdir(parents=True)
    (room / "a.py").write_text("from runtime.room import b, other\n")
    (room / "b.py").write_text("from runtime.room.c import thing\n")
    (room / "c.py").write_text(
        "from drivers.wire import (\n    thing as same,\n)\nfrom runtime.room import (\n    d,\n    e,\n)\n"
    )
    (room / "d.py").write_text("thing = 1\n")
    (room / "e.py").write_text("thing = 1\n")
    (room / "apart.py").write_text("thing = 1\n")
    (tmp_path / "drivers").mkdir()
    (tmp_path / "drivers" / "wire.py").write_text("thing = 1\n")
    return room


@pytest.mark.parametrize("changed", ["a", "b", "c", "d", "e", "../../drivers/wire", "apart"])
def test_the_digest_is_of_the_file_and_all_that_it_imports(sources, changed):
    before = source_digest.__wrapped__(sources / "a.py")
    path = sources / f"{changed}.py"
    path.write_text(path.read_text() + "more = 2\n")
    assert (source_digest.__wrapped__(sources / "a.py") != before) == (changed != "apart")


def launch(directory, size):
    environment = {**os.environ, "UGV_CACHE_DIR": str(directory)}
    command = [sys.executable, "-c", SCRIPT, str(size)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def test_processes_that_compile_at_the_same_time_do_not_mix_up_their_code(tmp_path):
    for hits in (0, 1):
        running = [launch(tmp_path, size) for size in (2, 3, 4)]
        for size, process in zip((2, 3, 4), running, strict=True):
            output, _ = process.communicate(timeout=120)
            assert output.strip() == f"{[4.0**-n for n in range(size)]} {hits}"


def test_without_a_place_to_keep_it_the_code_is_compiled_anew(tmp_path):
    (tmp_path / "kernels").write_text("a file stands in the way")
    for _ in range(2):
        output, _ = launch(tmp_path, 2).communicate(timeout=120)
        assert output.strip() == "[1.0, 0.25] 0"
