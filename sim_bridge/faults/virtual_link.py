# SPDX-License-Identifier: Apache-2.0
"""The link's process in virtual time: its decoders, checks, outputs and diagnosis are those of the robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from runtime.link.carrier import Carrier
from runtime.link.inputs import inputs_of
from runtime.link.setup import LinkSetup
from runtime.recording.recorder_status import RecorderStatus
from sim_bridge.faults.virtual_network import VirtualNetwork
from sim_bridge.faults.virtual_stream import VirtualStream

LINK = "ugv_link"
"""Its session's name."""


class VirtualLink:
    """Carries messages between a network and the control loops.

    Args:
        setup: of the robot.
        network: that the messages come by.
        directory: the runtime directory, whose files control reads.
        ticks: of the control loops.
        log: takes the link's own ticks.
        recorder: gives what the recorder last said of itself.

    Attributes:
        carrier: what it does in a tick.
        step_ns: how long that takes.
    """

    def __init__(
        self,
        setup: LinkSetup,
        network: VirtualNetwork,
        directory: Path,
        ticks: VirtualStream,
        log: VirtualStream,
        recorder: Callable[[], RecorderStatus | None],
    ) -> None:
        clocks = network.clocks
        session = network.join(LINK)
        self._network, self._clocks = network, clocks
        self._inputs = inputs_of(setup, directory, clocks.instant)
        self._inputs.subscribe(session)
        self.carrier = Carrier(setup, session, self._inputs, ticks.take, recorder, clocks.read, log)
        self.step_ns = 0
        self._began_ns: int | None = None

    def step(self, now_ns: int) -> None:
        """Begin a tick that is due, and end one that has taken its time."""
        if self._began_ns is None and now_ns >= self.carrier.ticks.release_ns:
            self.carrier.step()
            self._began_ns = now_ns
        if self._began_ns is not None and now_ns >= self._began_ns + self.step_ns:
            self.carrier.log(self._began_ns, now_ns, 0)
            self._began_ns = None

    def close(self) -> None:
        """End, however: nothing is kept that a killed process would keep."""
        self._network.leave(LINK)
        self._inputs.close()
