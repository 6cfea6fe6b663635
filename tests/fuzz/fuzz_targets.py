# SPDX-License-Identifier: Apache-2.0
"""Every decoder that faces a wire or a file, as a function of bytes that may only raise errors of ours.

A target is one line of the `TARGETS` of its subject: a name, what takes the bytes, the modules that it is about, and
where its seeds come from. `test_decoders.py` gives each a few hundred inputs in `make test`, `campaign.py` many
thousands in `make fuzz`.
"""

from __future__ import annotations

import random

import can_targets
import file_targets
import link_targets
import log_targets
import message_targets
import process_targets

TARGETS = (
    *can_targets.TARGETS,
    *file_targets.TARGETS,
    *link_targets.TARGETS,
    *log_targets.TARGETS,
    *process_targets.TARGETS,
    *message_targets.TARGETS,
)


def mutated(seed: bytes, choice: random.Random) -> bytes:
    """A seed with a few things done to it that break decoders: other bytes, lengths, cuts, repeats."""
    data = bytearray(seed)
    for _ in range(choice.randint(1, 4)):
        place = choice.randrange(len(data) + 1)
        kind = choice.randrange(6)
        if kind == 0 and data:
            data[place % len(data)] ^= 1 << choice.randrange(8)
        elif kind == 1:
            data[place : place + 1] = choice.randbytes(choice.randint(0, 4))
        elif kind == 2:
            data[place : place + 8] = choice.choice((b"\xff" * 8, b"\0" * 8, b"\xff" * 7 + b"\x7f", b"\0\0\0\x80" * 2))
        elif kind == 3:
            del data[place:]
        elif kind == 4:
            data[place:place] = data[place : place + choice.randint(1, 64)]
        else:
            del data[place : place + choice.randint(1, 64)]
    return bytes(data)
