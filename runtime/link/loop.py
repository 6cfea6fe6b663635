# SPDX-License-Identifier: Apache-2.0
"""The link's own loop as the log sees it.

It has no tasks. Its ticks show when the link was held up, and its status what became of the messages.
"""

from __future__ import annotations

from runtime.link.topics import TAKEN
from runtime.records import Record, uint32, uint32_array
from runtime.robots.link_config import LinkConfig
from runtime.tasks import Loop

NAME, STATUS = "link", "/ugv/link_status"
_NS_PER_SECOND = 1_000_000_000


class LinkStatus(Record):
    """Counts since the link was started; /diagnostics tells the reasons of rejections."""

    on_change = True
    rejected = uint32_array("input", "", "messages not used, by topic: " + " ".join(TAKEN))
    lost = uint32_array("input", "", "messages that never arrived, as far as their senders number them")
    merged = uint32("", "requests whose place a newer one took before they left")
    clock_steps = uint32("", "of the unix clock")
    suspends = uint32("", "of the machine")
    malformed = uint32("", "datagrams that were no ticks of the control loops")


def link_loop(config: LinkConfig, priority: int) -> Loop:
    """The loop to append to a robot's, for the manifest of the log.

    Args:
        config: of the link.
        priority: of its threads.
    """
    period_ns = _NS_PER_SECOND // config.rate_hz
    status = LinkStatus(STATUS, {"input": len(TAKEN)})
    return Loop(NAME, period_ns, period_ns, priority, (status,), receives=(), schedule=(), port_outputs=())
