# SPDX-License-Identifier: Apache-2.0
"""Where the link would listen: is the port free, and who can reach it."""

from __future__ import annotations

import ipaddress
import socket
import subprocess
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from runtime.cli.fitness.finding import Finding, fail, ok

UNIT = "ugv-link.service"
OPEN = "other hosts can reach it, and whoever does commands the robot"
_PATIENCE_S = 3


class Endpoint(NamedTuple):
    """A place to listen.

    Attributes:
        host: address or name.
        port: number.
    """

    host: str
    port: int


def endpoint(text: str) -> Endpoint | None:
    """The parts of `tcp/127.0.0.1:7447`; None for what listens on no port."""
    protocol, _, address = text.partition("#")[0].partition("?")[0].partition("/")
    host, _, port = address.rpartition(":")
    if protocol not in ("tcp", "tls", "udp", "quic", "ws") or not port.isdigit():
        return None
    return Endpoint(host.strip("[]"), int(port))


def is_loopback(host: str) -> bool:
    """Whether only this host can reach it."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def is_free(text: str) -> bool:
    """Whether an endpoint could be listened on; one that is no port always can."""
    found = endpoint(text)
    if found is None:
        return True
    family = socket.AF_INET6 if ":" in found.host else socket.AF_INET
    kind = socket.SOCK_DGRAM if text.startswith(("udp", "quic")) else socket.SOCK_STREAM
    try:
        with socket.socket(family, kind) as end:
            end.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            end.bind((found.host, found.port))
    except OSError:
        return False
    return True


def link_is_running() -> bool:
    """Whether the unit that would listen there already does."""
    command = ["systemctl", "--quiet", "is-active", UNIT]
    try:
        return subprocess.run(command, capture_output=True, timeout=_PATIENCE_S, check=False).returncode == 0
    except (OSError, subprocess.SubprocessError):
        return False


def check_endpoints(listen: Sequence[str], free: Sequence[bool], running: bool) -> Iterator[Finding]:
    """Every place that the link listens on by itself.

    Args:
        listen: endpoints as configured.
        free: whether each could be listened on.
        running: whether the link runs already.
    """
    for text, one_is_free in zip(listen, free, strict=True):
        name, found = f"zenoh {text}", endpoint(text)
        if found is None:
            yield ok(name, "is not a port of this host")
        elif not is_loopback(found.host):
            remedy = "listen on 127.0.0.1, or name a file with certificates and access control in link.zenoh_config"
            yield fail(name, OPEN, remedy)
        elif not one_is_free and not running:
            sentence = "cannot be listened on: something else does, or the address is not of this host"
            yield fail(name, sentence, "stop what listens there, or change link.listen")
        else:
            yield ok(name, "the link listens on it" if running else "is free")
