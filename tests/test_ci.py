# SPDX-License-Identifier: Apache-2.0
"""What `.ci/run` did not show, it names: here with a `make` that answers by a table."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SKIPPED = "SKIPPED [1] tests/{}.py:12: in a guest the loops take ten times as long"


class Ci:
    """A copy of `.ci/run` where every target passes, unless it is told otherwise."""

    def __init__(self, directory: Path) -> None:
        self._programs, self._answers = directory / "bin", directory / "answers"
        for made in (self._programs, self._answers, directory / ".ci"):
            made.mkdir()
        self._script = shutil.copy(ROOT / ".ci" / "run", directory / ".ci")
        make = self._programs / "make"
        make.write_text(f'#!/bin/sh\n[ ! -f {self._answers}/$2 ] || . "{self._answers}/$2"\n')
        make.chmod(0o755)

    def answer(self, target: str, printed: str, status: int = 0) -> None:
        (self._answers / target).write_text(f"printf '%s\\n' '{printed}'\nexit {status}\n")

    def run(self, **environment: str) -> tuple[int, list[str]]:
        """Its exit code, and the lines after those of the targets."""
        inherited = {key: value for key, value in os.environ.items() if not key.startswith("UGV_NO_")}
        path = f"{self._programs}:{os.environ['PATH']}"
        done = subprocess.run(
            [self._script], env={**inherited, **environment, "PATH": path}, capture_output=True, text=True, check=False
        )
        lines = done.stdout.splitlines()
        return done.returncode, lines[lines.index("") + 1 :]


@pytest.fixture
def ci(tmp_path: Path) -> Ci:
    return Ci(tmp_path)


def not_shown(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith("not shown: ")]


def test_where_nothing_is_left_out_nothing_is_named(ci: Ci) -> None:
    code, lines = ci.run()
    assert (code, not_shown(lines), lines[-1]) == (0, [], "all passed")


@pytest.mark.parametrize("target", ["test", "test-guest", "test-service"])
def test_every_skipped_test_is_named_with_its_reason(ci: Ci, target: str) -> None:
    skipped = [SKIPPED.format(name) for name in ("one", "another")]
    ci.answer(target, "\n".join(["...ss", *skipped, "===== 3 passed, 2 skipped ====="]))
    code, lines = ci.run()
    assert (code, not_shown(lines)) == (0, [f"not shown: make {target}: {line}" for line in skipped])


def test_what_was_skipped_of_a_target_that_fails_is_named_too(ci: Ci) -> None:
    ci.answer("test-guest", SKIPPED.format("one"), status=1)
    code, lines = ci.run()
    assert (code, not_shown(lines)) == (1, [f"not shown: make test-guest: {SKIPPED.format('one')}"])
    assert lines[-1] == "failed: make test-guest"


def test_a_target_that_is_left_out_is_named(ci: Ci) -> None:
    _, lines = ci.run(UGV_NO_GUEST="1", UGV_NO_SERVICE="1")
    assert not_shown(lines) == [
        "not shown: make test-guest, since UGV_NO_GUEST=1",
        "not shown: make test-service, since UGV_NO_SERVICE=1",
    ]


def test_the_tests_tell_why_they_skip() -> None:
    """The lines that are looked for come with pytest's option -r."""
    assert '"-ra"' in (ROOT / "pyproject.toml").read_text()
