# SPDX-License-Identifier: Apache-2.0
"""Where compiled kernels are kept from run to run.

numba's own cache looks at the file that a kernel stands in alone, so it would go on using machine code into which an
older version of another file was inlined; and two processes that fill it at once can mix up their entries. Here each
state of the sources (a file and all that it imports of ours) has a directory of its own, under a lock.
"""

from __future__ import annotations

import atexit
import fcntl
import hashlib
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from llvmlite.binding import get_host_cpu_name
from numba.core import caching

_PACKAGES = Path(__file__).resolve().parents[1]
_IMPORT = re.compile(r"^from ((?:runtime|drivers|sim_bridge)[\w.]*) import (?:\(([^)]*)\)|(.*))", re.MULTILINE)


def kept_directory() -> Path:
    """Where machine code belongs: under UGV_CACHE_DIR, or else within the environment, which goes with the program."""
    return Path(os.environ.get("UGV_CACHE_DIR") or sys.prefix) / "kernels"


def is_compiled(file: Path, directory: Path) -> bool:
    """Whether a directory holds machine code of the present state of a source file, for this processor."""
    processor = get_host_cpu_name().encode()
    return any(processor in index.read_bytes() for index in (directory / source_digest(file)).glob("*.nbi"))


@cache
def _directory() -> Path:
    """The one for this process: where nothing can be written there, a passing one, and it compiles anew."""
    kept = kept_directory()
    try:
        kept.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=kept).close()
    except OSError:
        passing = tempfile.mkdtemp(prefix="ugv-kernels-")
        atexit.register(shutil.rmtree, passing, ignore_errors=True)
        return Path(passing)
    return kept


@cache
def _imports(file: Path) -> tuple[Path, ...]:
    """Our files that a file imports directly."""
    names = set()
    for module, in_parentheses, on_the_line in _IMPORT.findall(file.read_text()):
        names |= {module, *(f"{module}.{name}" for name in re.findall(r"\w+", in_parentheses or on_the_line))}
    found = (_PACKAGES / Path(*name.split(".")).with_suffix(".py") for name in names)
    return tuple(path for path in found if path.is_file())


@cache
def source_digest(file: Path) -> str:
    """Of a file and all that it imports of ours, directly or not."""
    known, waiting = {file}, [file]
    while waiting:
        new = set(_imports(waiting.pop())) - known
        known |= new
        waiting += new
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(known))).hexdigest()[:20]


class _Locator(caching.UserProvidedCacheLocator):
    """Puts the kernels of one state of a file into one directory."""

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        self._py_file, self._lineno = file, function.__code__.co_firstlineno
        self._cache_path = str(_directory() / source_digest(Path(file).resolve()))

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Locator:
        locator = cls(function, file)
        locator.ensure_cache_path()  # type: ignore[no-untyped-call]
        return locator


class _Implementation(caching.CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 # the base class has a list


class KernelCache(caching.FunctionCache):
    """The cache of one kernel."""

    _impl_class = _Implementation

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The machine code for a signature, None if there is none yet."""
        with self._locked():
            return super().load_overload(signature, target)  # type: ignore[no-untyped-call]

    def save_overload(self, signature: Any, code: Any) -> None:
        """Keep machine code."""
        with self._locked():
            super().save_overload(signature, code)  # type: ignore[no-untyped-call]

    @contextmanager
    def _locked(self) -> Iterator[None]:
        handle = os.open(self.cache_path, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield
        finally:
            os.close(handle)
