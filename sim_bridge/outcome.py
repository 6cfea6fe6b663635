# SPDX-License-Identifier: Apache-2.0
"""What came of a simulated run: the part of its summary that says how the course was gone through."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from runtime.recording.metrics import path_metrics
from runtime.recording.push import push_recovery
from runtime.recording.settling import settling, turn_in_place
from runtime.recording.sliding import sliding
from runtime.tracking.sections import SectionedPath
from sim_bridge.ground_friction import on_any
from sim_bridge.observer import Observer
from sim_bridge.scenario import Scenario

Array = npt.NDArray[np.float64]


def outcome_of(observer: Observer, course: Scenario) -> dict[str, Any]:
    """The part of the summary that says how the course was gone through."""
    fault = "" if not observer.fault else str(observer.fault.name)
    broken = {"broken": list(observer.broken)} if observer.broken else {}
    return {**_figures(observer, course), "fell": observer.fell, "fault": fault, **broken}


def _figures(observer: Observer, course: Scenario) -> dict[str, Any]:
    t, x, y, yaw = np.array(observer.samples or [(0.0, *course.start_pose)]).T
    if course.turn_rad:
        turned = turn_in_place(np.stack((x, y), axis=1), yaw, course.turn_rad)
        return {"completed": turned.completed and not observer.fault, "turn": turned.summary()}
    if not course.waypoints:
        return {"completed": observer.stood_and_sat and not observer.fault}
    return _along_path(t, np.stack((x, y), axis=1), yaw, observer, course)


def _along_path(t: Array, xy: Array, yaw: Array, observer: Observer, course: Scenario) -> dict[str, Any]:
    path = SectionedPath(course.waypoints, course.closed)
    metrics = path_metrics(t, xy, yaw + _course_angle(course), path, course.time_limit_s, course.profile)
    outcome = metrics.summary(course.speed_mps)
    if course.push is not None:
        fell = observer.fell or bool(observer.fault)
        push = push_recovery(t, xy, path, observer.push_end_s, course.speed_mps, fell)
        outcome["push"] = push.summary()
    if course.patches:
        outcome["patch"] = sliding(t, xy, yaw, on_any(xy[:, 0], xy[:, 1], course.patches)).summary()
    if math.dist(course.start_pose[:2], course.waypoints[0]) > 0.0 and course.velocity is None:
        outcome["settling"] = settling(t, xy, path).summary()
    return outcome


def _course_angle(course: Scenario) -> float:
    """From the robot's heading to the direction in which it is to move, rad."""
    return 0.0 if course.velocity is None else math.atan2(course.velocity[1], course.velocity[0])
