# SPDX-License-Identifier: Apache-2.0
"""What a recorder is told before the first datagram, and what the log carries about its run."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field

from runtime.executors.tick import manifest_of
from runtime.recording.fingerprint import fingerprint, package_versions
from runtime.recording.layout import ChannelSpec, channel_specs
from runtime.tasks import Loop

CONFIG, REVISION, VERSIONS, SEED = "config.toml", "git_revision.txt", "versions.json", "seed.txt"
BEGINNING = "beginning"
"""Name of the metadata record of a real-time log: when and why it begins."""
FINGERPRINT, MANIFEST, TERRAIN = "fingerprint.json", "manifest.json", "terrain.npz"


@dataclass(frozen=True)
class Attachment:
    """A named file within the log."""

    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True)
class RecordingSetup:
    """Everything that a recorder needs to know; plain data, so that it can be sent to another process.

    Attributes:
        robot: name of the robot.
        channels: every channel, numbered as in the datagrams.
        joint_names: in the order of the robot's joints, for /joint_states.
        attachments: files that go into the log.
        checksums: log a CRC-32 of every entry of every tick, so that a replay can name a damaged one.
    """

    robot: str
    channels: tuple[ChannelSpec, ...]
    joint_names: tuple[str, ...] = ()
    attachments: tuple[Attachment, ...] = field(default=(), repr=False)
    checksums: bool = True


def recording_setup(
    loops: Sequence[Loop],
    robot: str,
    config: str,
    seed: int,
    joint_names: Sequence[str] = (),
    revision: str | None = None,
    key_frame_ns: int = 1_000_000_000,
    extra: Sequence[Attachment] = (),
) -> RecordingSetup:
    """Describe a run.

    Args:
        loops: as given to the executor.
        robot: name of the robot.
        config: the resolved configuration, as text.
        seed: of the run.
        joint_names: in the order of the robot's joints.
        revision: of the code, if known.
        key_frame_ns: as given to the executor.
        extra: further attachments, such as `terrain.npz` (arrays x0, y0, spacing, heights) or a scenario.
    """
    channels = channel_specs(manifest_of(tuple(loops)), robot)
    manifest = {
        "robot": robot,
        "key_frame_ns": key_frame_ns,
        "joint_names": list(joint_names),
        "loops": [
            {
                "name": loop.name,
                "period_ns": loop.period_ns,
                "budget_ns": loop.budget_ns,
                "receives": [record.topic for record in loop.receives],
                "tasks": [
                    {
                        "name": item.task.name,
                        "every": item.every,
                        "writes": [record.topic for record in item.task.writes],
                    }
                    for item in loop.schedule
                ],
            }
            for loop in loops
        ],
        "channels": [{k: v for k, v in asdict(spec).items() if k != "definition"} for spec in channels],
    }
    attachments = [
        Attachment(CONFIG, "text/plain", config.encode()),
        Attachment(SEED, "text/plain", f"{seed}\n".encode()),
        Attachment(VERSIONS, "application/json", _json(package_versions())),
        Attachment(FINGERPRINT, "application/json", _json(fingerprint())),
        Attachment(MANIFEST, "application/json", _json(manifest)),
    ]
    if revision is not None:
        attachments.append(Attachment(REVISION, "text/plain", f"{revision}\n".encode()))
    return RecordingSetup(robot, channels, tuple(joint_names), (*attachments, *extra))


def _json(value: object) -> bytes:
    return json.dumps(value, indent=1).encode()
