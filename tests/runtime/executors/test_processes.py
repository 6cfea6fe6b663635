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


def killed_parent_of(child, orphaned_for_s):
    """A handle of a process whose starter is killed."""
    code = "import signal; from runtime.executors.processes import Processes\n"
    code += f"with Processes({orphaned_for_s}) as p:\n    p.start('one', {python(child)!r}); p.wait_ready('one')\n"
    code += "    print(p.pid('one'), flush=True)\n    signal.pause()"
    with subprocess.Popen(python(code), stdout=subprocess.PIPE) as parent:
        waiting = os.pidfd_open(int(parent.stdout.readline()))
        parent.kill()
    return waiting


def test_the_death_of_the_one_who_started_them_ends_them():
    assert ends(killed_parent_of(READY + WAIT, orphaned_for_s=3600.0))


def test_what_does_not_end_with_the_one_who_started_it_is_killed():
    stubborn = "import signal\n" + STUBBORN + READY + "while True:\n    signal.pause()"
    assert ends(killed_parent_of(stubborn, orphaned_for_s=0.1))


def test_one_that_was_started_by_a_process_now_gone_does_not_begin():
    code = "import os, signal; from runtime.executors.orphans import end_with_parent\n"
    code += "signal.signal(signal.SIGTERM, lambda *_: None)  # as the one who starts it may have it\n"
    code += "somebody_else = os.getpid()\nend_with_parent(somebody_else)\nprint('begun')"
    brief = subprocess.run(python(code), capture_output=True)
    assert (brief.returncode, brief.stdout) == (-signal.SIGTERM, b"")
