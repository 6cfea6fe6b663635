# SPDX-License-Identifier: Apache-2.0
"""A port of this computer's loopback for a run's own network."""

import socket


def free_port() -> int:
    """A TCP port of 127.0.0.1 at which nobody listens now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
