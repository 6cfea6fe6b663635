# SPDX-License-Identifier: Apache-2.0
"""Kills each process of a walking robot with SIGKILL, at random phases of the gait, and starts it again.

Without control the drives must let go by themselves, without the link the robot must crouch and be damped, each within
the bound that `make faults-live` has for it, and without the recorder it must walk on; no command that is too old may
reach a drive. The robot must stay within its joint limits until its drives let go, the log must lack at most 20 ms
before the kill, nobody may be driven without power, and the robot must walk again. The simulator is the far end of
everything: with it go all buses and sensors, so that control must end DAMPED by itself; the one that is started again
has the robot stand where the course begins. A stall of the machine that may be the cause is named beside a finding,
which counts anyway.

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
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Mode
from sim_bridge.faults.injector import SILENT, Order
from sim_bridge.faults.live_judge import abused, judged, moved_unarmed, old_commands
from sim_bridge.faults.live_logs import LiveLogs
from sim_bridge.faults.live_row import LINGER_NS
from sim_bridge.faults.live_session import ROBOT, SCENARIO, Episode, frames_in
from sim_bridge.faults.live_table import LIVE_ROWS
from sim_bridge.faults.log_flaws import WHOLE_NS, missing_log
from sim_bridge.live_answers import LiveAnswers
from sim_bridge.live_buses import hub_buses
from sim_bridge.live_processes import LiveProcesses, wired
from sim_bridge.process import Task

VICTIMS = ("control", "link", "recorder", "sim")
WALKS_WITHIN_S, ANSWERS_WITHIN_S = 60.0, 10.0
KILLS_OF_ONE = 40
"""Kills of one robot, whose logs are then judged and thrown away."""
AFTER_NS = 1_500_000_000
"""For how long after the simulator was killed control is looked at."""
EXPECTED = {"control": (SILENT,), "link": (Mode.CROUCHING.name, Mode.DAMPED.name), "recorder": (Mode.ACTIVE.name,)}
"""States in which a robot is told to be after a kill."""
ROWS = {victim: row for row in LIVE_ROWS for victim in EXPECTED if row.name == f"{victim} killed"}
"""What each of these kills is to come to, and how soon."""


class Kill(NamedTuple):
    """One kill, and what came of it beside the log.

    Attributes:
        victim: who was killed.
        at_ns: when, on the monotonic clock.
        findings: what was not as it must be, before the log is looked at.
        episode: what the far end of the wires saw; None without a far end.
    """

    victim: str
    at_ns: int
    findings: tuple[str, ...] = ()
    episode: Episode | None = None


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
            return Kill(victim, at_ns)
        findings = []
        if not self._answers.wait(lambda: self._answers.state in EXPECTED[victim], ANSWERS_WITHIN_S):
            findings.append(f"the robot is {self._answers.state}")
        mended_ns = time.monotonic_ns()
        self._live.restart(victim)
        if victim == "recorder" and not self._answers.wait(self._records, ANSWERS_WITHIN_S):
            findings.append("nothing is recorded any more")
        self._answers.rest(LINGER_NS * 1e-9)
        self._live.order(Order(None))
        if not self._answers.wait_for_more(self._answers.seen, seen, ANSWERS_WITHIN_S):
            return Kill(victim, at_ns, (*findings, "the simulator does not say what it saw"))
        frames, until_ns = frames_in(self._directory), time.monotonic_ns()
        witnessed = self._answers.seen[-1]
        episode = Episode(ROWS[victim], at_ns, mended_ns, until_ns, frames=frames, recorder=None, **witnessed)
        return Kill(victim, at_ns, tuple(findings), episode)

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
    assert isinstance(config, Uslgo1Config)
    return wrong + judge(LiveLogs(out, ()), kills, config)


def judge(logs: LiveLogs, kills: Sequence[Kill], config: Uslgo1Config) -> list[str]:
    """What the logs of one robot show that must not be, and what its drives saw."""
    wrong = moved_unarmed(logs)
    for kill in kills:
        findings = [*kill.findings, *_flaws(kill, logs, config)]
        until_ns = kill.at_ns + AFTER_NS if kill.episode is None else kill.episode.until_ns
        held_up = ROWS[kill.victim].holds_up if kill.victim in ROWS else (kill.victim,)
        stalls = logs.stalls_between(kill.at_ns - WHOLE_NS, kill.at_ns)
        stalls += logs.stalls_between(kill.at_ns, until_ns, held_up)
        longest_ms = max((stall.length_ns for stall in stalls), default=0) / 1e6
        beside = f" (beside a stall of {longest_ms:.0f} ms)" if stalls else ""
        wrong += [f"{kill.victim} killed at {kill.at_ns / 1e9:.3f} s: {finding}{beside}" for finding in findings]
    return wrong


def _flaws(kill: Kill, logs: LiveLogs, config: Uslgo1Config) -> Sequence[str]:
    """What the logs show of one kill; a robot that walks on may come to the end of its lap meanwhile, and stand."""
    episode, period_ns = kill.episode, config.loops.wbc_period_ns
    if episode is None:
        flaws = missing_log(logs, kill.at_ns, kill.at_ns + AFTER_NS, period_ns, breaks_log=True, ticks_on=False)
        return [flaw.says for flaw in flaws] + _not_damped(kill, logs) * (kill.victim == "sim")
    if kill.victim != "recorder":
        return judged(episode, logs, config).flaws
    flaws = missing_log(logs, kill.at_ns, episode.until_ns, period_ns, episode.row.breaks_log)
    flaws += abused(episode, logs, config)
    flaws += old_commands(episode, logs, config.drives.command_age_max_ns)
    return [flaw.says for flaw in flaws]


def _not_damped(kill: Kill, logs: LiveLogs) -> list[str]:
    """Whether control is not damped at the end of what followed."""
    modes = logs.between(topics.SAFETY, kill.at_ns, kill.at_ns + AFTER_NS).values["mode"]
    damped = len(modes) > 0 and modes[-1] == Mode.DAMPED
    return [] if damped else ["control did not end DAMPED without its buses"]


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
