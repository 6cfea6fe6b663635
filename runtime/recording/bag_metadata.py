# SPDX-License-Identifier: Apache-2.0
"""The text of a rosbag2 directory's metadata.yaml (version 9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from runtime.messages.definitions import DISTRIBUTION


@dataclass
class TopicCount:
    """A topic, and how many messages it has."""

    topic: str
    type_name: str
    type_hash: str
    count: int = 0


def bag_metadata(file_name: str, start_ns: int, end_ns: int, topics: Sequence[TopicCount]) -> str:
    """The metadata of a bag of one file."""
    total, duration_ns = sum(topic.count for topic in topics), end_ns - start_ns
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 9",
        "  storage_identifier: mcap",
        "  duration:",
        f"    nanoseconds: {duration_ns}",
        "  starting_time:",
        f"    nanoseconds_since_epoch: {start_ns}",
        f"  message_count: {total}",
        "  topics_with_message_count:" + ("" if topics else " []"),
    ]
    for topic in topics:
        lines += [
            "    - topic_metadata:",
            f"        name: {topic.topic}",
            f"        type: {topic.type_name}",
            "        serialization_format: cdr",
            "        offered_qos_profiles: []",
            f"        type_description_hash: {topic.type_hash}",
            f"      message_count: {topic.count}",
        ]
    lines += [
        '  compression_format: ""',
        '  compression_mode: ""',
        "  relative_file_paths:",
        f'    - "{file_name}"',
        "  files:",
        f'    - path: "{file_name}"',
        "      starting_time:",
        f"        nanoseconds_since_epoch: {start_ns}",
        "      duration:",
        f"        nanoseconds: {duration_ns}",
        f"      message_count: {total}",
        "  custom_data: ~",
        f"  ros_distro: {DISTRIBUTION}",
    ]
    return "\n".join(lines) + "\n"
