# SPDX-License-Identifier: Apache-2.0
"""What a robot counts instead of stopping for it, in sentences."""

from __future__ import annotations

from typing import NamedTuple

from runtime.recording import run_data
from runtime.recording.run_data import RunData


class Counter(NamedTuple):
    """Something that the robot counts instead of stopping for it.

    Attributes:
        topic, field: where the count is, since the start.
        one, many: what was counted, as a sentence after the number.
    """

    topic: str
    field: str
    one: str
    many: str


COUNTERS = (
    Counter(
        run_data.WHEEL_STATE,
        "rejected",
        "CAN frame was rejected: wrong length, unknown id, error frame, or a value out of range",
        "CAN frames were rejected: wrong length, unknown id, error frame, or a value out of range",
    ),
    Counter(
        run_data.WHEEL_STATE,
        "corrupt",
        "state frame of the control unit had a wrong checksum",
        "state frames of the control unit had a wrong checksum",
    ),
    Counter(
        run_data.WHEEL_STATE,
        "stalled",
        "state frame of the control unit had an alive counter that did not go on",
        "state frames of the control unit had an alive counter that did not go on",
    ),
    Counter(
        run_data.JOINT_STATE,
        "rejected",
        "CAN frame was rejected: wrong length, unknown id, error frame, or a value out of range",
        "CAN frames were rejected: wrong length, unknown id, error frame, or a value out of range",
    ),
    Counter(
        run_data.CAN_RECEIVED, "lost", "CAN frame was lost for lack of room", "CAN frames were lost for lack of room"
    ),
    Counter(
        run_data.BODY_STATE,
        "imu_rejected",
        "IMU sample was not finite, and the last good one was used",
        "IMU samples were not finite, and the last good one was used",
    ),
    Counter(
        run_data.BODY_STATE,
        "localization_rejected",
        "localisation pose was rejected as not finite, too old or too far off",
        "localisation poses were rejected as not finite, too old or too far off",
    ),
    Counter(run_data.BODY_COMMAND, "rejected_paths", "path was rejected", "paths were rejected"),
    Counter(
        run_data.BODY_COMMAND,
        "foreign_paths",
        "path was rejected since another than its sender held the lease",
        "paths were rejected since another than their sender held the lease",
    ),
    Counter(
        run_data.GAIT,
        "late_contacts",
        "swing met the ground later than scheduled, and was stretched downwards",
        "swings met the ground later than scheduled, and were stretched downwards",
    ),
    Counter(
        run_data.GAIT,
        "early_contacts",
        "swing met the ground earlier than scheduled, and became a stance",
        "swings met the ground earlier than scheduled, and became stances",
    ),
    Counter(
        run_data.CONTACT_FORCES,
        "failures",
        "MPC problem was not solved, and the last good plan was held",
        "MPC problems were not solved, and the last good plan was held",
    ),
    Counter(
        run_data.JOINT_COMMAND,
        "qp_failures",
        "whole-body problem was not solved, and its fallback was used",
        "whole-body problems were not solved, and their fallback was used",
    ),
    Counter(
        run_data.SAFETY,
        "limited",
        "joint value of a command was altered by a limit",
        "joint values of commands were altered by a limit",
    ),
    Counter(run_data.SAFETY, "faults", "fall into the damped state", "falls into the damped state"),
)


def counters(data: RunData) -> list[tuple[int, str]]:
    """How often each thing happened that is counted and not silent, with a sentence; the most frequent first."""
    found = []
    for counter in COUNTERS:
        signal = data.signals.get(counter.topic)
        if signal is None or counter.field not in (signal.values.dtype.names or ()):
            continue
        total = int(signal.values[counter.field][-1])
        found.append((total, counter.one if total == 1 else counter.many))
    return sorted(found, key=lambda entry: -entry[0])
