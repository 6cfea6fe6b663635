# SPDX-License-Identifier: Apache-2.0
"""Runs go into new directories, and nothing already recorded is lost."""

import errno
import tempfile
from pathlib import Path
from typing import Any

import pytest

from runtime.cli.output import run_directory
from runtime.errors import OutputError


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_each_run_gets_the_next_free_directory() -> None:
    used = []
    for _ in range(3):
        with run_directory(None, "uslgo1-flat-0") as directory:
            (directory / "summary.json").touch()
            used.append(directory)
    assert used == [Path("runs/uslgo1-flat-0"), Path("runs/uslgo1-flat-0-2"), Path("runs/uslgo1-flat-0-3")]


def test_a_name_cannot_leave_the_runs() -> None:
    with run_directory(None, "../../etc/x y") as directory:
        assert directory == Path("runs/.._.._etc_x_y")


def test_a_run_that_wrote_nothing_leaves_nothing() -> None:
    with pytest.raises(RuntimeError), run_directory(None, "uslgo1-flat-0"):
        raise RuntimeError
    assert list(Path("runs").iterdir()) == []


def test_what_a_failed_run_wrote_stays() -> None:
    with pytest.raises(RuntimeError), run_directory(Path("mine"), "x") as directory:
        (directory / "x.mcap").touch()
        raise RuntimeError
    assert Path("mine/x.mcap").exists()


def test_an_empty_directory_is_taken_and_kept() -> None:
    Path("mine").mkdir()
    with run_directory(Path("mine"), "x") as directory:
        assert directory == Path("mine")
    assert Path("mine").is_dir()


@pytest.mark.parametrize(
    ("out", "sentence"),
    [
        ("file", "--out file: is not a directory"),
        ("file/inside", "--out file/inside: cannot be written to: Not a directory"),
        ("used", "--out used: already holds files; choose a new or an empty directory"),
        ("n" * 300, "cannot be written to: File name too long"),
    ],
)
def test_an_unfit_directory_is_named(out: str, sentence: str) -> None:
    Path("file").touch()
    Path("used").mkdir()
    Path("used/x.mcap").write_text("recorded")
    with pytest.raises(OutputError) as caught, run_directory(Path(out), "x"):
        pass
    assert str(caught.value).endswith(sentence)
    assert Path("used/x.mcap").read_text() == "recorded"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES, errno.EROFS])
def test_a_full_or_protected_disk_is_named(monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refuse(**options: Any) -> None:
        raise OSError(number, "as the system says")

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    with pytest.raises(OutputError, match="mine: cannot be written to: as the s"), run_directory(Path("mine"), "x"):
        pass
    assert not Path("mine").exists()


def test_a_file_in_the_place_of_the_runs_is_named() -> None:
    Path("runs").touch()
    with pytest.raises(OutputError, match="runs"), run_directory(None, "x"):
        pass
