# SPDX-License-Identifier: Apache-2.0
"""The one exception family: what a person did or gave that cannot work, said in one sentence.

The message names the thing, the value, the bound and the place. Each room's own errors derive from `UgvError`, except
those of `drivers`, which stands on nothing of ours and has `drivers.DriverError`; the command line treats both alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar


class UgvError(Exception):
    """Base of every error that is answered with one sentence instead of a traceback.

    Attributes:
        exit_code: what a command that ends with this error returns to the shell.
    """

    exit_code: ClassVar[int] = 2


class UsageError(UgvError):
    """A command was called in a way it does not know."""


class ConfigError(UgvError):
    """A configuration, or an override of it, is broken, incomplete, out of range or contradicts itself."""


class OutputError(UgvError):
    """Results cannot be written where they were asked for."""


class RobotFault(UgvError):
    """The robot faulted and cannot go on."""

    exit_code: ClassVar[int] = 3


def unknown(kind: str, name: str, known: Iterable[str]) -> str:
    """The sentence for a name that nothing has, with what may have been meant.

    Args:
        kind: what it should have been the name of, as in "robot".
        name: what was given.
        known: the names that there are.
    """
    import difflib

    choices = sorted(known)
    close = difflib.get_close_matches(name, choices, 1)
    hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(choices)}" if choices else "there is none"
    return f"{kind} {name!r} is unknown; {hint}"
