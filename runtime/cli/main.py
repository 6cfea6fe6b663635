# SPDX-License-Identifier: Apache-2.0
"""The command `ugv`: finds the verb, runs it, and turns every error of ours into one sentence.

Exit codes: 0 ok, 1 the run failed its criteria, 2 bad usage or input, 3 the robot faulted.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from runtime.errors import UgvError, UsageError, unknown

VERBS = {
    "sil": "run a scenario in simulation, on the real wires",
    "run": "run a robot: the service on it",
    "replay": "execute a recorded run again and compare it bit for bit",
    "report": "write the HTML report of a run",
    "log": "say what is in a log",
    "doctor": "say whether this host is fit to run a robot",
    "config": "check or show a robot's configuration",
    "bench": "measure a part, beside what it is compared with",
    "experiment": "reproduce a paper's table",
}

INTERRUPTED = 130


class Parser(argparse.ArgumentParser):
    """An argument parser whose mistakes are one sentence."""

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments.

        Raises:
            UsageError: always.
        """
        raise UsageError(f"{self.prog}: {message} (see {self.prog} --help)")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    single_threaded()
    try:
        return _run(list(sys.argv[1:] if arguments is None else arguments))
    except UgvError as error:
        return _complain(str(error), error.exit_code)
    except KeyboardInterrupt:
        return _complain("interrupted", INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _complain(f"{where}{error.strerror or error}", UgvError.exit_code)
    except Exception as error:
        if not _of_drivers(error):
            raise
        return _complain(str(error), UgvError.exit_code)


def single_threaded() -> None:
    """One thread per linear-algebra call, or results differ between runs; libraries read this when first imported."""
    for library in ("OPENBLAS", "OMP", "MKL"):
        os.environ[f"{library}_NUM_THREADS"] = "1"


def _run(arguments: list[str]) -> int:
    parser = Parser(prog="ugv", description="The software between the sensors and the motors of a ground robot.")
    parser.add_argument("--version", action="store_true", help="print the version")
    verbs = parser.add_subparsers(metavar="VERB", dest="verb", parser_class=Parser)
    verb = next((argument for argument in arguments if not argument.startswith("-")), None)
    if verb is not None and verb not in VERBS:
        raise UsageError("ugv: " + unknown("command", verb, VERBS))
    for name, purpose in VERBS.items():
        subparser = verbs.add_parser(name, help=purpose, description=f"{purpose[0].upper()}{purpose[1:]}.")
        if name == verb:
            module = importlib.import_module(f"runtime.cli.{name}")
            module.add_arguments(subparser)
    options = parser.parse_args(arguments)
    if options.version:
        from importlib.metadata import version

        print(f"ugv {version('ugv-runtime')}")
        return 0
    if verb is None:
        parser.print_help(sys.stderr)
        return UsageError.exit_code
    return int(module.run(options))


def _of_drivers(error: Exception) -> bool:
    """Whether an error is of the drivers' own family, known by name so that nothing is imported for asking."""
    return any(kind.__name__ == "DriverError" and kind.__module__.startswith("drivers") for kind in type(error).__mro__)


def _complain(sentence: str, code: int) -> int:
    text = sentence if sentence.startswith("ugv") else f"ugv: {sentence}"
    print("".join(c if c.isprintable() else " " for c in text), file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
