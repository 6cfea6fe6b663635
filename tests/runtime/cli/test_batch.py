# SPDX-License-Identifier: Apache-2.0
"""Runs in processes of their own, which do not stay behind."""

import subprocess
import sys

BATCH = """
from runtime.cli.batch import in_processes
in_processes(exec, ["import signal; print('begun', flush=True); signal.alarm(600); signal.pause()"], print)
"""


def test_what_a_killed_batch_has_begun_ends_with_it():
    with subprocess.Popen([sys.executable, "-c", BATCH], stdout=subprocess.PIPE, text=True) as batch:
        assert batch.stdout.readline() == "begun\n"
        batch.kill()
        left, _ = batch.communicate(timeout=60.0)  # until none has the pipe any more
        assert left == ""
