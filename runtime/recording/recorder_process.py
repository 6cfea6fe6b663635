# SPDX-License-Identifier: Apache-2.0
"""The recorder's far end: a process that reads datagrams from a socket until its end, and writes the bag.

It is given the descriptor of the socket as its argument and its setup on standard input, and answers on standard output
with one JSON object a line: `ready`, then `closed`, or `error` with a sentence.
"""

from __future__ import annotations

import json
import pickle
import signal
import socket
import sys

from runtime.recording.bag import BagWriter
from runtime.recording.errors import RecordingError

_LONGEST_DATAGRAM = 1 << 20


def _answer(**entries: object) -> None:
    sys.stdout.write(json.dumps(entries) + "\n")
    sys.stdout.flush()


def record(stream: socket.socket) -> None:
    """Write a bag from the datagrams of a socket.

    Raises:
        RecordingError: if the bag cannot be written.
    """
    directory, setup, options = pickle.load(sys.stdin.buffer)
    writer = BagWriter(directory, setup, options)
    _answer(ready=True)
    if options.sync_ns:
        stream.settimeout(options.chunk_span_ns / 1e9)
    buffer = memoryview(bytearray(_LONGEST_DATAGRAM))
    while True:
        try:
            size = stream.recv_into(buffer)
        except TimeoutError:
            writer.flush()
            continue
        if not size:
            break
        writer.write(bytes(buffer[:size]))
    writer.close()
    _answer(closed=True)


def main() -> int:
    """Run the recorder; returns its exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with socket.socket(fileno=int(sys.argv[1])) as stream:
        try:
            record(stream)
        except RecordingError as error:
            _answer(error=str(error))
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
