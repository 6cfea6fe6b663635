# SPDX-License-Identifier: Apache-2.0
"""What the far end of the wires sees of a robot after a fault: when its drives let go, and whether they were abused.

It needs no log, so that it also sees a robot whose control process is gone.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from drivers.memory_bus import Received
from runtime.robots.uslgo1.config import Uslgo1Config
from sim_bridge.faults.joint_limits import JointLimits
from sim_bridge.quadruped_world import QuadrupedWorld

FALL_MARGIN_RAD = 0.1
"""Beyond the tilt at which the robot is damped: it takes a moment."""


class Witness:
    """Looks at the world after every step of its physics, once it was told to.

    Args:
        config: of the robot.
        world: the true robot.
        clock: gives the present.

    Attributes:
        released_ns: when no drive had more than damping in force; None before.
        joints_kept: whether all joints stayed within their limits (`JointLimits`) until then.
        fell: whether the robot fell before.
    """

    def __init__(
        self, config: Uslgo1Config, world: QuadrupedWorld, clock: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._limits = JointLimits(config.safety)
        self._tilt = config.safety.tilt_max_rad + FALL_MARGIN_RAD
        self._world, self._clock = world, clock
        self._heard: list[tuple[int, Received]] = []
        self.begin()
        self._watching = False

    def begin(self) -> None:
        """Watch from now on."""
        self._watching = True
        self.released_ns: int | None = None
        self.joints_kept, self.fell = True, False
        self._heard.clear()

    def look(self) -> None:
        """See the world after a step."""
        if not self._watching or self.released_ns is not None:
            return
        world = self._world
        if not world.drives.driven:
            self.released_ns = self._clock()
            return
        self.joints_kept = self.joints_kept and self._limits.kept(world)
        self.fell = self.fell or world.tilt > self._tilt

    def hear(self, received: Received) -> None:
        """Note commands as they arrive."""
        if self._watching and received.bus.size:
            self._heard.append((self._clock(), received))

    def end(self, file: Path) -> dict[str, Any]:
        """Stop watching; gives what was seen, and leaves the commands in a file."""
        self._watching = False
        counts = [received.bus.size for _, received in self._heard]
        np.savez(
            file,
            arrival_ns=np.repeat(np.array([at_ns for at_ns, _ in self._heard], np.int64), counts),
            bus=np.concatenate([received.bus for _, received in self._heard] or [np.zeros(0, np.uint8)]),
            raw=np.frombuffer(b"".join(received.frames.tobytes() for _, received in self._heard), np.uint8),
        )
        return {"released_ns": self.released_ns, "joints_kept": self.joints_kept, "fell": self.fell}
