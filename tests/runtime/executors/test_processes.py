# SPDX-License-Identifier: Apache-2.0
"""Processes that belong together end together, and one that ends by itself is missed."""

import os
import select
import signal
import subprocess
import sys

import pytest

from runtime.executors.processes import ProcessError, Processes

READY = """
import os, signal, socket
address = os.environ["NOTIFY_SOCKET"]
socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).sendto(b"READY=1", "\\0" + address[1:])
"""
WAIT = "signal.pause()"
STUBBORN = "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"


def python(code):
    return [sys.executable, "-c", code]


def is_there(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def ends(handle):
    """Whether the process behind a pidfd ends."""
    try:
        return bool(select.select([handle], [], [], 30.0)[0])
    finally:
        os.close(handle)


def test_a_process_is_waited_for_and_stopped():
    with Processes() as processes:
        processes.start("one", python(READY + WAIT))
        processes.wait_ready("one")
        pid = processes.pid("one")
        assert processes.resources()["one"].resident_bytes > 1_000_000
        processes.check()
    assert not is_there(pid)


def test_what_ends_by_itself_is_named():
    with Processes() as processes:
        processes.start("brief", python("import sys; sys.exit(3)"))
        with pytest.raises(ProcessError, match="the process brief ended with code 3"):
            processes.wait_ready("brief")


def test_what_does_not_end_is_killed():
    with Processes() as processes:
        processes.start("stubborn", python("import signal\n" + STUBBORN + READY + WAIT))
        processes.wait_ready("stubborn")
        assert processes.stop("stubborn", within_s=0.1) == -signal.SIGKILL


def test_nothing_that_a_process_started_outlives_it():
    child = "import subprocess, sys\n"
    child += "one = subprocess.Popen([sys.executable, '-c', 'import signal; signal.pause()'])\n"
    child += "print(one.pid, flush=True)\n"
    with Processes() as processes:
        process = processes.start("parent", python(child + READY + WAIT), piped=True)
        grandchild = int(process.stdout.readline())
        processes.wait_ready("parent")
        waiting = os.pidfd_open(grandchild)
        processes.stop("parent")
    assert ends(waiting)


def test_the_death_of_the_one_who_started_them_ends_them():
    code = "import sys; from runtime.executors.processes import Processes\n"
    code += f"with Processes() as p:\n    p.start('one', {python(READY + WAIT)!r}); p.wait_ready('one')\n"
    code += "    print(p.pid('one'), flush=True)\n    import signal; signal.pause()"
    with subprocess.Popen(python(code), stdout=subprocess.PIPE) as parent:
        pid = int(parent.stdout.readline())
        waiting = os.pidfd_open(pid)
        parent.kill()
    assert ends(waiting)
