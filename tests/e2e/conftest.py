# SPDX-License-Identifier: Apache-2.0
"""The command `ugv` in a process of its own, and one short walk that it recorded."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Ugv = Callable[..., subprocess.CompletedProcess[str]]

ROOT = Path(__file__).parents[2]
SHORT_PATH = "x,y\n0,0\n0.4,0\n0.8,0.05\n"


@pytest.fixture(scope="session")
def ugv() -> Ugv:
    """Runs `ugv` with arguments; gives its exit code and what it printed."""

    def run(*arguments: object, code: str = "", hash_seed: str = "0", limit: Callable[[], None] | None = None):
        program = f"{code}\nimport sys\nfrom runtime.cli.main import main\nsys.exit(main(sys.argv[1:]))"
        return subprocess.run(
            [sys.executable, "-c", program, *map(str, arguments)],
            capture_output=True,
            text=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONHASHSEED": hash_seed, "NO_COLOR": "1", "COLUMNS": "160"},
            preexec_fn=limit,
        )

    return run


@pytest.fixture(scope="session")
def short_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A CSV file with a path of less than a metre."""
    file = tmp_path_factory.mktemp("paths") / "short.csv"
    file.write_text(SHORT_PATH)
    return file


@pytest.fixture(scope="session")
def walk(ugv: Ugv, short_path: Path, tmp_path_factory: pytest.TempPathFactory) -> subprocess.CompletedProcess[str]:
    """The walk: exit code and what was printed; `walk.args[-1]` is its directory."""
    return ugv("sil", "uslgo1", short_path, "--seed", 3, "--out", tmp_path_factory.mktemp("runs") / "walk")


@pytest.fixture(scope="session")
def run_directory(walk: subprocess.CompletedProcess[str]) -> Path:
    """The directory of the walk; read only."""
    assert walk.returncode == 0, walk.stderr
    return Path(walk.args[-1])
