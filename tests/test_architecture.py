# SPDX-License-Identifier: Apache-2.0
"""The rooms keep to the import rules, and every room has a floor."""

import re
import sys
from pathlib import Path

import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).parent.parent
CONFIGURATION = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_import_rules_hold(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    status = lint_imports(config_filename="pyproject.toml", no_cache=True)
    assert status == EXIT_STATUS_SUCCESS, capsys.readouterr().out


def test_every_room_stands_on_a_floor() -> None:
    floors = " ".join(CONFIGURATION["tool"]["importlinter"]["contracts"][0]["layers"])
    named = set(re.findall(r"[\w.]+", floors))
    rooms = {
        f"runtime.{entry.stem}"
        for entry in (ROOT / "runtime").iterdir()
        if entry.suffix == ".py" or list(entry.glob("*.py"))
    }
    assert rooms - {"runtime.__init__"} <= named


def test_python_files_begin_with_their_licence() -> None:
    files = [path for room in ("runtime", "drivers", "sim_bridge", "tests") for path in (ROOT / room).rglob("*.py")]
    missing = [
        str(path.relative_to(ROOT))
        for path in files
        if path.stat().st_size and not path.read_text().startswith("# SPDX-License-Identifier: Apache-2.0\n")
    ]
    assert missing == []


def test_test_folders_are_not_packages() -> None:
    assert list((ROOT / "tests").rglob("__init__.py")) == []


def test_constraints_are_names_and_versions_only() -> None:
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        assert line.startswith("#") or re.fullmatch(r'[a-z0-9.-]+==[\w.]+(; python_version (<|>=) "3\.\d+")?', line)
