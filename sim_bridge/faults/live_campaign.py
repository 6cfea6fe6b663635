# SPDX-License-Identifier: Apache-2.0
"""The faults in real time, each until a trial shows something: what a stall of the machine spoils is tried again."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from runtime.robots import load_configuration
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.faults import stage
from sim_bridge.faults.live_judge import Verdict, judged, moved_unarmed
from sim_bridge.faults.live_logs import LiveLogs
from sim_bridge.faults.live_row import LiveRow, Need
from sim_bridge.faults.live_session import ROBOT, disk, play

TRIES = 5


class Campaign(NamedTuple):
    """What came of it.

    Attributes:
        verdicts: by row, of every trial, also of those that show nothing.
        untried: names of rows that could not be tried, with the reason.
        flaws: of whole logs.
    """

    verdicts: dict[str, list[Verdict]]
    untried: dict[str, str]
    flaws: list[str]

    def shown(self, name: str) -> list[Verdict]:
        """Trials of a row that show something."""
        return [verdict for verdict in self.verdicts[name] if not verdict.shows_nothing]


def campaign(
    rows: Sequence[LiveRow], phases: int, seed: int, out: Path | None, told: Callable[[str], None]
) -> Campaign:
    """Try every fault at some phases of the gait.

    Args:
        rows: the faults.
        phases: trials of each that show something.
        seed: of the phases, and of what the faults leave to chance.
        out: directory in which each robot's logs are kept, if they are to be.
        told: told each trial as it is done.
    """
    done = Campaign({row.name: [] for row in rows}, {}, [])
    configurations = list(dict.fromkeys(tuple(row.settings.items()) for row in rows))
    for session in range(phases * TRIES * len(configurations)):
        settings = dict(configurations[session % len(configurations)])
        left = [
            row
            for row in rows
            if row.settings == settings and row.name not in done.untried and len(done.shown(row.name)) < phases
        ]
        if not left:
            continue
        with tempfile.TemporaryDirectory(prefix="ugv-faults-") as passing:
            logs = Path(passing) / f"robot-{session}"
            logs.mkdir()
            with disk(logs) as has_disk:
                granted = {Need.DISK: has_disk, Need.CLOCK: stage.clock_may_be_set()}
                _session(left, seed + session, logs, granted, told, done)
                if out is not None:
                    shutil.copytree(logs, out / logs.name)
    return done


def _session(
    rows: Sequence[LiveRow],
    seed: int,
    logs: Path,
    granted: Mapping[Need, bool],
    told: Callable[[str], None],
    done: Campaign,
) -> None:
    done.untried.update((row.name, row.needs.value) for row in rows if row.needs and not granted[row.needs])
    possible = [row for row in rows if row.name not in done.untried]
    if not possible:
        return
    episodes = play(possible, seed, logs, told)
    config = load_configuration(ROBOT, possible[0].settings)
    assert isinstance(config, Uslgo1Config)
    read = LiveLogs(logs, {row.counted[0] for row in possible if row.counted is not None})
    for episode in episodes:
        done.verdicts[episode.row.name].append(judged(episode, read, config))
    done.flaws.extend(moved_unarmed(read))
