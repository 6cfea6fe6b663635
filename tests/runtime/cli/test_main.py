# SPDX-License-Identifier: Apache-2.0
"""The command answers at once, and every mistake gets one sentence, the right exit code and no traceback."""

import argparse
import importlib
import subprocess
import sys

import pytest

from runtime.cli import main as cli
from runtime.errors import ConfigError, RobotFault, unknown

HEAVY = ("numpy", "mujoco", "matplotlib", "pinocchio", "zenoh", "can", "rich", "msgspec", "sim_bridge", "drivers")


def complaint(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 2) -> str:
    """The one sentence that a command ends with."""
    assert cli.main(arguments) == code
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("ugv")
    return lines[0]


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], *([verb, "--help"] for verb in cli.VERBS)])
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    script = (
        "import sys\n"
        "from runtime.cli.main import main\n"
        "try:\n"
        f"    code = main({arguments!r})\n"
        "except SystemExit as exit:\n"
        "    code = exit.code\n"
        f"heavy = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "sys.exit(f'imported {heavy}' if heavy else code)\n"
    )
    outcome = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stderr
    assert "ugv" in outcome.stdout


def test_help_lists_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        cli.main(["--help"])
    assert caught.value.code == 0
    text = capsys.readouterr().out
    assert all(verb in text for verb in cli.VERBS)


@pytest.mark.parametrize("verb", cli.VERBS)
def test_every_verb_has_its_two_functions(verb: str) -> None:
    module = importlib.import_module(f"runtime.cli.{verb}")
    module.add_arguments(argparse.ArgumentParser())
    assert callable(module.run)


def test_no_verb_prints_the_help_and_fails(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([]) == 2
    assert "usage: ugv" in capsys.readouterr().err


def test_unknown_verb_names_the_closest(capsys: pytest.CaptureFixture[str]) -> None:
    assert complaint(capsys, "sill", "uslgo1") == "ugv: command 'sill' is unknown; did you mean sil?"


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["sil"], "ROBOT"),
        (["sil", "uslgo1", "flat", "--seed", "x"], "--seed"),
        (["sil", "uslgo1", "flat", "--seed", "-1"], "-1 is not from 0"),
        (["sil", "uslgo1", "flat", "--estimator", "guess"], "--estimator"),
        (["sil", "uslgo1", "flat", "--frobnicate"], "--frobnicate"),
        (["sil", "uslgo1", "flat", "--view"], "--view comes with a later version"),
        (["sil", "uslgo1", "flat", "--set", "wbc.rate_hz"], "wants KEY=VALUE"),
        (["replay", "/no/such/run"], "/no/such/run: there is no such run"),
        (["replay", "/no/such/run", "--from", "nan"], "--from"),
        (["report", "/no/such/run"], "/no/such/run: there is no such run"),
        (["log", "info", "/no/such/run"], "/no/such/run: there is no such run"),
        (["log", "list", "/no/such/run"], "list"),
        (["config", "mend", "uslgo1"], "mend"),
        (["bench", "gait"], "gait"),
        (["bench", "mpc", "--slices", "3"], "--slices is for `ugv bench rt` alone"),
        (["bench", "rt", "--slices", "0"], "0 is not"),
        (["experiment", "paper-00"], "did you mean paper-002?"),
        (["experiment", "paper-000", "--seeds", "0"], "0 is not from 1"),
    ],
)
def test_bad_usage_gets_one_sentence(capsys: pytest.CaptureFixture[str], arguments: list[str], part: str) -> None:
    assert part in complaint(capsys, *arguments)


class DriverError(Exception):
    """Stands in for the drivers' own family."""


DriverError.__module__ = "drivers.errors"


@pytest.mark.parametrize(
    ("error", "code", "sentence"),
    [
        (ConfigError("uslgo1.toml: wbc.rate_hz = 5000 is above 1000"), 2, "ugv: uslgo1.toml: wbc.rate_hz = 5000"),
        (RobotFault("motor 3 is too hot"), 3, "ugv: motor 3 is too hot"),
        (DriverError("frame of 5 bytes"), 2, "ugv: frame of 5 bytes"),
        (OSError(28, "No space left on device", "runs/x.mcap"), 2, "ugv: runs/x.mcap: No space left on device"),
        (KeyboardInterrupt(), 130, "ugv: interrupted"),
        (ConfigError("two\nlines"), 2, "ugv: two lines"),
    ],
)
def test_errors_become_a_sentence_and_an_exit_code(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, sentence: str
) -> None:
    def fail(options: argparse.Namespace) -> int:
        raise error

    monkeypatch.setattr("runtime.cli.report.run", fail)
    assert complaint(capsys, "report", "run", code=code).startswith(sentence)


def test_a_mistake_of_the_code_itself_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(options: argparse.Namespace) -> int:
        raise AssertionError("a defect")

    monkeypatch.setattr("runtime.cli.report.run", fail)
    with pytest.raises(AssertionError):
        cli.main(["report", "run"])


@pytest.mark.parametrize(
    ("known", "sentence"),
    [
        (["uslgo1", "4ws4wd"], "robot 'uslgo2' is unknown; did you mean uslgo1?"),
        (["titan8", "4ws4wd"], "robot 'uslgo2' is unknown; known are 4ws4wd, titan8"),
        ([], "robot 'uslgo2' is unknown; there is none"),
    ],
)
def test_unknown_names_what_may_have_been_meant(known: list[str], sentence: str) -> None:
    assert unknown("robot", "uslgo2", known) == sentence
