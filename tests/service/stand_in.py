# SPDX-License-Identifier: Apache-2.0
"""Stands in for a process of the robot: tries what its unit allows it, tells the test, and feeds its watchdog."""

import errno
import json
import os
import resource
import signal
import socket
import sys
import threading
from pathlib import Path

from runtime.executors.linux import LATENCY_REQUEST, lock_memory, run_first

PROBE = "/run/ugv/probe.sock"
WRITABLE = ("/run/ugv", "/var/cache/ugv", "/var/log/ugv", "/opt/ugv", "/etc/ugv", "/var/lib", "/usr", "/run", "/home")
FAMILIES = {
    **dict.fromkeys(("AF_UNIX", "AF_INET", "AF_INET6", "AF_NETLINK", "AF_PACKET"), (socket.SOCK_DGRAM, 0)),
    "AF_CAN": (socket.SOCK_RAW, socket.CAN_RAW),
}
"""Type and protocol of a socket of each."""
NO_TYPE = 15
"""Of a socket. The kernel refuses it before it looks whether it has the family."""
WATCHDOG_S = 0.2


def notify(state: str) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.sendto(state.encode(), os.environ["NOTIFY_SOCKET"].replace("@", "\0", 1))


def in_a_thread(function, *arguments):
    """The answer of a call that changes its thread for good."""
    answers = []
    thread = threading.Thread(target=lambda: answers.append(function(*arguments)))
    thread.start()
    thread.join()
    return answers[0]


def allowed(action) -> bool:
    try:
        action()
    except OSError:
        return False
    return True


def facts(process: str) -> dict:
    status = dict(line.split(":\t", 1) for line in Path("/proc/self/status").read_text().splitlines() if ":\t" in line)
    return {
        "process": process,
        "pid": os.getpid(),
        "arguments": sys.argv[1:],
        "user": os.getuid(),
        "capabilities": int(status["CapEff"], 16) | int(status["CapBnd"], 16),
        "fifo": [priority for priority in (20, 40, 60, 80, 90, 91) if not in_a_thread(run_first, priority)],
        "memory": lock_memory(),
        "device": LATENCY_REQUEST.exists(),
        "cores": resource.getrlimit(resource.RLIMIT_CORE)[0],
        "opened": [name for name in FAMILIES if allowed(lambda name=name: open_socket(name))],
        "let_by": [name for name in FAMILIES if let_by(name)],
        "writable": [place for place in WRITABLE if allowed(lambda place=place: touch(place))],
        "environment": {key: os.environ.get(key) for key in ("RUNTIME_DIRECTORY", "LOGS_DIRECTORY", "UGV_CACHE_DIR")},
    }


def open_socket(name: str) -> None:
    socket.socket(getattr(socket, name), *FAMILIES[name]).close()


def let_by(name: str) -> bool:
    """Whether the unit lets a call come to the kernel; others it answers as a kernel without the family would."""
    try:
        socket.socket(getattr(socket, name), NO_TYPE).close()
    except OSError as error:
        return error.errno == errno.EINVAL
    return True


def touch(directory: str) -> None:
    file = Path(directory) / f"touched-by-{os.getpid()}"
    file.touch()
    file.unlink()


if __name__ == "__main__":
    process = sys.argv[sys.argv.index("--process") + 1]
    told = json.dumps(facts(process)).encode()
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
    notify("READY=1")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
        probe.sendto(told, PROBE)
    while signal.sigtimedwait([signal.SIGTERM], WATCHDOG_S) is None:
        notify("WATCHDOG=1")
