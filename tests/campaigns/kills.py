# SPDX-License-Identifier: Apache-2.0
"""Kills control, link and recorder of a walking robot with SIGKILL, at random moments, and starts each again.

While it is under power the robot must stay within its joint limits, the log must lack at most 20 ms, and the process
that was started again must do its work. What is asserted is by content: the times of the kill and of the ticks
are of the same clock.

    python tests/campaigns/kills.py --times 50 [--seed 0]
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from runtime.executors.runtime_directory import runtime_directory
from runtime.recording.log import Log
from runtime.safety.limits import joint_bounds
from runtime.signals import Mode
from sim_bridge.live_processes import LiveProcesses, wired
from sim_bridge.process import Task

ROBOT, SCENARIO = "uslgo1", "circle-6cm"
VICTIMS = ("control", "link", "recorder")
POWERED = (Mode.STANDING, Mode.ACTIVE, Mode.CROUCHING)
LOST_MAX_NS = 20_000_000
BACK_WITHIN_S = 60.0
LONGEST_WALK_S = 0.8


class Kill(NamedTuple):
    """One kill: whose, and when, on the monotonic clock."""

    victim: str
    at_ns: int


class Watch:
    """Follows what the simulator says, in a thread of its own."""

    def __init__(self, answers: Iterator[dict[str, Any]]) -> None:
        self.mode, self.number = "", 0
        self._news = threading.Condition()
        self._answers = answers
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        for answer in self._answers:
            with self._news:
                self.mode, self.number = answer.get("mode", self.mode), self.number + 1
                self._news.notify_all()

    def until(self, mode: Mode, after: int) -> bool:
        """Wait until the robot is said to be in a mode, by an answer after that of a number."""
        with self._news:
            return self._news.wait_for(lambda: self.number > after and self.mode == mode.name, BACK_WITHIN_S)


def campaign(times: int, seed: int, out: Path) -> list[str]:
    """Kill each process so many times; returns what was not as it must be."""
    chance, wrong, kills = random.Random(seed), [], []
    victims = [victim for victim in VICTIMS for _ in range(times)]
    chance.shuffle(victims)
    with runtime_directory() as directory, wired(ROBOT, {}, directory) as (config, buses):
        print(buses, flush=True)
        task = Task("", SCENARIO, seed, str(directory), duration_s=1e6)
        with LiveProcesses(config, task, out) as live:
            watch, seen = Watch(live.answers()), 0
            for number, victim in enumerate(victims):
                if not watch.until(Mode.ACTIVE, seen):
                    wrong.append(f"kill {number}: the robot did not walk {BACK_WITHIN_S:g} s after the kill before")
                    break
                time.sleep(chance.uniform(0.0, LONGEST_WALK_S))
                os.kill(live.processes.pid(victim), signal.SIGKILL)
                kills.append(Kill(victim, time.monotonic_ns()))
                live.processes.stop(victim)
                live.start(victim)
                seen = watch.number + 1
                print(f"{number + 1:4}/{len(victims)} {victim}", flush=True)
            watch.until(Mode.ACTIVE, seen)
            live.stop()
    low, high = joint_bounds(config.safety)
    bags = sorted(path for path in out.iterdir() if path.is_dir())
    return wrong + judge(bags, kills, low, high, config.safety.position_margin_rad)


def judge(bags: list[Path], kills: list[Kill], low: Any, high: Any, margin_rad: float) -> list[str]:
    """What the logs of the campaign show that must not be."""
    wrong, last_ns = [], {"control": [], "recorder": []}
    for bag in bags:
        log = Log(bag)
        mode = log.read_signal("/ugv/safety").values["mode"]
        position = log.read_signal("/ugv/joint_state").values["position"][np.isin(mode, POWERED)]
        beyond = np.maximum(position - high, low - position).max(initial=-np.inf)
        if beyond > margin_rad:
            wrong.append(f"{bag.name}: a joint was {beyond:.3f} rad beyond its limit")
        last_ns["recorder"].append(log.end_ns)
        ticks = log.read_signal("/ugv/tick/wbc").values
        last_ns["control"].append(int(ticks["now_ns"].max()))
        if int(ticks["index"][0]) == 0 and mode[0] not in (Mode.OFF, Mode.STANDBY):
            wrong.append(f"{bag.name}: control started in {Mode(mode[0]).name}")
    for kill in kills:
        if kill.victim not in last_ns:
            continue
        before = [at_ns for at_ns in last_ns[kill.victim] if at_ns <= kill.at_ns]
        lost_ns = kill.at_ns - max(before, default=0)
        if lost_ns > LOST_MAX_NS:
            wrong.append(f"{lost_ns / 1e6:.1f} ms of the log were lost when {kill.victim} was killed")
    return wrong


def main() -> int:
    """Run the campaign; 1 if anything was not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="ugv-kills-") as parent:
        wrong = campaign(options.times, options.seed, Path(parent))
    for sentence in wrong:
        print(sentence)
    print(f"{len(VICTIMS) * options.times} kills, {len(wrong)} findings")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
