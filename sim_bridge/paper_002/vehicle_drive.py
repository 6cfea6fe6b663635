# SPDX-License-Identifier: Apache-2.0
"""One drive of the simulated vehicle, and of some drives the way that it took."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.recording.log import Log
from runtime.recording.metrics import first_motion, project
from runtime.robots import topics
from runtime.tracking.polyline import Polyline
from sim_bridge.paper_002.contenders import OURS, PAPERS, PLAIN, ROBOT
from sim_bridge.paper_002.plants import WORST
from sim_bridge.paper_002.trial import STRAIGHT
from sim_bridge.paper_002.vehicle import Drive, Summary, settings_of
from sim_bridge.run import run_scenario
from sim_bridge.vehicle_courses import scenario

Array = npt.NDArray[np.float64]
SHOWN_SCENARIOS, SHOWN_CONTENDERS, SHOWN_SEED = (STRAIGHT, "curve-s"), (PLAIN, PAPERS, OURS), 0
KEPT_EVERY = 10
"""Samples of the true pose from one that is kept to the next."""


class Track(NamedTuple):
    """The way that the vehicle's centre took, from its first motion on.

    Attributes:
        t: s.
        xy: (n, 2), m.
        lateral_m: signed distance to the path.
    """

    t: Array
    xy: Array
    lateral_m: Array


class Driven(NamedTuple):
    """What came of a drive; its track if it is one of those that are shown."""

    drive: Drive
    summary: Summary
    track: Track | None = None


def is_shown(drive: Drive) -> bool:
    """Whether its track is to be kept."""
    chosen = drive.scenario in SHOWN_SCENARIOS and drive.contender in SHOWN_CONTENDERS
    return chosen and drive.plant == WORST and drive.seed == SHOWN_SEED


def driven(drive: Drive) -> Driven:
    """Drive it."""
    with TemporaryDirectory(prefix="ugv-paper-002-") as parent:
        out = Path(parent) / "run" if is_shown(drive) else None
        summary = run_scenario(
            ROBOT,
            drive.scenario,
            seed=drive.seed,
            controller=drive.contender.controller,
            overrides=settings_of(drive),
            out=out,
        )
        return Driven(drive, summary, None if out is None else _track(Log(out), drive.scenario))


def _track(log: Log, course: str) -> Track:
    signal, followed = log.read_signal(topics.TRUTH), scenario(course)
    xy = signal.values["position"][::KEPT_EVERY, :2].astype(np.float64)
    t = (signal.log_ns[::KEPT_EVERY] - signal.log_ns[0]) * 1e-9
    begin = first_motion(xy[:, 0], xy[:, 1]) or 0
    t, xy = t[begin:] - t[begin], xy[begin:]
    seen = project(xy[:, 0], xy[:, 1], np.zeros(len(t)), Polyline(followed.waypoints, followed.closed))
    return Track(t, xy, np.copysign(seen.distance, seen.lateral_error))
