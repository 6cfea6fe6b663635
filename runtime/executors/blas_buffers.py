# SPDX-License-Identifier: Apache-2.0
"""The buffers of linear algebra: made before the loops begin, not within a tick.

OpenBLAS, of which numpy and scipy have one each, keeps a buffer of 32 MiB for every thread that computes in it at the
same time as others. It makes the second one when two loops first happen to be in it together; in a process whose memory
is locked, filling it takes longer than several ticks.
"""

from __future__ import annotations

import threading
from functools import cache

import numpy as np
from scipy.linalg.blas import dgemm

_SIZE, _ROUNDS = 1024, 3
"""Of matrices whose product takes tens of milliseconds, so that all threads are in it together; and how often."""


@cache
def make_blas_buffers(threads: int) -> None:
    """Have so many threads compute at the same time, once in the life of the process.

    Args:
        threads: as many as loops.
    """
    matrix, together = np.ones((_SIZE, _SIZE)), threading.Barrier(threads)

    def compute() -> None:
        for _ in range(_ROUNDS):
            together.wait()
            np.matmul(matrix, matrix)
            together.wait()
            dgemm(1.0, matrix, matrix)

    computing = [threading.Thread(target=compute) for _ in range(threads)]
    for thread in computing:
        thread.start()
    for thread in computing:
        thread.join()
