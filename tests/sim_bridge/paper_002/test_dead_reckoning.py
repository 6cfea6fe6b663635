# SPDX-License-Identifier: Apache-2.0
"""A late pose and the wheels together give the present pose."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_bridge.kinematic_vehicle import KinematicPlant, KinematicVehicle
from sim_bridge.paper_002.dead_reckoning import DeadReckoning

LOOK_S, TICKS_A_LOOK = 0.02, 2
commands = st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-0.5, 0.5)), min_size=1, max_size=8)


@given(commands, st.integers(0, 30))
def test_it_is_the_true_one_from_the_start_on(asked, looks):
    plant = KinematicPlant(pose_delay_ns=looks * TICKS_A_LOOK * 10_000_000)
    vehicle, reckoning = KinematicVehicle(plant, (1.0, 2.0, 0.5), 0.6), DeadReckoning(looks * LOOK_S, LOOK_S)
    for command in asked:
        vehicle.command(*command)
        for tick in range(24):
            if tick % TICKS_A_LOOK == 0:
                reckoning.look(vehicle.seen)
                present = reckoning.present(vehicle.seen)
                assert present[:3] == pytest.approx(vehicle.motion[:3], abs=1e-3)
                assert present[3:] == vehicle.motion[3:]
            vehicle.advance()
