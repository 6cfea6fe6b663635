# SPDX-License-Identifier: Apache-2.0
"""Two threads that meet in linear algebra find their buffers there."""

import subprocess
import sys

MEETING = """
import ctypes
import threading
import numpy as np
from numba.extending import get_cython_function_address
from runtime.executors.blas_buffers import make_blas_buffers

def held_mib():
    with open("/proc/self/maps") as maps:
        writable = [line.split()[0].split("-") for line in maps if " rw-p " in line]
    return sum(int(end, 16) - int(begin, 16) for begin, end in writable) >> 20

SIZE = 1024
address = get_cython_function_address("scipy.linalg.cython_blas", "dgemm")
dgemm = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 13)(address)  # as kernels call it, without the interpreter
size, factor, plain = ctypes.c_int(SIZE), ctypes.c_double(1.0), ctypes.c_char(b"n")
matrix, together = np.ones((SIZE, SIZE)), threading.Barrier(2)

def at(value):
    return ctypes.addressof(value)

def product(result):
    data = matrix.ctypes.data
    sizes = at(size), at(size), at(size)
    dgemm(at(plain), at(plain), *sizes, at(factor), data, at(size), data, at(size), at(factor), result, at(size))

def compute():
    result = np.zeros((SIZE, SIZE))
    for _ in range(5):
        together.wait()
        product(result.ctypes.data)
        together.wait()
        matrix @ matrix

def meet():
    threads = [threading.Thread(target=compute) for _ in range(2)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]

PREPARE
before = held_mib()
meet()
print(held_mib() - before)
"""


BUFFER_MIB = 32


def grown_mib(prepare: str) -> int:
    program = MEETING.replace("PREPARE", prepare)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_no_large_piece_of_memory_is_taken_when_loops_first_meet_in_linear_algebra():
    assert grown_mib("") >= BUFFER_MIB
    assert grown_mib("make_blas_buffers(2)") < BUFFER_MIB, "no more than the stacks of two threads"
