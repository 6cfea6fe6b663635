# SPDX-License-Identifier: Apache-2.0
"""Whether the kernel lets the loops run first, keep their memory, and be woken on time."""

from __future__ import annotations

import grp
import os
import platform
import resource
import stat
import subprocess
import threading
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from runtime.cli.fitness.finding import Finding, fail, ok, warn
from runtime.executors.linux import LATENCY_REQUEST, run_first

UNIT, GROUP = "ugv-control.service", "ugv"
LIMITS = "add yourself to the group ugv and log in again, or run the robot by its units, which have limits of their own"
FEW_PROCESSORS = 4
THROTTLED_SHARE = 0.9
"""Below this share of a period, real-time threads that need it are held back."""
_PATIENCE_S = 3


class Limits(NamedTuple):
    """What a process may ask for.

    Attributes:
        whose: they are.
        priority: highest under SCHED_FIFO.
        locked_memory_bytes: most memory that it may lock; -1 for any.
    """

    whose: str
    priority: int
    locked_memory_bytes: int


def read_own_limits() -> Limits:
    """Those of the present process."""
    if os.geteuid() == 0:
        return Limits("root", 99, -1)
    priority, memory = (resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK))
    return Limits("you", 99 if priority == resource.RLIM_INFINITY else priority, memory)


def read_unit_limits() -> Limits | None:
    """Those of the installed unit; None if there is none."""
    command = ["systemctl", "show", UNIT, "--property=LoadState,LimitRTPRIO,LimitMEMLOCK"]
    try:
        told = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=True).stdout
    except (OSError, subprocess.SubprocessError):
        return None
    return unit_limits(dict(line.split("=", 1) for line in told.splitlines() if "=" in line))


def unit_limits(shown: Mapping[str, str]) -> Limits | None:
    """The limits in what `systemctl show` has told of a unit."""
    if shown.get("LoadState") != "loaded":
        return None
    priority, memory = (shown.get(name, "0") for name in ("LimitRTPRIO", "LimitMEMLOCK"))
    return Limits(UNIT, 99 if priority == "infinity" else int(priority), -1 if memory == "infinity" else int(memory))


def try_priority(priority: int) -> str:
    """Run a thread under SCHED_FIFO for a moment; returns why that was refused, or nothing."""
    answers: list[str] = []
    thread = threading.Thread(target=lambda: answers.append(run_first(priority)))
    thread.start()
    thread.join()
    return answers[0]


def check_priority(wanted: int, refusal: str, own: Limits, unit: Limits | None) -> Finding:
    """The fastest loop's priority is granted, to whom it is tried with and to the unit."""
    name = "real-time priority"
    if refusal and own.priority >= wanted:
        return fail(
            name,
            f"SCHED_FIFO is refused to {own.whose} within its limit: this control group has no real-time share",
            "run outside the group, or give it a share (cpu.rt_runtime_us), or boot with rt_group_sched=0",
        )
    if unit is not None:
        if unit.priority < wanted:
            sentence = f"{unit.whose} may ask for priority {unit.priority}, and the loops want {wanted}"
            return fail(name, sentence, f"set LimitRTPRIO={wanted} in a drop-in of the unit")
        return ok(name, f"{unit.whose} may ask for priority {unit.priority}; the loops want {wanted}")
    if refusal:
        return fail(name, f"SCHED_FIFO at priority {wanted} is refused to {own.whose}", LIMITS)
    return ok(name, f"SCHED_FIFO at priority {wanted} is granted to {own.whose}")


def check_memory(own: Limits, unit: Limits | None) -> Finding:
    """All memory may be locked."""
    limits = unit or own
    if limits.locked_memory_bytes < 0:
        return ok("locked memory", f"{limits.whose} may lock all memory")
    kibibytes = limits.locked_memory_bytes // 1024
    sentence = f"{limits.whose} may lock {kibibytes} KiB only, so page faults would delay loops"
    remedy = "set LimitMEMLOCK=infinity in a drop-in of the unit" if unit else LIMITS
    return fail("locked memory", sentence, remedy)


