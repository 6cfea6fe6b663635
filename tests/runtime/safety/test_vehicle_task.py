# SPDX-License-Identifier: Apache-2.0
"""Whatever is commanded and whatever breaks: a vehicle's limits hold, each fault has its name, and it stops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from runtime import signals, vehicle_signals
from runtime.errors import ConfigError
from runtime.models.inertial import InertialConfig
from runtime.safety.vehicle_answers import approached
from runtime.safety.vehicle_config import VehicleSafetyConfig
from runtime.safety.vehicle_task import VehicleSafetyTask
from runtime.signals import BusState, Fault, Mode, Motion

SIZES = {"wheel": 4, "axle_drive": 8, "unit_frame": 6, "bus": 1}
POSITIONS = np.array([[0.585, 0.37], [0.585, -0.37], [-0.585, 0.37], [-0.585, -0.37]])
SLOW = (False, False, False, False, False, True)
RADIUS, DRIVE, BRAKE, DRIVING = 0.2, 1, 0, 2
CONFIG = VehicleSafetyConfig()
MS, TICK_S = 1_000_000, 0.01
ANY = st.floats(allow_nan=True, allow_infinity=True)
MOSTLY_SANE = st.one_of(st.floats(-20.0, 20.0), ANY)


class Rig:
    """The filter, and wheels that do at once as they are told, but for those that are broken."""

    def __init__(self, mode=Mode.ACTIVE, config=CONFIG, speed=0.0, steering=0.0):
        self.now_ns = 10_000 * MS
        self.imu, self.battery = signals.Imu("/imu"), signals.Battery("/battery")
        self.wheels, self.body = (
            vehicle_signals.WheelState("/wheels", SIZES),
            vehicle_signals.VehicleState("/body", SIZES),
        )
        self.operator, self.twist = signals.OperatorRequest("/operator"), vehicle_signals.TwistCommand("/twist")
        self.buses, self.timing = signals.BusStatus("/buses", SIZES), signals.LoopTiming("/timing")
        self.command, self.output = (vehicle_signals.WheelCommand(topic, SIZES) for topic in ("/command", "/safe"))
        self.status = signals.SafetyStatus("/status")
        self.wheel_status = vehicle_signals.WheelStatus("/wheel_status", SIZES)
        self.body.orientation, self.battery.voltage = (0.0, 0.0, 0.0, 1.0), 29.0
        self.wheels.temperature, self.wheels.mode = 40.0, DRIVING
        self.operator.motion, self.operator.arm, self.operator.held = Motion.WALK, True, True
        self.task = VehicleSafetyTask(
            config,
            InertialConfig(),
            RADIUS,
            SLOW,
            DRIVE,
            BRAKE,
            DRIVING,
            10 * MS,
            self.imu,
            self.wheels,
            self.body,
            self.battery,
            self.buses,
            self.timing,
            self.operator,
            self.twist,
            self.command,
            self.output,
            self.status,
            self.wheel_status,
        )
        self.task.state.mode = mode
        for record in (self.command, self.wheels, self.task.state):
            record.steering, record.speed = steering, speed / RADIUS
        self.jammed, self.mute, self.path = (), (), [np.zeros(3)]
        self.refuses = False

    def step(self, keep=()):
        """One tick with everything fresh, but for what `keep` names, and the motion that follows."""
        self.now_ns += 10 * MS
        for name in ("imu", "operator", "twist", "command"):
            if name not in keep:
                getattr(self, name).stamp_ns = self.now_ns
        if "noise" not in keep:
            self.imu.linear_acceleration[0] += 1e-3
        for frame in range(6):
            if "wheels" not in keep and frame not in self.mute:
                self.wheels.reply_ns[frame] = self.now_ns - MS
        self.task.step(self.now_ns)
        self.roll()
        return self.status

    def roll(self):
        """Wheels that obey, brakes that hold, and a vehicle that goes as the wheels that are not at fault say."""
        self.wheels.mode = DRIVING if self.output.mode == DRIVE and not self.refuses else 0
        for wheel in range(4):
            if wheel not in self.jammed:
                self.wheels.steering[wheel] = self.output.steering[wheel]
            self.wheels.speed[wheel] = self.output.speed[wheel] if self.wheels.mode == DRIVING else 0.0
        c, s = np.cos(self.wheels.steering), np.sin(self.wheels.steering)
        x, y = POSITIONS.T
        rows = np.concatenate((np.c_[c, s, s * x - c * y], np.c_[-s, c, c * x + s * y]))
        rolling = np.concatenate((RADIUS * self.wheels.speed, np.zeros(4)))
        vx, vy, w = np.linalg.lstsq(rows, rolling, rcond=None)[0]
        yaw = self.path[-1][2]
        move = np.array([np.cos(yaw) * vx - np.sin(yaw) * vy, np.sin(yaw) * vx + np.cos(yaw) * vy, w])
        self.path.append(self.path[-1] + TICK_S * move)
        self.body.resting = not np.any(self.wheels.speed)

    @property
    def travelled(self):
        """Distance since the beginning."""
        return np.linalg.norm(np.diff(np.array(self.path)[:, :2], axis=0), axis=1).sum()


def test_a_healthy_vehicle_stands_by_is_armed_drives_and_rests_again():
    rig = Rig(Mode.OFF)
    rig.operator.motion, rig.operator.arm, rig.body.resting = Motion.REST, False, True
    modes = []

    def step():
        rig.step()
        modes.append(Mode(rig.status.mode))
        assert rig.status.fault == 0

    step()
    assert (rig.output.enable, rig.output.mode) == (False, BRAKE)
    rig.operator.arm, rig.operator.motion = True, Motion.STAND
    step()
    step()
    assert (rig.output.enable, rig.output.mode) == (True, DRIVE)
    rig.operator.motion = Motion.WALK
    rig.command.speed = 5.0
    for _ in range(100):
        step()
    np.testing.assert_allclose(rig.output.speed, 5.0)
    rig.operator.motion = Motion.REST
    rig.command.speed = 0.0
    for _ in range(100):
        step()
    rig.operator.arm = False
    step()
    in_order = [mode for mode, before in zip(modes, [None, *modes], strict=False) if mode != before]
    assert in_order == [Mode.STANDBY, Mode.STANDING, Mode.ACTIVE, Mode.STANDING, Mode.STANDBY]
    assert (rig.output.enable, rig.output.mode) == (False, BRAKE)


def test_a_disarmed_vehicle_that_drives_stops_for_good():
    rig = Rig(speed=1.5)
    rig.operator.arm = False
    rig.step()
    assert rig.status.mode == Mode.DAMPED
    for _ in range(100):
        rig.step()
    assert rig.travelled < 1.5**2 / (2 * CONFIG.brake_mps2) + 0.03


@settings(max_examples=200, deadline=None)
@given(
    steering=hnp.arrays(np.float64, (20, 4), elements=MOSTLY_SANE),
    speed=hnp.arrays(np.float64, (20, 4), elements=MOSTLY_SANE),
    start=st.floats(-2.0, 2.0),
)
def test_whatever_is_commanded_the_limits_hold(steering, speed, start):
    rig = Rig(speed=start)
    before = rig.task.state.steering.copy(), rig.task.state.speed.copy()
    for tick in range(20):
        rig.command.steering, rig.command.speed = steering[tick], speed[tick]
        rig.step()
        out = rig.output
        assert np.isfinite(out.steering).all()
        assert np.isfinite(out.speed).all()
        assert (np.abs(out.steering) <= CONFIG.steering_max_rad + 1e-9).all()
        assert (np.abs(out.speed) * RADIUS <= max(CONFIG.speed_max_mps, abs(start)) + 1e-9).all()
        assert (np.abs(out.steering - before[0]) <= CONFIG.steering_rate_max_radps * TICK_S + 1e-9).all()
        assert (np.abs(out.speed - before[1]) * RADIUS <= CONFIG.brake_mps2 * TICK_S + 1e-9).all()
        before = out.steering.copy(), out.speed.copy()
        if not (np.isfinite(steering[tick]).all() and np.isfinite(speed[tick]).all()):
            assert rig.status.mode == Mode.DAMPED
    assert (rig.status.fault & Fault.NON_FINITE_COMMAND != 0) == (rig.status.mode == Mode.DAMPED)


@given(hnp.arrays(np.float64, 4, elements=st.floats(-20, 20)), hnp.arrays(np.float64, 4, elements=st.floats(-20, 20)))
def test_what_is_limited_is_limited_alike(present, wanted):
    after = approached(present, wanted, 0.5)
    change, whole = after - present, wanted - present
    assert np.abs(change).max() <= 0.5 + 1e-9
    np.testing.assert_allclose(change * np.abs(whole).max(), whole * np.abs(change).max(), atol=1e-9)
    if np.abs(whole).max() <= 0.5:
        np.testing.assert_allclose(after, wanted, atol=1e-12)


def break_imu(rig):
    return {"keep": ("imu",)}


def freeze_imu(rig):
    return {"keep": ("noise",)}


def blind_imu(rig):
    rig.imu.angular_velocity[1] = np.nan


def spike_imu(rig):
    rig.imu.linear_acceleration[2] = 900.0


def turn_imu_back(rig):
    rig.imu.stamp_ns = rig.now_ns - 500 * MS
    return {"keep": ("imu",)}


def silence_wheels(rig):
    return {"keep": ("wheels",)}


def silence_a_wheel(rig):
    rig.mute = (2,)


def silence_the_temperatures(rig):
    rig.mute = (5,)


def report_a_fault(rig):
    rig.wheels.fault[6] = 2


def refuse_to_drive(rig):
    rig.refuses = True


def tip(rig):
    rig.body.orientation = (np.sin(0.55), 0.0, 0.0, np.cos(0.55))


def lose_tilt(rig):
    rig.body.orientation[0] = np.nan


def drain(rig):
    rig.battery.voltage = 15.0


def lose_bus(rig):
    rig.buses.state = BusState.OFF


def overrun(rig):
    rig.timing.overruns_in_a_row = 5


def stand_still(rig):
    rig.timing.gap_ns = CONFIG.gap_max_ns + 1


def stop_all(rig):
    rig.operator.emergency_stop = True


GRAVE = [
    (break_imu, Fault.STALE_IMU, 20),
    (freeze_imu, Fault.FROZEN_IMU, 110),
    (blind_imu, Fault.STALE_IMU | Fault.NON_FINITE_SENSOR, 20),
    (spike_imu, Fault.STALE_IMU | Fault.IMPLAUSIBLE_IMU, 20),
    (turn_imu_back, Fault.STALE_IMU | Fault.IMU_TIME, 20),
    (silence_wheels, Fault.STALE_MOTOR, 50),
    (silence_a_wheel, Fault.STALE_MOTOR, 50),
    (silence_the_temperatures, Fault.STALE_MOTOR, 500),
    (report_a_fault, Fault.MOTOR_FAULT, 0),
    (refuse_to_drive, Fault.MOTOR_FAULT, 300),
    (tip, Fault.TILT, 0),
    (lose_tilt, Fault.TILT, 0),
    (drain, Fault.VOLTAGE, 0),
    (lose_bus, Fault.BUS, 0),
    (overrun, Fault.OVERRUNS, 0),
    (stand_still, Fault.STOOD_STILL, 0),
    (stop_all, Fault.EMERGENCY_STOP, 0),
]


@pytest.mark.parametrize(("cause", "fault", "after_ms"), GRAVE, ids=[cause.__name__ for cause, _, _ in GRAVE])
def test_a_grave_fault_stops_the_vehicle_within_its_braking_distance_and_says_why(cause, fault, after_ms):
    rig = Rig(speed=1.5, steering=0.0)
    for _ in range(3):
        rig.step()
    assert rig.status.mode == Mode.ACTIVE
    how, since_ns, driven = cause(rig) or {}, rig.now_ns, rig.travelled
    while rig.status.mode == Mode.ACTIVE:
        rig.step(**how)
        assert rig.now_ns - since_ns <= (after_ms + 25) * MS
    seconds = (rig.now_ns - since_ns) * 1e-9
    assert rig.status.mode == Mode.DAMPED
    assert rig.status.fault & fault == fault
    for _ in range(100):
        rig.step(**how)
    assert (rig.output.enable, rig.output.mode) == (False, BRAKE)
    assert rig.travelled - driven <= 1.5 * (seconds + TICK_S) + 1.5**2 / (2 * CONFIG.brake_mps2)
    np.testing.assert_allclose(rig.path[-1][1:], 0.0, atol=1e-9)
    assert rig.status.faults == 1


def test_a_braked_vehicle_keeps_to_its_bend():
    rig = Rig(speed=1.5, steering=np.array([0.3, 0.3, -0.3, -0.3]))
    rig.operator.emergency_stop = True
    for _ in range(100):
        rig.step()
    path = np.array(rig.path)
    speed = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    bends = np.diff(path[:, 2])[speed > 1e-6] / speed[speed > 1e-6]
    np.testing.assert_allclose(bends, bends[0], rtol=1e-3)


@pytest.mark.parametrize("wheel", range(4))
def test_a_wheel_that_cannot_be_steered_by_the_units_word_is_stuck(wheel):
    rig = Rig(speed=1.0)
    rig.step()
    rig.wheels.fault[wheel] = 3
    rig.step()
    assert rig.status.fault == Fault.STUCK_STEERING | Fault.MOTOR_FAULT
    assert list(np.flatnonzero(rig.wheel_status.stuck)) == [wheel]


@pytest.mark.parametrize("wheel", range(4))
def test_a_vehicle_whose_steering_is_stuck_stops_straight(wheel):
    """It turns the others parallel to the stuck wheel, and no longer turns itself."""
    config = VehicleSafetyConfig(steering_stuck_ns=200 * MS)
    rig = Rig(speed=1.0, steering=0.25 * np.array([1.0, 1.0, 1.0, 1.0]), config=config)
    rig.jammed = (wheel,)
    rig.command.steering = 0.0
    while rig.status.mode != Mode.DAMPED:
        rig.step()
        assert rig.now_ns < 10_500 * MS
    assert rig.status.fault & Fault.STUCK_STEERING
    assert list(np.flatnonzero(rig.wheel_status.stuck)) == [wheel]
    steered_ns = rig.now_ns + round(0.25 / config.steering_rate_max_radps * 1e9) + 20 * MS
    headings = []
    while not rig.task.state.braked:
        rig.step()
        assert rig.now_ns < 11_000 * MS
        if rig.now_ns > steered_ns:
            headings.append(rig.path[-1][2])
            assert np.linalg.norm((rig.path[-1] - rig.path[-2])[:2]) > 0.0 or rig.task.state.braked
    assert len(headings) > 10
    np.testing.assert_allclose(headings, headings[0], atol=1e-6)
    assert rig.path[-1][2] == pytest.approx(0.0, abs=0.1)


def test_a_stop_that_does_not_come_to_an_end_ends_in_the_brakes():
    rig = Rig(speed=1.5)
    rig.operator.emergency_stop = True
    roll, rig.roll = rig.roll, lambda: None
    since_ns = rig.now_ns
    while not rig.task.state.braked:
        rig.step()
    assert CONFIG.stop_max_ns <= rig.now_ns - since_ns <= CONFIG.stop_max_ns + 20 * MS
    rig.roll = roll
    rig.step()
    assert (rig.output.enable, rig.output.mode) == (False, BRAKE)


def silence_operator(rig):
    return {"keep": ("operator",)}


def silence_tracker(rig):
    return {"keep": ("twist",)}


def silence_steering(rig):
    return {"keep": ("command",)}


def lose_localisation(rig):
    rig.body.localization_age_ns = 2_000 * MS


def move_localisation(rig):
    rig.body.localization_disputed = 10


def release(rig):
    rig.operator.held = False


def heat(rig):
    rig.wheels.temperature[1] = 90.0


HALTING = [
    (silence_operator, Fault.STALE_OPERATOR),
    (silence_tracker, Fault.STALE_BODY_COMMAND),
    (silence_steering, Fault.STALE_BODY_COMMAND),
    (lose_localisation, Fault.STALE_LOCALIZATION),
    (move_localisation, Fault.MOVED_LOCALIZATION),
    (release, Fault.NO_LEASE),
    (heat, Fault.TEMPERATURE),
]


@pytest.mark.parametrize(("cause", "fault"), HALTING, ids=[cause.__name__ for cause, _ in HALTING])
def test_what_may_pass_slows_the_vehicle_to_a_stand_and_it_goes_on(cause, fault):
    rig = Rig(speed=1.0)
    rig.step()
    clean = {name: getattr(rig, name).to_bytes() for name in ("operator", "body", "wheels")}
    how, before = cause(rig) or {}, 1.0 / RADIUS
    for _ in range(200):
        rig.step(**how)
        assert 0.0 <= before - rig.output.speed[0] <= CONFIG.halt_mps2 * TICK_S / RADIUS + 1e-9
        before = rig.output.speed[0]
    assert rig.status.mode == Mode.ACTIVE
    assert rig.status.halt & fault
    assert rig.status.fault == 0
    assert not rig.output.speed.any()
    assert rig.output.enable
    for name, body in clean.items():
        getattr(rig, name).load(body)
    for _ in range(200):
        rig.step()
    assert rig.status.halt == 0
    np.testing.assert_allclose(rig.output.speed, 1.0 / RADIUS)


def test_the_stop_is_latched_until_a_reset_at_rest_with_the_arm_withdrawn():
    rig = Rig(speed=1.5)
    rig.operator.emergency_stop = True
    rig.step()
    rig.operator.emergency_stop = False
    rig.operator.arm, rig.operator.reset = False, True
    rig.step()
    assert rig.status.mode == Mode.DAMPED, "it still rolls"
    rig.operator.arm = True
    for _ in range(100):
        rig.step()
    assert rig.status.mode == Mode.DAMPED, "the arm is held"
    rig.operator.arm, rig.operator.reset = False, False
    rig.step()
    assert rig.status.mode == Mode.DAMPED, "nobody asked"
    rig.operator.reset = True
    rig.step()
    assert rig.status.mode == Mode.STANDBY
    assert not rig.output.enable


def test_a_late_frame_is_bridged_and_counted():
    rig = Rig(speed=1.0)
    rig.step()
    rig.step(keep=("wheels",))
    rig.step(keep=("wheels",))
    assert rig.status.warning == Fault.MISSING_REPLY
    assert rig.status.coasted == 5
    rig.step()
    assert rig.status.warning == 0
    assert rig.status.mode == Mode.ACTIVE


def test_a_restored_filter_goes_on_bit_for_bit():
    one, other = Rig(speed=1.0), Rig(speed=1.0)
    for tick in range(120):
        for rig in (one, other):
            rig.operator.emergency_stop = tick > 70
            rig.command.steering = 0.1
            rig.step()
        if tick == 80:
            state = one.task.save()
            other.task.state.clear()
            other.task.restore(state)
    assert one.output.to_bytes() == other.output.to_bytes()
    assert one.status.to_bytes() == other.status.to_bytes()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"halt_mps2": 5.0}, "halt_mps2 = 5.0 is above brake_mps2"),
        ({"voltage_min_v": 40.0}, "voltage_min_v = 40.0 is not below"),
        ({"stop_max_ns": 100 * MS}, "stop_max_ns = 100000000 is below"),
        ({"state_late_ns": 80 * MS}, "state_late_ns = 80000000 is above state_age_max_ns"),
    ],
)
def test_bounds_that_contradict_each_other_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        VehicleSafetyConfig(**values).check()
