# SPDX-License-Identifier: Apache-2.0
"""Beyond which stalls of the machine a fault may come in real time, by the configuration: what all robots have.

Safety waits for an input for some time, of which a part passes without any stall: until the next sample is due, and
while that is on its way. What is left of it is the bound of the stall. So an inertial sample may be 20 ms old; one
comes every 2 ms and takes 2 ms, so that who brings them must have been kept for more than 16 of the last 20 ms.

Faults that no robot lists are made, and so excused, by no stall: what a body, a motor, a battery or an operator does,
and numbers that are none. Those that are bridged and counted need no explanation.
"""

from __future__ import annotations

from runtime.executors.companions import SIM
from runtime.link.loop import NAME as LINK
from runtime.recording.stalls import StallBound
from runtime.robots.robot_config import RobotConfig
from runtime.robots.simulation import WorldConfig
from runtime.safety.config import CommonSafetyConfig
from runtime.signals import Fault
from sim_bridge.script import PERIOD_NS as SIGN_OF_LIFE_NS

NS_PER_SECOND = 1_000_000_000
ON_ITS_WAY_NS = 2_000_000
"""A message takes no longer from the simulator through zenoh and the link to a control loop, if nothing stalls."""
WORLD, SENSORS = (SIM.name,), (SIM.name, LINK)


def waited_for(fault: Fault, loops: tuple[str, ...], wait_ns: int, usual_ns: int, noticed_ns: int = 0) -> StallBound:
    """The bound of what loops bring.

    Args:
        fault: that follows if it does not come.
        loops: whose stalls hold it up.
        wait_ns: for how long it may be missing.
        usual_ns: for how long it is missing without any stall.
        noticed_ns: how long afterwards the fault is found at the latest.
    """
    return StallBound(fault, loops, max(0, wait_ns - usual_ns), wait_ns + noticed_ns)


def common_bounds(
    config: RobotConfig, safety: CommonSafetyConfig, world: WorldConfig, fast: str, period_ns: int, budget_ns: int
) -> tuple[StallBound, ...]:
    """Those of sensors, operator and fast loop.

    A pose is as old as its latency when the simulator gives it away. A fast loop that was kept takes up the operator's
    oldest sign of life first, by then too old. Of a tick that takes longer than its period the loop itself needs its
    budget, and each tick that overruns takes the time of two.

    Args:
        config: of the robot.
        safety: its section.
        world: that of the simulation.
        fast: name of the loop in which safety is.
        period_ns: of that loop.
        budget_ns: of that loop.
    """
    sample_ns = NS_PER_SECOND // world.imu_rate_hz + ON_ITS_WAY_NS
    pose_ns = NS_PER_SECOND // world.localization_rate_hz + world.localization_latency_ns + ON_ITS_WAY_NS
    life_ns, hearers = SIGN_OF_LIFE_NS + ON_ITS_WAY_NS, (*SENSORS, fast)
    overrun_ns = period_ns - budget_ns
    overruns = {Fault.LATE_LOOP: safety.overruns_stand, Fault.OVERRUNS: safety.overruns_damp}
    return (
        waited_for(Fault.STALE_IMU, SENSORS, safety.imu_age_max_ns, sample_ns),
        waited_for(Fault.STALE_LOCALIZATION, SENSORS, safety.localization_age_max_ns, pose_ns),
        waited_for(Fault.STALE_OPERATOR, hearers, safety.operator_age_max_ns, life_ns),
        waited_for(Fault.STOOD_STILL, (fast,), safety.gap_max_ns, period_ns, period_ns),
        waited_for(Fault.NO_LEASE, hearers, config.authority.lease_ns, life_ns),
        *(StallBound(fault, (fast,), count * overrun_ns, 2 * count * period_ns) for fault, count in overruns.items()),
    )
