# SPDX-License-Identifier: Apache-2.0
"""A robot's processes in one session, without a service manager: they are kept running as deploy/systemd keeps them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from runtime.executors.processes import ProcessError, Processes
from runtime.executors.supervisor import Service, Supervisor

LOOK_S = 0.1


def services(command: Sequence[str]) -> tuple[Service, ...]:
    """Recorder, link and control, in the order in which they start, with the times of their units.

    Args:
        command: that runs one of them, but for its name.
    """
    return (
        Service("recorder", [*command, "recorder"], 60.0, 5.0, pause_s=0.2, starts=60, within_s=300.0),
        Service("link", [*command, "link"], 60.0, 2.0, pause_s=1.0, starts=10, within_s=60.0),
        Service("control", [*command, "control"], 300.0, 2.0, pause_s=1.0, starts=5, within_s=60.0),
    )


def run_session(command: Sequence[str], told: Callable[[], bool], say: Callable[[str], None]) -> None:
    """Keep the processes running until told to stop; without recorder or link the robot goes on as well as it can.

    Args:
        command: as of `services`.
        told: whether they are to stop; asked now and then.
        say: told what happens, a sentence at a time.

    Raises:
        ProcessError: if control ended too often.
    """
    with Processes() as processes:
        supervisor = Supervisor(services(command), processes, say)
        try:
            while not told():
                time.sleep(LOOK_S)
                supervisor.look(time.monotonic())
                if "control" in supervisor.given_up:
                    raise ProcessError("the process control ended too often; the others are stopped")
        finally:
            supervisor.stop()
