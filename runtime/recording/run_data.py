# SPDX-License-Identifier: Apache-2.0
"""What the report needs of a run: its signals as arrays, and the true pose against the path."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.executors.tick import TICK_TOPIC_PREFIX
from runtime.recording import setup
from runtime.recording.errors import LogError
from runtime.recording.log import Log, Signal
from runtime.recording.loop_timing import DescribedLoop, LoopTimes, described_loops, loop_times
from runtime.recording.metrics import Projection, project
from runtime.tracking.errors import PathError
from runtime.tracking.sections import SectionedPath

Array = npt.NDArray[np.float64]

TRUTH, BODY_STATE, BODY_COMMAND = "/ugv/truth", "/ugv/body_state", "/ugv/body_command"
JOINT_STATE, JOINT_COMMAND, PATH, SAFETY = "/ugv/joint_state", "/ugv/joint_command", "/ugv/path", "/ugv/safety"
WHEEL_STATE, WHEEL_COMMAND = "/ugv/wheel_state", "/ugv/wheel_command_safe"
WHEEL_STATUS = "/ugv/wheel_status"
GAIT, CONTACT_FORCES, CAN_RECEIVED = "/ugv/gait", "/ugv/contact_forces", "/ugv/can_received"
_SIGNALS = (
    TRUTH,
    BODY_STATE,
    BODY_COMMAND,
    JOINT_STATE,
    JOINT_COMMAND,
    WHEEL_STATE,
    WHEEL_COMMAND,
    WHEEL_STATUS,
    PATH,
    SAFETY,
    GAIT,
    CONTACT_FORCES,
    CAN_RECEIVED,
)
_PROJECTION_STEP_NS = 10_000_000


class Terrain(NamedTuple):
    """A height field: of the corner, the spacing, and heights (rows along y, columns along x), m."""

    x0: float
    y0: float
    spacing: float
    heights: Array


@dataclass
class AgainstPath:
    """The true trunk against the path.

    Attributes:
        t: s.
        projection: nearest path points.
        x_error, y_error: true minus nearest path point, in odom, m.
    """

    t: Array
    projection: Projection
    x_error: Array
    y_error: Array


@dataclass
class RunData:
    """One run.

    Attributes:
        log: of the run.
        summary: content of summary.json, empty if there is none.
        signals: by topic, those that are there and not empty; their times count from the log's origin.
        ticks: tick records by loop.
        loops: as the log describes them.
        loop_times: how each of them that has ticks kept its time.
        joint_names: in the order of the joints.
        path: the path that was followed, if any.
        path_points: its waypoints, n x 2; the first repeated at the end of a closed path.
        against_path: the true trunk (the estimated one where there is no truth) against it.
        terrain: if the log carries it.
    """

    log: Log
    summary: Mapping[str, Any]
    signals: dict[str, Signal]
    ticks: dict[str, Signal]
    loops: list[DescribedLoop]
    loop_times: list[LoopTimes]
    joint_names: list[str]
    path: SectionedPath | None = None
    path_points: Array = field(default_factory=lambda: np.empty((0, 2)))
    against_path: AgainstPath | None = None
    terrain: Terrain | None = None

    @property
    def pose_topic(self) -> str | None:
        """Where the pose is taken from: truth, or else the estimate."""
        return next((topic for topic in (TRUTH, BODY_STATE) if topic in self.signals), None)


def load_run(run: Path) -> RunData:
    """Read a run directory (or .mcap file) for its report.

    Raises:
        LogError: if there is no readable log.
    """
    log = Log(run)
    wanted = [t for t in log.channels if t in _SIGNALS or t.startswith(TICK_TOPIC_PREFIX)]
    signals = {topic: signal for topic, signal in log.read_signals(wanted).items() if len(signal.log_ns)}
    ticks = {t[len(TICK_TOPIC_PREFIX) :]: s for t, s in signals.items() if t.startswith(TICK_TOPIC_PREFIX)}
    described = described_loops(log)
    signals = {topic: signal._replace(log_ns=signal.log_ns - log.origin_ns) for topic, signal in signals.items()}
    data = RunData(
        log=log,
        summary=_summary(log.path.parent / "summary.json"),
        signals={topic: signal for topic, signal in signals.items() if topic in _SIGNALS},
        ticks={t[len(TICK_TOPIC_PREFIX) :]: s for t, s in signals.items() if t.startswith(TICK_TOPIC_PREFIX)},
        loops=described,
        loop_times=[loop_times(loop, ticks[loop.name], log.origin_ns) for loop in described if loop.name in ticks],
        joint_names=_joint_names(log),
        terrain=_terrain(log),
    )
    try:
        _find_path(data)
        if data.path is not None and data.pose_topic is not None:
            laps_ns = _taken_up_again(_taken(data))
            data.against_path = _against(data.path, data.signals[data.pose_topic], laps_ns)
    except (ValueError, IndexError, TypeError) as error:
        raise LogError(f"{log.path}: path or pose are not laid out as this code knows them: {error}") from error
    return data


def yaw_of(orientation: npt.NDArray[np.float64]) -> Array:
    """Yaw of quaternions (x, y, z, w), n x 4, rad."""
    x, y, z, w = orientation.T
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def _joint_names(log: Log) -> list[str]:
    try:
        described = log.json(setup.MANIFEST)
    except LogError:
        return []
    names = described.get("joint_names") if isinstance(described, dict) else None
    return [str(name) for name in names] if isinstance(names, list) else []


def _summary(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise LogError(f"{path} cannot be read: {error}") from None
    return content if isinstance(content, dict) else {}


def _terrain(log: Log) -> Terrain | None:
    content = log.attachments.get(setup.TERRAIN)
    if content is None:
        return None
    try:
        with np.load(io.BytesIO(content)) as arrays:
            x0, y0, spacing = (float(arrays[name]) for name in ("x0", "y0", "spacing"))
            return Terrain(x0, y0, spacing, np.asarray(arrays["heights"], dtype=np.float64))
    except (KeyError, ValueError, OSError, zipfile.BadZipFile) as error:
        raise LogError(f"{log.path}: {setup.TERRAIN} cannot be read: {error}") from None


def _find_path(data: RunData) -> None:
    """The last path that has a beginning and an end, and that the robot did not refuse."""
    if PATH not in data.signals:
        return
    for row in _taken(data).values[::-1]:
        count, closed = int(row["count"]), bool(row["closed"])
        points = np.column_stack((row["x"][:count], row["y"][:count]))
        if count < 2:
            continue
        try:
            data.path = SectionedPath(points, closed)
        except PathError:
            continue
        data.path_points = np.vstack((points, points[:1])) if closed else points
        return


def _taken(data: RunData) -> Signal:
    """The paths and withdrawals that the robot did not refuse."""
    paths = data.signals[PATH]
    taken = ~_refused(paths, data.signals.get(BODY_COMMAND))
    return Signal(paths.log_ns[taken], paths.values[taken])


def _refused(paths: Signal, commands: Signal | None) -> npt.NDArray[np.bool_]:
    """Of each path, whether the robot's count of refused paths grew until the next one."""
    if commands is None or "rejected_paths" not in (commands.values.dtype.names or ()):
        return np.zeros(len(paths.log_ns), dtype=np.bool_)
    until = [*paths.log_ns.tolist(), commands.log_ns[-1] + 1]
    last = np.searchsorted(commands.log_ns, until, side="left") - 1
    counted = commands.values["rejected_paths"][np.maximum(last, 0)].astype(np.int64)
    return np.diff(counted) > 0