def read_throttling() -> tuple[int, int]:
    """How much of which period real-time threads may run, us; a share of -1 is all of it."""
    shares = [int(Path(f"/proc/sys/kernel/sched_rt_{part}_us").read_text()) for part in ("runtime", "period")]
    return shares[0], shares[1]


def check_throttling(runtime_us: int, period_us: int) -> Finding:
    """Real-time threads are not held back."""
    name = "real-time throttling"
    if runtime_us < 0:
        return ok(name, "real-time threads are never held back")
    share = runtime_us / period_us
    remedy = "sysctl kernel.sched_rt_runtime_us=950000"
    if share == 0.0:
        return fail(name, "real-time threads get no time at all", remedy)
    if share < THROTTLED_SHARE:
        return warn(name, f"real-time threads get {share:.0%} of the time", remedy)
    return ok(name, f"real-time threads get {share:.0%} of the time")


def read_preemption() -> bool:
    """Whether the kernel is a PREEMPT_RT one."""
    flag = Path("/sys/kernel/realtime")
    return "PREEMPT_RT" in platform.version() or (flag.is_file() and flag.read_text().strip() == "1")


def check_preemption(real_time: bool) -> Finding:
    """The kernel lets itself be interrupted."""
    if real_time:
        return ok("kernel preemption", "PREEMPT_RT")
    return warn(
        "kernel preemption",
        "the kernel is not PREEMPT_RT, so single ticks may be late by milliseconds",
        "use a PREEMPT_RT kernel (on a Jetson: the package of real-time kernels), and look at ugv bench rt",
    )


def read_governors() -> frozenset[str]:
    """How the processors choose their clock rates; empty if they do not."""
    files = Path("/sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor")
    return frozenset(file.read_text().strip() for file in files)


def check_governors(governors: Collection[str]) -> Finding:
    """Processors do not have to speed up first."""
    slow = sorted(set(governors) - {"performance"})
    if slow:
        return warn(
            "processor clock",
            f"processors change their clock rates ({', '.join(slow)}), which delays ticks",
            "cpupower frequency-set -g performance (on a Jetson: nvpmodel -m 0, then jetson_clocks)",
        )
    return ok("processor clock", "constant" if governors else "not changed by the kernel")


def may_request(unit: Limits | None, request: Path = LATENCY_REQUEST) -> bool | None:
    """Whether the unit, or without one this process, may say how soon processors must wake; None if nobody can."""
    try:
        status = request.stat()
    except OSError:
        return None
    if unit is None:
        return os.access(request, os.W_OK)
    with suppress(KeyError):
        return bool(status.st_mode & stat.S_IWGRP) and grp.getgrgid(status.st_gid).gr_name == GROUP
    return False


def check_request(whose: str, granted: bool | None) -> Finding:
    """Control may keep processors from sleeping so deeply that they wake late."""
    name = "idle processors"
    if granted is None:
        return ok(name, f"this kernel takes no request about them: there is no {LATENCY_REQUEST}")
    if granted:
        return ok(name, f"{whose} may keep them from sleeping deeply")
    return warn(
        name,
        f"{whose} may not write to {LATENCY_REQUEST}, so they sleep deeply between ticks, and wake late",
        "udevadm control --reload; udevadm trigger --name-match=cpu_dma_latency (the installer brings the rule for it)",
    )


def check_processors(online: Collection[int], wanted: Sequence[int]) -> Finding:
    """Those that the configuration names exist, and there are enough of them."""
    name = "processors"
    missing = sorted(set(wanted) - set(online))
    if missing:
        sentence = f"the configuration wants processors {missing}, and there are {sorted(online)}"
        return fail(name, sentence, "name others in realtime.control_processors and realtime.link_processors")
    if len(online) < FEW_PROCESSORS:
        sentence = f"{len(online)} for two loops, the link, the recorder and the rest of the system"
        return warn(name, sentence, f"use a computer with {FEW_PROCESSORS} or more")
    return ok(name, f"{len(online)}")
