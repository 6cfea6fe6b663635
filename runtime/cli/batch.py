# SPDX-License-Identifier: Apache-2.0
"""Many scenarios, one process each at a time per processor; the outcome does not depend on how many there are."""

from __future__ import annotations

import concurrent.futures
import concurrent.futures.process
import multiprocessing
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from runtime.cli.console import ReportProgress
from runtime.cli.sil import simulate
from runtime.errors import UgvError
from runtime.executors.orphans import end_with_parent

Summary = dict[str, Any]
Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Job:
    """One run of one scenario, its arguments as those of `ugv sil`."""

    scenario: str
    seed: int = 0
    estimator: str | None = None
    controller: str | None = None
    overrides: Mapping[str, str] = field(default_factory=dict)
    robot: str = "uslgo1"


class BatchError(UgvError):
    """A run of a batch ended without an outcome."""


def run_job(job: Job) -> Summary:
    """Run one scenario without writing it, and return its summary."""
    return simulate(
        job.robot,
        job.scenario,
        seed=job.seed,
        estimator=job.estimator,
        controller=job.controller,
        overrides=dict(job.overrides),
    )


def run_jobs(jobs: Sequence[Job], progress: ReportProgress) -> list[Summary]:
    """Run all, and return their summaries in the order of the jobs."""
    return in_processes(run_job, jobs, progress)


def in_processes(run: Callable[[Item], Result], items: Sequence[Item], progress: ReportProgress) -> list[Result]:
    """Call a function of a module with each item, and return the results in the order of the items."""
    context = multiprocessing.get_context("spawn")
    workers = min(len(items), os.cpu_count() or 1)
    with concurrent.futures.ProcessPoolExecutor(workers, context, end_with_parent, (os.getpid(),)) as pool:
        running = [pool.submit(run, item) for item in items]
        try:
            for done, _ in enumerate(concurrent.futures.as_completed(running), start=1):
                progress(done, len(items))
            return [one.result() for one in running]
        except concurrent.futures.process.BrokenProcessPool:
            raise BatchError("a run's process was killed, by the system for lack of memory or by hand") from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