def _taken_up_again(paths: Signal) -> npt.NDArray[np.int64]:
    """When a path came after one was withdrawn: it is followed from its start then, lap after lap."""
    given = paths.values["count"] > 0
    return paths.log_ns[1:][given[1:] & ~given[:-1]]


def _against(path: SectionedPath, pose: Signal, laps_ns: npt.NDArray[np.int64]) -> AgainstPath:
    chosen = every(pose.log_ns, _PROJECTION_STEP_NS)
    log_ns, rows = pose.log_ns[chosen], pose.values[chosen]
    t, x, y, yaw = log_ns / 1e9, *rows["position"][:, :2].T.copy(), yaw_of(rows["orientation"])
    bounds = sorted({0, *np.searchsorted(log_ns, laps_ns).tolist(), len(t)})
    laps = [project(x[begin:end], y[begin:end], yaw[begin:end], path) for begin, end in pairwise(bounds)]
    columns = ((lap.progress, lap.distance, lap.lateral_error, lap.heading_error) for lap in laps)
    seen = Projection(*map(np.concatenate, zip(*columns, strict=True)))
    nearest = np.array([path.point(s) for s in seen.progress.tolist()])
    return AgainstPath(t, seen, x - nearest[:, 0], y - nearest[:, 1])


def every(log_ns: npt.NDArray[np.int64], step_ns: int) -> Sequence[int] | npt.NDArray[np.intp]:
    """Indices of samples about `step_ns` apart."""
    if len(log_ns) < 2:
        return np.arange(len(log_ns))
    typical = max(1.0, float(np.median(np.diff(log_ns))))
    return np.arange(0, len(log_ns), max(1, round(step_ns / typical)))
