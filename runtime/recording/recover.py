# SPDX-License-Identifier: Apache-2.0
"""Saves what a cut-off log still holds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from runtime.messages import definitions
from runtime.recording.bag_metadata import TopicCount, bag_metadata
from runtime.recording.errors import RecordingError
from runtime.recording.log import Log
from runtime.recording.mcap_file import McapFile, open_output
from runtime.records import CDR_LITTLE_ENDIAN

_CHUNK_BYTES = 1 << 20


def recover(log: Log, directory: Path, progress: Callable[[float], None] | None = None) -> Path:
    """Write every whole message of a log into a new run directory; returns the new .mcap file.

    Raises:
        RecordingError: if the directory cannot be written, or already holds a log.
    """
    path = directory / f"{directory.resolve().name}_0.mcap"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        output, _ = open_output(path)
        file, topics = McapFile(output), []
        for name, entries in log.metadata.items():
            file.add_metadata(name, entries)
        for name, data in log.attachments.items():
            file.add_attachment(name, log.media_types[name], data)
        schemas: dict[str, int] = {}
        numbers: dict[str, int] = {}
        for channel in log.channels.values():
            name, text = channel.type_name, channel.definition
            if name not in schemas:
                schemas[name] = file.add_schema(name, text)
            numbers[channel.topic] = file.add_channel(channel.topic, schemas[name], {"offered_qos_profiles": "[]"})
            flat = text if name.startswith("ugv_") else None
            topics.append(TopicCount(channel.topic, name, _type_hash(name, flat)))
        span_ns = max(1, log.end_ns - log.start_ns)
        for topic, sequence, log_ns, body in log.messages():
            file.add_message(numbers[topic], sequence, log_ns, CDR_LITTLE_ENDIAN + body)
            if file.open_bytes >= _CHUNK_BYTES:
                file.close_chunk()
                if progress is not None:
                    progress((log_ns - log.start_ns) / span_ns)
        file.finish()
        for topic_count in topics:
            topic_count.count = file.message_counts[numbers[topic_count.topic]]
        (directory / "metadata.yaml").write_text(bag_metadata(path.name, file.start_ns, file.end_ns, topics))
    except FileExistsError:
        raise RecordingError(f"{path} already exists") from None
    except OSError as error:
        raise RecordingError(f"cannot recover into {directory}: {(error.strerror or str(error)).lower()}") from error
    return path


def _type_hash(name: str, text: str | None) -> str:
    """The hash of a type; empty if a damaged log names none that there is."""
    try:
        return definitions.type_hash(name, text)
    except KeyError:
        return ""
