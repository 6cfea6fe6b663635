# SPDX-License-Identifier: Apache-2.0
"""`make fuzz`: every target of `fuzz_targets.py` under atheris for some seconds, guided by the coverage of its modules.

Inputs that raise anything but errors of ours, take longer than ten seconds or more memory than allowed are failures.
They are kept in `.fuzz/`, and `campaign.py --again FILE TARGET` decodes one once more.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path

KEPT = Path(".fuzz")
SECONDS_AN_INPUT, MEMORY_MB, LONGEST = 10, 1024, 1 << 17
TOLD = 4000


def main() -> int:
    """Fuzz, or decode one input; returns the exit code."""
    parser = argparse.ArgumentParser(description="Fuzz every decoder that faces a wire or a file.")
    parser.add_argument("targets", nargs="*", help="names (default: all)")
    parser.add_argument("--seconds", type=int, default=20, help="for each target (default 20)")
    parser.add_argument("--again", type=Path, metavar="FILE", help="decode this input and end")
    parser.add_argument(
        "--run", type=Path, metavar="DIR", help="a recorded run to take seeds from (default: a new one)"
    )
    options = parser.parse_args()
    from fuzz_targets import TARGETS

    by_name = {target.name: target for target in TARGETS}
    chosen = [by_name[name] for name in options.targets or by_name]
    if options.again is not None:
        for target in chosen:
            target.decode(options.again.read_bytes())
        return 0
    failed = []
    with tempfile.TemporaryDirectory(prefix="ugv-fuzz-") as scratch:
        run = recorded_apart(Path(scratch) / "run") if options.run is None else options.run
        for target in chosen:
            corpus = Path(scratch) / target.name
            corpus.mkdir()
            sow(target, run, corpus)
            seeds = len(list(corpus.iterdir()))
            done = fuzz(target.name, target.modules, corpus, options.seconds)
            tried = executed(done.stdout)
            print(f"{target.name}: {seeds} seeds, {tried or 'no'} inputs", flush=True)
            if done.returncode != 0 or not tried:
                failed.append(target.name)
                print(done.stdout[-TOLD:])
    print(f"{len(chosen) - len(failed)} of {len(chosen)} targets without a failure", *failed, sep="\n  failed: ")
    return 1 if failed else 0


def recorded_apart(directory: Path) -> Path:
    """The same by another process: the most memory that this one ever held is counted as a fuzzer's that it starts."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(recorded, directory).result()


def recorded(directory: Path) -> Path:
    """A second and a half of a real run."""
    from runtime.cli.sil import simulate

    directory.mkdir()
    simulate("uslgo1", "flat", out=directory, until_s=1.5)
    return directory


def sow(target, run: Path, corpus: Path) -> None:  # type: ignore[no-untyped-def]
    """Write the seeds of a target as files."""
    from runtime.recording.log import Log

    for number, seed in enumerate([*target.seeds(), *target.of_run(Log(run))]):
        (corpus / f"seed-{number}").write_bytes(seed)


def fuzz(name: str, modules: tuple[str, ...], corpus: Path, seconds: int) -> subprocess.CompletedProcess[str]:
    """Fuzz one target in a process of its own."""
    KEPT.mkdir(exist_ok=True)
    limits = [
        f"-max_total_time={seconds}",
        f"-timeout={SECONDS_AN_INPUT}",
        f"-rss_limit_mb={MEMORY_MB}",
        f"-max_len={LONGEST}",
        f"-artifact_prefix={KEPT}/{name}-",
        "-print_final_stats=1",
        "-verbosity=0",
    ]
    program = f"from campaign import under_atheris; under_atheris({name!r}, {modules!r})"
    command = [sys.executable, "-c", program, str(corpus), *limits]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(Path(__file__).parent), str(Path.cwd())))}
    environment["NUMBA_DISABLE_JIT"] = "1"  # what is instrumented cannot be compiled
    from fuzz_target import memory

    with tempfile.TemporaryDirectory(prefix="ugv-fuzz-", dir=memory()) as room:  # it ends without tidying up
        environment["TMPDIR"] = room
        return subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def executed(told: str) -> int:
    """How many inputs were decoded, by the closing words of a fuzzer; 0 if it did not get to them."""
    found = re.search(r"number_of_executed_units: *(\d+)", told)
    return int(found[1]) if found else 0


def under_atheris(name: str, modules: tuple[str, ...]) -> None:
    """Decode what atheris makes up until it has had enough; ends the process."""
    import atheris

    with atheris.instrument_imports(include=list(modules)):
        from fuzz_target import OURS
        from fuzz_targets import TARGETS
    target = next(target for target in TARGETS if target.name == name)

    def one(data: bytes) -> None:
        with suppress(*OURS):
            target.decode(data)

    for seed in target.seeds():  # so that no input's time contains an import or a compilation
        one(seed)
    atheris.Setup(sys.argv, one)
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
