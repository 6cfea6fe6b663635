# SPDX-License-Identifier: Apache-2.0
"""Looks for what may be wrong with any robot: its inertial sensor, buses, estimate, battery, loop and operator."""

from __future__ import annotations

from runtime.compiled import compiled
from runtime.models.inertial import InertialConfig, is_finite_sample, is_plausible
from runtime.records import Record, float64_array, int64, uint8, uint32, uint32_array
from runtime.safety.config import CommonSafetyConfig
from runtime.safety.limits import tilt
from runtime.signals import Battery, BodyState, BusState, BusStatus, Fault, Imu, LoopTiming, OperatorRequest
from runtime.vehicle_signals import VehicleState


class WatchMemory(Record):
    """The state of the safety filter, and what it must remember of what every robot has."""

    mode = uint8()
    fault = uint32()
    limited = uint32()
    faults = uint32()
    imu_ns = int64("ns", "stamp of the last good inertial sample")
    imu_seen_ns = int64("ns", "stamp of the last one")
    imu_fault = uint32("", "what was wrong with that")
    imu_alike = uint32("", "samples in a row that are alike")
    good = float64_array(6, "m/s^2, rad/s", "last good sample: specific force, angular velocity")
    last = float64_array(6, "m/s^2, rad/s", "last sample")
    refused = uint32_array("bus", "", "frames refused up to the tick before")
    overrun_ns = int64("ns", "when there last were so many overruns in a row that the robot is to stand; 0 for never")


@compiled
def inertial_faults(
    config: CommonSafetyConfig, inertial: InertialConfig, memory: WatchMemory, imu: Imu, now_ns: int
) -> int:
    """Judge a new inertial sample; what is wrong with the newest, and with the sensor for want of good ones."""
    if imu.stamp_ns != memory.imu_seen_ns:
        memory.imu_seen_ns = imu.stamp_ns
        memory.imu_fault = _flaw(inertial, memory, imu, now_ns + config.imu_age_max_ns)
        if memory.imu_fault == 0:
            alike = (imu.linear_acceleration == memory.good[:3]).all()
            alike = alike and (imu.angular_velocity == memory.good[3:]).all()
            memory.imu_alike = memory.imu_alike + 1 if alike else 1
            memory.imu_ns = imu.stamp_ns
            memory.good[:3], memory.good[3:] = imu.linear_acceleration, imu.angular_velocity
        memory.last[:3], memory.last[3:] = imu.linear_acceleration, imu.angular_velocity
    found = int(memory.imu_fault)
    if now_ns - memory.imu_ns > config.imu_age_max_ns:
        found |= Fault.STALE_IMU.value
    if memory.imu_alike >= config.imu_frozen_samples:
        found |= Fault.FROZEN_IMU.value
    return found


@compiled
def _flaw(inertial: InertialConfig, memory: WatchMemory, imu: Imu, latest_ns: int) -> int:
    if not is_finite_sample(imu):
        return Fault.NON_FINITE_SENSOR.value
    if imu.stamp_ns < memory.imu_ns or imu.stamp_ns > latest_ns:
        return Fault.IMU_TIME.value
    if not is_plausible(inertial, imu, memory.good, memory.last):
        return Fault.IMPLAUSIBLE_IMU.value
    return 0


@compiled
def bus_faults(memory: WatchMemory, buses: BusStatus) -> int:
    """A bus that is gone, flooded or full."""
    found = 0
    for bus in range(buses.state.shape[0]):
        gone = buses.state[bus] == BusState.OFF or buses.state[bus] == BusState.DOWN
        full = buses.refused[bus] != memory.refused[bus]
        if gone or full or buses.backlog[bus]:
            found |= Fault.BUS.value
        memory.refused[bus] = buses.refused[bus]
    return found


@compiled
def estimate_faults(config: CommonSafetyConfig, body: BodyState | VehicleState) -> int:
    """What the estimate says."""
    found = 0
    if body.localization_age_ns > config.localization_age_max_ns:
        found |= Fault.STALE_LOCALIZATION.value
    if body.localization_disputed >= config.disputed_poses_max:
        found |= Fault.MOVED_LOCALIZATION.value
    if not tilt(body.orientation) <= config.tilt_max_rad:
        found |= Fault.TILT.value
    return found


@compiled
def battery_faults(config: CommonSafetyConfig, battery: Battery) -> int:
    """A voltage beyond its bounds; 0 V if it is not known."""
    found = 0
    if battery.voltage > 0.0 and not config.voltage_min_v <= battery.voltage <= config.voltage_max_v:
        found |= Fault.VOLTAGE.value
    return found


@compiled
def loop_faults(config: CommonSafetyConfig, memory: WatchMemory, timing: LoopTiming, now_ns: int) -> int:
    """Overruns in a row of the loop that this is in."""
    found = 0
    if timing.overruns_in_a_row >= config.overruns_stand:
        memory.overrun_ns = now_ns
    if memory.overrun_ns > 0 and now_ns - memory.overrun_ns <= config.overruns_stand_ns:
        found |= Fault.LATE_LOOP.value
    if timing.overruns_in_a_row >= config.overruns_damp:
        found |= Fault.OVERRUNS.value
    return found


@compiled
def standstill_faults(config: CommonSafetyConfig, timing: LoopTiming) -> int:
    """A time without commands, after which actuators have let go by themselves."""
    return Fault.STOOD_STILL.value if timing.gap_ns > config.gap_max_ns else 0


@compiled
def operator_faults(config: CommonSafetyConfig, operator: OperatorRequest, now_ns: int) -> int:
    """An operator that is silent, and nobody who holds the lease."""
    found = 0
    if now_ns - operator.stamp_ns > config.operator_age_max_ns:
        found |= Fault.STALE_OPERATOR.value
    if not operator.held:
        found |= Fault.NO_LEASE.value
    return found
