# SPDX-License-Identifier: Apache-2.0
"""The CAN channels: is each there, up, at the right rate, and able to come back after bus-off."""

from __future__ import annotations

import json
import socket
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from runtime.cli.fitness.finding import Finding, fail, ok, warn

QUEUE_LENGTH = 128
"""Of frames that wait to be sent, as the shipped network files set it; the kernel's own 10 is refused too early."""
NETWORK_FILES = "install deploy/network and restart systemd-networkd"
_PATIENCE_S = 3


class Link(NamedTuple):
    """A network interface as the kernel describes it.

    Attributes:
        kind: of CAN channel: can, vcan; other or none if it is no CAN channel.
        up: whether it takes frames.
        state: of the controller, such as ERROR-ACTIVE or BUS-OFF; empty if it has none.
        bit_rate_hz: of the bus, 0 if it has none.
        restart_ms: after bus-off, 0 for never.
        queue_length: of frames that wait to be sent.
    """

    kind: str
    up: bool
    state: str = ""
    bit_rate_hz: int = 0
    restart_ms: int = 0
    queue_length: int = 0


def kernel_has_can() -> bool:
    """Whether a CAN socket can be made."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def read_links() -> dict[str, Link] | None:
    """The interfaces by name; None where the program `ip` cannot tell."""
    command = ["ip", "-details", "-json", "link", "show"]
    try:
        told = subprocess.run(command, capture_output=True, timeout=_PATIENCE_S, check=True).stdout
        return links(json.loads(told))
    except (OSError, subprocess.SubprocessError, ValueError):
        return None


def links(described: Sequence[Mapping[str, Any]]) -> dict[str, Link]:
    """The interfaces in what `ip -details -json link show` has told."""
    found = {}
    for one in described:
        information = one.get("linkinfo", {})
        data = information.get("info_data", {})
        found[str(one.get("ifname", ""))] = Link(
            kind=str(information.get("info_kind", "")),
            up="UP" in one.get("flags", ()),
            state=str(data.get("state", "")),
            bit_rate_hz=int(data.get("bittiming", {}).get("bitrate", 0) or data.get("bittiming_bitrate", 0)),
            restart_ms=int(data.get("restart_ms", 0)),
            queue_length=int(one.get("txqlen", 0)),
        )
    return found


def check_kernel(has_can: bool) -> Finding:
    """CAN sockets can be made."""
    if has_can:
        return ok("kernel CAN", "the kernel has CAN sockets")
    return fail(
        "kernel CAN",
        "the kernel has no CAN sockets",
        "modprobe can can_raw; if there are no such modules, use a kernel with CONFIG_CAN and CONFIG_CAN_RAW",
    )


def check_channels(channels: Sequence[str], bit_rate_hz: int, found: Mapping[str, Link] | None) -> Iterator[Finding]:
    """Every channel of the configuration."""
    if found is None:
        yield fail("CAN channels", "the program ip does not tell which there are", "install iproute2")
        return
    for channel in channels:
        yield check_channel(channel, bit_rate_hz, found.get(channel))


def check_channel(channel: str, bit_rate_hz: int, link: Link | None) -> Finding:
    """The first thing that is wrong with a channel, if anything is."""
    name = f"CAN {channel}"
    if link is None:
        remedy = "connect the adapter and load its driver, or name the channel that is meant in drives.channels"
        return fail(name, "there is no such interface", remedy)
    if link.kind == "vcan":
        return warn(name, "is virtual: no motor is connected to it", "name a channel of hardware in drives.channels")
    if link.kind != "can":
        return fail(name, "is not a CAN interface", "name a CAN channel in drives.channels")
    if link.bit_rate_hz != bit_rate_hz:
        sentence = f"runs at {link.bit_rate_hz} bit/s, and the drives at {bit_rate_hz}"
        remedy = f"ip link set {channel} down; ip link set {channel} up type can bitrate {bit_rate_hz}"
        return fail(name, sentence, remedy)
    if not link.up:
        return fail(name, "is down", f"ip link set {channel} up, or {NETWORK_FILES}")
    if link.state == "BUS-OFF":
        remedy = f"check cable, termination and power of the drives, then ip link set {channel} type can restart"
        return fail(name, "is off the bus after too many errors", remedy)
    if not link.restart_ms:
        sentence = "would stay off the bus after bus-off: restart-ms is 0"
        return fail(name, sentence, f"ip link set {channel} down type can restart-ms 100, or {NETWORK_FILES}")
    if link.queue_length < QUEUE_LENGTH:
        sentence = f"queues {link.queue_length} frames, fewer than {QUEUE_LENGTH}"
        return warn(name, sentence, f"ip link set {channel} txqueuelen {QUEUE_LENGTH}, or {NETWORK_FILES}")
    if link.state not in ("", "ERROR-ACTIVE"):
        remedy = "check cable, termination and power of the drives"
        return warn(name, f"has seen errors: its controller is {link.state}", remedy)
    return ok(name, f"is up at {link.bit_rate_hz / 1e6:g} Mbit/s, back {link.restart_ms} ms after bus-off")


def check_loads(loads: Sequence[float], bound: float) -> Finding:
    """How full the buses are when every frame has the most stuff bits."""
    if max(loads) > bound:
        sentence = f"the fullest bus is loaded by {max(loads):.0%}, above {bound:.0%}"
        return fail("bus load", sentence, "lower loops.wbc_hz, or put fewer drives on a bus")
    return ok("bus load", f"the fullest bus is loaded by {max(loads):.0%} at most; {bound:.0%} are allowed")
