# SPDX-License-Identifier: Apache-2.0
"""Kills each process of a walking robot with SIGKILL, at random phases of the gait, and starts it again.

The robot must stay within its joint limits until its drives let go, the log must lack at most 20 ms before the kill,
nobody may be driven without power, and the robot must walk again. The simulator is the far end of everything: with it
go all buses and sensors, so that control must end DAMPED by itself; the one that is started again has the robot stand
where the course begins. A stall of the machine that may be the cause is named beside a finding, which counts anyway.

    python tests/campaigns/kills.py --times 50 [--seed 0] [--victims control link recorder sim]
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from runtime.executors.runtime_directory import runtime_directory
from runtime.recording.recorder_status import read_status
from runtime.robots import topics
from runtime.signals import Mode
from sim_bridge.faults.injector import SILENT, Order
from sim_bridge.faults.live_judge import moved_unarmed
from sim_bridge.faults.live_logs import LiveLogs
from sim_bridge.faults.live_session import ROBOT, SCENARIO
from sim_bridge.faults.log_flaws import LOST_MAX_NS
from sim_bridge.live_answers import LiveAnswers
from sim_bridge.live_buses import hub_buses
from sim_bridge.live_processes import LiveProcesses, wired
from sim_bridge.process import Task

VICTIMS = ("control", "link", "recorder", "sim")
WALKS_WITHIN_S, ANSWERS_WITHIN_S = 60.0, 10.0
KILLS_OF_ONE = 40
"""Kills of one robot, whose logs are then judged and thrown away."""
BEFORE_NS, AFTER_NS = 400_000_000, 1_500_000_000
EXPECTED = {"control": (SILENT,), "link": (Mode.CROUCHING.name, Mode.DAMPED.name), "recorder": (Mode.ACTIVE.name,)}
"""States in which a robot is told to be after a kill."""


class Kill(NamedTuple):
    """One kill: whose, when (on the monotonic clock), and what was not as it must be, before the log is looked at."""

    victim: str
    at_ns: int
    findings: tuple[str, ...]


class Arena:
    """One robot that walks, and whose processes are killed."""

    def __init__(self, live: LiveProcesses, directory: Path, seed: int) -> None:
        self._live, self._directory, self._seed = live, directory, seed
        self._answers = LiveAnswers(live.answers())
        self._kills = self._killed_ns = 0

    def walks_again(self) -> bool:
        """Wait until the robot walks."""
        struck = len(self._answers.struck)
        self._live.order(Order("", self._seed))
        return self._answers.wait_for_more(self._answers.struck, struck, WALKS_WITHIN_S)

    def strike(self, victim: str) -> Kill | None:
        """Kill one process of the robot as soon as it walks, at a random phase; None if it never walks."""
        struck, seen = len(self._answers.struck), len(self._answers.seen)
        self._kills += 1
        self._live.order(Order(victim, self._seed + self._kills))
        if not self._answers.wait_for_more(self._answers.struck, struck, WALKS_WITHIN_S):
            return None
        at_ns = self._killed_ns = time.monotonic_ns()
        os.kill(self._live.processes.pid(victim), signal.SIGKILL)
        if victim == "sim":
            self._answers.wait(lambda: bool(self._answers.ended), ANSWERS_WITHIN_S)
            self._live.start_simulator()
            self._answers = LiveAnswers(self._live.answers())
            return Kill(victim, at_ns, ())
        findings = []
        if not self._answers.wait(lambda: self._answers.state in EXPECTED[victim], ANSWERS_WITHIN_S):
            findings.append(f"the robot is {self._answers.state}")
        self._live.restart(victim)
        if victim == "recorder" and not self._answers.wait(self._records, ANSWERS_WITHIN_S):
            findings.append("nothing is recorded any more")
        self._live.order(Order(None))
        if self._answers.wait_for_more(self._answers.seen, seen, ANSWERS_WITHIN_S):
            witnessed = self._answers.seen[-1]
            findings += ["a joint passed its limits"] * (not witnessed["joints_kept"])
            findings += ["the robot fell before it was damped"] * witnessed["fell"]
            findings += ["the drives never let go"] * (victim != "recorder" and witnessed["released_ns"] is None)
        else:
            findings.append("the simulator does not say what it saw")
        return Kill(victim, at_ns, tuple(findings))

    def _records(self) -> bool:
        """Whether the recorder that runs now says that it records; of one that was killed an old word is left."""
        status = read_status(self._directory)
        return status is not None and bool(status.recording) and status.updated_ns > self._killed_ns


def campaign(victims: Sequence[str], seed: int, out: Path) -> list[str]:
    """Kill one process after the other, then judge the logs; returns what was not as it must be."""
    kills, wrong = [], []
    with runtime_directory() as directory, wired(ROBOT, {}, directory, hub_buses) as (config, _):
        task = Task("", SCENARIO, seed, str(directory), duration_s=1e6, injects=True)
        with LiveProcesses(config, task, out) as live:
            arena = Arena(live, directory, seed)
            for number, victim in enumerate(victims, start=1):
                kill = arena.strike(victim)
                if kill is None:
                    wrong.append(f"the robot does not walk within {WALKS_WITHIN_S:g} s after kill {number - 1}")
                    break
                kills.append(kill)
                print(f"{number:4}/{len(victims)} {victim}", flush=True)
            else:
                if not arena.walks_again():
                    wrong.append(f"the robot does not walk within {WALKS_WITHIN_S:g} s after the last kill")
            live.stop()
    return wrong + judge(out, kills)


def judge(directory: Path, kills: Sequence[Kill]) -> list[str]:
    """What the logs of one robot show that must not be."""
    logs = LiveLogs(directory, ())
    wrong = moved_unarmed(logs)
    for kill in kills:
        findings = list(kill.findings)
        ticks = logs.ticks(kill.at_ns - BEFORE_NS, kill.at_ns)
        lost_ns = kill.at_ns - int(ticks["now_ns"].max(initial=kill.at_ns - BEFORE_NS))
        if lost_ns > LOST_MAX_NS:
            findings.append(f"{lost_ns / 1e6:.1f} ms of the log were lost")
        if kill.victim == "sim":
            modes = logs.between(topics.SAFETY, kill.at_ns, kill.at_ns + AFTER_NS).values["mode"]
            if not len(modes) or modes[-1] != Mode.DAMPED:
                findings.append("control did not end DAMPED without its buses")
        stalls = logs.stalls_between(kill.at_ns - BEFORE_NS, kill.at_ns + BEFORE_NS, (kill.victim,))
        longest_ms = max((stall.length_ns for stall in stalls), default=0) / 1e6
        beside = f" (beside a stall of {longest_ms:.0f} ms)" if stalls else ""
        wrong += [f"{kill.victim} killed at {kill.at_ns / 1e9:.3f} s: {finding}{beside}" for finding in findings]
    return wrong


def main() -> int:
    """Run the campaign; 1 if anything was not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=5, help="kills of each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--victims", nargs="+", choices=VICTIMS, default=VICTIMS)
    options = parser.parse_args()
    victims = [victim for victim in options.victims for _ in range(options.times)]
    random.Random(options.seed).shuffle(victims)
    began_s = time.monotonic()
    wrong = []
    for begin in range(0, len(victims), KILLS_OF_ONE):
        with tempfile.TemporaryDirectory(prefix="ugv-kills-") as parent:
            wrong += campaign(victims[begin : begin + KILLS_OF_ONE], options.seed + begin, Path(parent))
    for sentence in wrong:
        print(sentence)
    print(f"{len(victims)} kills in {time.monotonic() - began_s:.0f} s, {len(wrong)} findings")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
