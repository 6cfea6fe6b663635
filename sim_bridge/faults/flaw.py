# SPDX-License-Identifier: Apache-2.0
"""What is not as it is to be about a robot's answer to a fault."""

from __future__ import annotations

from typing import NamedTuple


class Flaw(NamedTuple):
    """One flaw of a trial.

    Attributes:
        says: in a sentence.
        missing_ns: how long ticks or commands were missing, which a longer stall excuses; None for any other flaw.
    """

    says: str
    missing_ns: int | None = None
