# SPDX-License-Identifier: Apache-2.0
"""The packages that the runtime stands on, and the machine code of its loops."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path

from runtime.cli.fitness.finding import Finding, fail, ok, warn

DISTRIBUTION = "ugv-runtime"
INSTALL = "run deploy/install.sh again (in a checkout: make venv)"
_KERNEL = re.compile(r"^@compiled", re.MULTILINE)
_PIN = re.compile(r'([a-z0-9.-]+)==([\w.]+)(?:; python_version (<|>=) "3\.(\d+)")?')


def read_constraints() -> str:
    """The versions that the project is tested with: beside the environment, or in the checkout; empty if neither."""
    for place in (Path(sys.prefix).parent, Path(__file__).resolve().parents[3]):
        file = place / "constraints.txt"
        if file.is_file():
            return file.read_text()
    return ""


def read_required() -> list[str]:
    """Names of the packages that the runtime asks for."""
    asked = metadata.requires(DISTRIBUTION) or []
    return [name for name in map(_applicable, asked) if name]


def _applicable(requirement: str) -> str:
    """The name in a requirement; empty for an extra or another Python."""
    name, _, marker = requirement.partition(";")
    found = re.search(r"python_version\s*(<|>=)\s*['\"]3\.(\d+)", marker)
    if "extra" in marker or (found and not _is_this_python(found.group(1), int(found.group(2)))):
        return ""
    matched = re.match(r"[\w.-]+", name)
    return matched.group().lower() if matched else ""


def _is_this_python(comparison: str, minor: int) -> bool:
    return (sys.version_info.minor < minor) == (comparison == "<")


def read_installed() -> dict[str, str]:
    """Version of every installed package, by name."""
    found = metadata.distributions()
    return {re.sub(r"[-_]+", "-", one.metadata["Name"]).lower(): one.version for one in found if one.metadata["Name"]}


def pins(constraints: str) -> dict[str, str]:
    """The versions that constraints ask of this Python."""
    found = {}
    for name, version, comparison, minor in _PIN.findall(constraints):
        if not comparison or _is_this_python(comparison, int(minor)):
            found[name] = version
    return found


def read_kernels(directory: Path) -> tuple[int | None, int]:
    """How many of our source files with kernels are compiled in a directory, and how many there are.

    None of a directory that cannot be read.
    """
    from runtime.kernel_cache import is_compiled

    room = Path(__file__).resolve().parents[2]
    files = [file for file in sorted(room.rglob("*.py")) if _KERNEL.search(file.read_text())]
    try:
        return sum(is_compiled(file, directory) for file in files), len(files)
    except PermissionError:
        return None, len(files)


def check_packages(required: Iterable[str], pinned: Mapping[str, str], installed: Mapping[str, str]) -> Finding:
    """Every package is there, in the version that was tested."""
    missing = sorted(name for name in required if name not in installed)
    if missing:
        return fail("packages", f"missing: {', '.join(missing)}", INSTALL)
    if not pinned:
        return warn("packages", "there is no constraints.txt to compare versions with", INSTALL)
    others = sorted(name for name, version in pinned.items() if installed.get(name, version) != version)
    if others:
        named = ", ".join(f"{name} {installed[name]} (tested: {pinned[name]})" for name in others)
        return warn("packages", f"other versions than those tested: {named}", INSTALL)
    return ok("packages", f"all {len(pinned)} versions are those tested")


def check_kernels(compiled: int | None, sources: int, directory: Path) -> Finding:
    """The loops' machine code is there.

    Args:
        compiled: source files with machine code for this processor; None if the directory cannot be read.
        sources: source files with kernels.
        directory: that the machine code is kept in.
    """
    if compiled is None:
        return warn("machine code", f"{directory} cannot be read", "run ugv doctor as root, or in the group ugv")
    if not compiled:
        sentence = f"the loops are not compiled for this processor in {directory}: the first start takes minutes"
        return warn("machine code", sentence, INSTALL)
    return ok("machine code", f"{compiled} of {sources} source files are compiled for this processor in {directory}")
