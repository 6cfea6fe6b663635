# SPDX-License-Identifier: Apache-2.0
"""The buffers of linear algebra: made before the loops begin, not within a tick.

OpenBLAS, of which numpy and scipy have one each, keeps a buffer of 32 MiB for every thread that computes in it at the
same time as others. It makes the second one when two loops first happen to be in it together; in a process whose memory
is locked, filling it takes longer than many ticks (40 to 60 ms). Kernels use scipy's, and only there two threads can
meet in it: scipy's own functions keep the interpreter.
"""

from __future__ import annotations

import threading
from functools import cache

import numpy as np
import numpy.typing as npt

from runtime.compiled import compiled_long

_SIZE, _ROUNDS = 1024, 3
"""Of matrices whose product takes tens of milliseconds, so that all threads are in it together; and how often."""


@cache
def make_blas_buffers(threads: int) -> None:
    """Have so many threads compute at the same time, once in the life of the process.

    Args:
        threads: as many as loops.
    """
    matrix, together = np.ones((_SIZE, _SIZE)), threading.Barrier(threads)
    _product(matrix, matrix)

    def compute() -> None:
        for _ in range(_ROUNDS):
            together.wait()
            np.matmul(matrix, matrix)
            together.wait()
            _product(matrix, matrix)

    computing = [threading.Thread(target=compute) for _ in range(threads)]
    for thread in computing:
        thread.start()
    for thread in computing:
        thread.join()


@compiled_long
def _product(left: npt.NDArray[np.float64], right: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return left @ right
