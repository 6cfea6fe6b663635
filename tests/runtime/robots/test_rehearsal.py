# SPDX-License-Identifier: Apache-2.0
"""After a rehearsal nothing of the loops is left to be compiled."""

import subprocess
import sys

import pytest

from runtime.robots import load_configuration, rehearse


@pytest.mark.parametrize("estimator", ["kalman", "truth"])
@pytest.mark.parametrize("controller", ["FpMW", "FpM"])
def test_the_robot_comes_to_walk(estimator, controller):
    assert rehearse(load_configuration("uslgo1", {"variant.estimator": estimator, "variant.controller": controller}))


@pytest.mark.parametrize("estimator", ["kalman", "truth"])
@pytest.mark.parametrize("controller", ["steered-return", "fuzzy-ldc", "mpc"])
def test_the_vehicle_comes_to_drive(estimator, controller):
    assert rehearse(load_configuration("4ws4wd", {"variant.estimator": estimator, "variant.controller": controller}))


FIRST_USES = """
from runtime.kernel_cache import KernelCache
from runtime.robots import load_configuration
from runtime.robots.uslgo1.rehearsal import rehearse
from sim_bridge import run
from sim_bridge.faults.attempt import attempt
from sim_bridge.faults.table import ROWS

rehearse(load_configuration("uslgo1"))
load, used = KernelCache.load_overload, []
KernelCache.load_overload = lambda self, *arguments: used.append(self._py_func.__module__) or load(self, *arguments)
run.rehearse = lambda *arguments: None
run.run_scenario("uslgo1", "flat", until_s=1.2)
answered = ("over-temperature", "IMU silent", "localisation silent", "MPC hung", "velocity silent")
for row in ROWS:
    if row.name in answered:
        attempt(row, 0)
sensors = ("runtime.models.rotations",)  # the simulator's turn quaternions
print([name for name in used if name.startswith("runtime") and name not in sensors], "sim_bridge.virtual_drive" in used)
"""


def test_neither_a_walk_after_it_nor_an_answer_to_a_fault_uses_a_kernel_for_the_first_time():
    done = subprocess.run([sys.executable, "-c", FIRST_USES], capture_output=True, text=True, check=True)
    assert done.stdout == "[] True\n"
