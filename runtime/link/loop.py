# SPDX-License-Identifier: Apache-2.0
"""The link's own loop as the log sees it: it has no tasks, and its ticks show when the link was held up."""

from __future__ import annotations

from runtime.robots.link_config import LinkConfig
from runtime.tasks import Loop

NAME = "link"
_NS_PER_SECOND = 1_000_000_000


def link_loop(config: LinkConfig, priority: int) -> Loop:
    """The loop to append to a robot's, for the manifest of the log.

    Args:
        config: of the link.
        priority: of its threads.
    """
    period_ns = _NS_PER_SECOND // config.rate_hz
    return Loop(NAME, period_ns, period_ns, priority, port_inputs=(), receives=(), schedule=(), port_outputs=())
