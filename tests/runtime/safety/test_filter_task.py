# SPDX-License-Identifier: Apache-2.0
"""Whatever is commanded and whatever breaks: limits hold, each fault has its name, and damping is damping."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from runtime import signals
from runtime.errors import ConfigError
from runtime.models.inertial import InertialConfig
from runtime.safety.config import SafetyConfig
from runtime.safety.filter_task import SafetyTask
from runtime.safety.limits import joint_bounds, tilt
from runtime.signals import BusState, Fault, Mode, Motion, Stance

SIZES = {"joint": 12, "foot": 4, "foot_xyz": 12, "knot": 11, "horizon_foot": 40, "horizon_xyz": 120, "bus": 4}
CONFIG = SafetyConfig()
MS = 1_000_000
ANY = st.floats(allow_nan=True, allow_infinity=True)
MOSTLY_SANE = st.one_of(st.floats(-100.0, 100.0), ANY)


class Rig:
    """A safety filter with healthy inputs, in a mode."""

    def __init__(self, mode=Mode.ACTIVE, config=CONFIG):
        self.now_ns = 10_000 * MS
        self.imu, self.battery = signals.Imu("/imu"), signals.Battery("/battery")
        self.joints, self.body = signals.JointState("/joints", SIZES), signals.BodyState("/body", SIZES)
        self.operator, self.posture = signals.OperatorRequest("/operator"), signals.Posture("/posture", SIZES)
        self.gait, self.forces = signals.Gait("/gait", SIZES), signals.ContactForces("/forces", SIZES)
        self.command, self.output = (signals.JointCommand(topic, SIZES) for topic in ("/command", "/safe"))
        self.status = signals.SafetyStatus("/status")
        self.buses, self.timing = signals.BusStatus("/buses", SIZES), signals.LoopTiming("/timing")
        self.body_command = signals.BodyCommand("/body_command")
        self.low, self.high = joint_bounds(config)
        self.joints.position = 0.5 * (self.low + self.high)
        self.joints.temperature = 40.0
        self.body.orientation = (0.0, 0.0, 0.0, 1.0)
        self.battery.voltage = 29.0
        self.operator.motion, self.operator.arm, self.operator.held = Motion.WALK, True, True
        self.posture.stance = Stance.STANDING
        self.gait.walking, self.gait.balancing = True, True
        self.command.position = self.joints.position
        self.command.stiffness, self.command.damping = 30.0, 1.0
        self.task = SafetyTask(
            config,
            InertialConfig(),
            2 * MS,
            self.imu,
            self.joints,
            self.body,
            self.battery,
            self.buses,
            self.timing,
            self.operator,
            self.posture,
            self.gait,
            self.body_command,
            self.forces,
            self.command,
            self.output,
            self.status,
        )
        self.task.state.mode = mode

    def step(self, keep=()):
        """One tick with everything fresh, but for what `keep` names."""
        self.now_ns += 2 * MS
        for name in ("imu", "forces", "operator", "body_command"):
            if name not in keep:
                getattr(self, name).stamp_ns = self.now_ns
        if "noise" not in keep:
            self.imu.linear_acceleration[0] += 1e-3
        if "joints" not in keep:
            self.joints.reply_ns = self.now_ns - MS
        self.task.step(self.now_ns)
        return self.status

    @property
    def damping(self):
        return (
            not self.output.stiffness.any()
            and not self.output.effort.any()
            and not self.output.velocity.any()
            and (self.output.damping == CONFIG.damping_nms_prad).all()
        )


def test_a_healthy_robot_is_left_alone():
    rig = Rig()
    rig.command.effort, rig.command.velocity = 5.0, 2.0
    rig.step()
    for name in ("position", "velocity", "effort", "stiffness", "damping"):
        np.testing.assert_array_equal(getattr(rig.output, name), getattr(rig.command, name))
    assert (rig.status.mode, rig.status.fault, rig.status.warning, rig.status.limited) == (Mode.ACTIVE, 0, 0, 0)
    assert rig.output.stamp_ns == rig.now_ns


@settings(max_examples=300)
@given(
    *(hnp.arrays(np.float64, 12, elements=MOSTLY_SANE) for _ in range(3)),
    hnp.arrays(np.float64, (2, 12), elements=MOSTLY_SANE),
)
def test_any_command_comes_out_finite_and_within_limits_or_as_damping(position, velocity, effort, gains):
    rig = Rig()
    rig.command.position, rig.command.velocity, rig.command.effort = position, velocity, effort
    rig.command.stiffness, rig.command.damping = gains
    rig.step()
    out = rig.output
    for name in ("position", "velocity", "effort", "stiffness", "damping"):
        assert np.isfinite(getattr(out, name)).all()
    assert (np.abs(out.effort) <= CONFIG.effort_max_nm).all()
    assert (np.abs(out.velocity) <= CONFIG.velocity_max_radps).all()
    assert ((out.stiffness >= 0.0) & (out.stiffness <= CONFIG.stiffness_max_nm_prad)).all()
    assert ((out.damping >= 0.0) & (out.damping <= CONFIG.damping_max_nms_prad)).all()
    if rig.damping:
        assert rig.status.mode == Mode.DAMPED
    else:
        assert (out.position >= rig.low).all()
        assert (out.position <= rig.high).all()
        passed = (out.position, out.velocity, out.effort, out.stiffness, out.damping)
        altered = np.not_equal(passed, (position, velocity, effort, *gains))
        assert rig.status.limited == np.count_nonzero(altered)
    if not all(np.isfinite(part).all() for part in (position, velocity, effort, gains)):
        assert rig.damping
        assert rig.status.fault & Fault.NON_FINITE_COMMAND


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_commanded_velocity_is_limited(sign):
    """The issue asks for it: torque, velocity, position and rate limits."""
    rig = Rig(config=SafetyConfig(velocity_max_radps=12.0))
    rig.command.velocity = sign * 1e6
    rig.step()
    np.testing.assert_array_equal(rig.output.velocity, sign * 12.0)
    assert rig.status.mode == Mode.ACTIVE
    assert rig.status.limited == 12


@pytest.mark.parametrize(
    ("stiffness", "damping", "expected", "limited"),
    [
        (-30.0, -1.0, (0.0, 0.0), 24),
        (1e6, 1e6, (80.0, 2.0), 24),
        (80.0, 2.0, (80.0, 2.0), 0),
        (81.0, 1.0, (80.0, 1.0), 12),
    ],
)
def test_gains_are_never_negative_nor_beyond_their_limits(stiffness, damping, expected, limited):
    rig = Rig(config=SafetyConfig(stiffness_max_nm_prad=80.0, damping_max_nms_prad=2.0))
    rig.command.stiffness, rig.command.damping = stiffness, damping
    rig.step()
    np.testing.assert_array_equal(rig.output.stiffness, expected[0])
    np.testing.assert_array_equal(rig.output.damping, expected[1])
    assert rig.status.limited == limited


SANE = st.floats(-100.0, 100.0)


@settings(max_examples=300)
@given(hnp.arrays(np.float64, (3, 12), elements=SANE), hnp.arrays(np.float64, (2, 12), elements=SANE), st.booleans())
def test_a_drive_is_asked_for_no_more_than_its_bound_if_less_feed_forward_can_see_to_it(wanted, gains, derated):
    rig, strongest = Rig(), CONFIG.effort_max_nm
    if derated:
        rig.joints.temperature[3], strongest = CONFIG.temperature_max_degc + 1.0, CONFIG.derated_effort_nm
    rig.joints.velocity = np.linspace(-0.9, 0.9, 12) * CONFIG.velocity_max_radps
    rig.command.position, rig.command.velocity, rig.command.effort = wanted
    rig.command.stiffness, rig.command.damping = gains
    for _ in range(3):
        rig.step()
    out = rig.output
    held = out.stiffness * (out.position - rig.joints.position) + out.damping * (out.velocity - rig.joints.velocity)
    assert (np.abs(held + out.effort) <= np.maximum(strongest, np.abs(held) - strongest) + 1e-9).all()
    assert (np.abs(out.effort) <= strongest).all()


def test_feed_forward_gives_way_to_what_stiffness_and_damping_add():
    rig = Rig()
    rig.command.position = rig.joints.position + 0.1
    rig.joints.velocity = -2.0
    rig.command.effort, added = 32.0, 30.0 * 0.1 + 1.0 * 2.0
    rig.step()
    np.testing.assert_allclose(rig.output.effort, CONFIG.effort_max_nm - added)
    assert rig.status.limited == 12


def test_torque_changes_no_faster_than_its_rate():
    config = SafetyConfig(effort_rate_max_nmps=1000.0)
    rig = Rig(config=config)
    rig.command.effort = 30.0
    reached = []
    for _ in range(16):
        rig.step()
        reached.append(rig.output.effort[0])
    np.testing.assert_allclose(np.diff([0.0, *reached]), [2.0] * 15 + [0.0], atol=1e-9)
    rig.command.effort = -30.0
    rig.step()
    assert rig.output.effort[0] == pytest.approx(28.0)


BREAK = {
    "silent motor": (lambda rig: rig.joints.reply_ns.__setitem__(7, 0), ("joints",), Fault.STALE_MOTOR),
    "motor error": (lambda rig: rig.joints.error.__setitem__(3, 2), (), Fault.MOTOR_FAULT),
    "under-voltage": (lambda rig: setattr(rig.battery, "voltage", 19.9), (), Fault.VOLTAGE),
    "over-voltage": (lambda rig: setattr(rig.battery, "voltage", 34.1), (), Fault.VOLTAGE),
    "tilt": (lambda rig: setattr(rig.body, "orientation", (np.sin(0.505), 0, 0, np.cos(0.505))), (), Fault.TILT),
    "upside down": (lambda rig: setattr(rig.body, "orientation", (1.0, 0, 0, 0)), (), Fault.TILT),
    "orientation is nan": (lambda rig: setattr(rig.body, "orientation", (0, np.nan, 0, 1)), (), Fault.TILT),
    "speed": (lambda rig: rig.joints.velocity.__setitem__(2, -30.1), (), Fault.JOINT_VELOCITY),
    "speed is nan": (lambda rig: rig.joints.velocity.__setitem__(2, np.nan), (), Fault.JOINT_VELOCITY),
    "position": (lambda rig: rig.joints.position.__setitem__(4, rig.high[4] + 0.16), (), Fault.JOINT_POSITION),
    "position is nan": (lambda rig: rig.joints.position.__setitem__(4, np.nan), (), Fault.JOINT_POSITION),
    "command is nan": (lambda rig: rig.command.damping.__setitem__(0, np.nan), (), Fault.NON_FINITE_COMMAND),
    "command is infinite": (lambda rig: rig.command.effort.__setitem__(0, -np.inf), (), Fault.NON_FINITE_COMMAND),
    "bus off": (lambda rig: rig.buses.state.__setitem__(1, BusState.OFF), (), Fault.BUS),
    "bus down": (lambda rig: rig.buses.state.__setitem__(3, BusState.DOWN), (), Fault.BUS),
    "bus flooded": (lambda rig: rig.buses.backlog.__setitem__(0, True), (), Fault.BUS),
    "bus full": (lambda rig: rig.buses.refused.__setitem__(2, 1), (), Fault.BUS),
    "overruns": (lambda rig: setattr(rig.timing, "overruns_in_a_row", 5), (), Fault.OVERRUNS | Fault.LATE_LOOP),
    "stood still": (lambda rig: setattr(rig.timing, "gap_ns", CONFIG.gap_max_ns + 1), (), Fault.STOOD_STILL),
    "emergency stop": (lambda rig: setattr(rig.operator, "emergency_stop", True), (), Fault.EMERGENCY_STOP),
}


@pytest.mark.parametrize("name", BREAK)
def test_each_cause_raises_its_own_fault_and_damps(name):
    cause, keep, fault = BREAK[name]
    rig = Rig()
    rig.step()
    assert rig.status.mode == Mode.ACTIVE
    assert not rig.damping
    cause(rig)
    rig.step(keep)
    assert rig.status.mode == Mode.DAMPED
    assert Fault(rig.status.fault) & ~Fault.MISSING_REPLY == fault
    assert rig.status.fault == rig.status.warning
    assert rig.status.faults == 1
    if "nan" in name and "position" in name:
        return
    assert rig.damping


@pytest.mark.parametrize("name", BREAK)
def test_a_fault_stays_latched_when_its_cause_has_gone(name):
    cause, keep, _ = BREAK[name]
    rig, healthy = Rig(), Rig()
    cause(rig)
    rig.step(keep)
    fault = rig.status.fault
    assert fault
    for part in ("joints", "body", "battery", "command", "buses", "timing"):
        getattr(rig, part).copy_from(getattr(healthy, part))
    rig.operator.emergency_stop = False
    for _ in range(20):
        rig.step()
        assert rig.damping
        assert rig.status.mode == Mode.DAMPED
        assert rig.status.fault == fault


def test_a_loop_that_stood_still_no_longer_than_its_drives_wait_goes_on_and_so_does_a_robot_without_power():
    rig = Rig()
    rig.step()
    rig.timing.gap_ns = CONFIG.gap_max_ns
    rig.step()
    assert (rig.status.mode, rig.status.fault) == (Mode.ACTIVE, 0)
    idle = Rig(mode=Mode.STANDBY)
    idle.operator.arm, idle.timing.gap_ns = False, 10**12
    idle.step()
    assert (idle.status.mode, idle.status.fault) == (Mode.STANDBY, 0)


HALT = {
    "stale forces": (lambda rig: None, ("forces",), Fault.STALE_FORCES, CONFIG.forces_age_max_ns),
    "stale command": (lambda rig: None, ("body_command",), Fault.STALE_BODY_COMMAND, CONFIG.command_age_max_ns),
    "stale operator": (lambda rig: None, ("operator",), Fault.STALE_OPERATOR, CONFIG.operator_age_max_ns),
    "no lease": (lambda rig: setattr(rig.operator, "held", False), (), Fault.NO_LEASE, 0),
    "late loop": (lambda rig: setattr(rig.timing, "overruns_in_a_row", 3), (), Fault.LATE_LOOP, 0),
    "lost": (
        lambda rig: setattr(rig.body, "localization_age_ns", CONFIG.localization_age_max_ns + 1),
        (),
        Fault.STALE_LOCALIZATION,
        0,
    ),
    "moved": (
        lambda rig: setattr(rig.body, "localization_disputed", CONFIG.disputed_poses_max),
        (),
        Fault.MOVED_LOCALIZATION,
        0,
    ),
}


@pytest.mark.parametrize("name", HALT)
def test_some_causes_halt_the_robot_and_let_it_go_on_when_they_are_gone(name):
    cause, keep, fault, age_ns = HALT[name]
    rig = Rig()
    rig.step()
    assert rig.status.halt == 0
    cause(rig)
    for _ in range(age_ns // (2 * MS)):
        rig.step(keep)
        assert rig.status.halt == 0, "within its bound it is no fault"
    rig.step(keep)
    assert Fault(rig.status.halt) == fault
    assert rig.status.mode == Mode.ACTIVE
    assert rig.status.fault == 0
    assert not rig.damping
    healthy = Rig()
    for part in ("body", "timing"):
        getattr(rig, part).copy_from(getattr(healthy, part))
    rig.operator.held = True
    for _ in range(2 + CONFIG.overruns_stand_ns // (2 * MS)):
        rig.step()
    assert rig.status.halt == 0


def test_a_plan_that_stays_away_is_held_then_stood_on_and_then_given_up():
    rig = Rig()
    rig.step()
    seen = []
    while rig.status.mode == Mode.ACTIVE:
        rig.step(("forces",))
        seen.append(Fault(rig.status.warning))
    late, stale = CONFIG.forces_late_ns // (2 * MS), CONFIG.forces_age_max_ns // (2 * MS)
    gone = (CONFIG.forces_age_max_ns + CONFIG.forces_stand_max_ns) // (2 * MS)
    assert seen.index(Fault.LATE_FORCES) == late
    assert seen.index(Fault.LATE_FORCES | Fault.STALE_FORCES) == stale
    assert len(seen) == gone + 1
    assert Fault(rig.status.fault) == Fault.LATE_FORCES | Fault.STALE_FORCES | Fault.NO_FORCES


def test_plans_count_from_when_the_legs_need_them():
    rig = Rig()
    rig.gait.walking = rig.gait.balancing = False
    for _ in range(1000):
        rig.step(("forces", "body_command"))
    assert rig.status.warning == 0
    rig.gait.balancing = True
    for _ in range(CONFIG.forces_late_ns // (2 * MS)):
        assert rig.step(("forces", "body_command")).warning == 0
    assert rig.step(("forces", "body_command")).warning == Fault.LATE_FORCES


def test_a_missing_reply_is_bridged_and_the_fourth_in_a_row_damps():
    rig = Rig()
    rig.step()
    for missing in range(1, CONFIG.missing_replies_max + 1):
        rig.step(("joints",))
        assert (rig.status.mode, Fault(rig.status.warning)) == (Mode.ACTIVE, Fault.MISSING_REPLY)
        assert rig.status.coasted == 12 * missing
    rig.step(("joints",))
    assert rig.damping
    assert rig.status.fault == Fault.STALE_MOTOR


def test_replies_are_counted_by_ticks_and_not_by_their_age():
    """After a stall the replies are old, but nobody was asked meanwhile."""
    rig = Rig()
    rig.step()
    for _ in range(10):
        rig.now_ns += 30 * MS
        rig.step()
        assert rig.status.mode == Mode.ACTIVE
        assert rig.status.coasted == 0


def test_a_reply_in_between_starts_the_count_anew():
    rig = Rig()
    for tick in range(100):
        rig.step(() if tick % 4 == 0 else ("joints",))
        assert rig.status.mode == Mode.ACTIVE


def broken_imu(rig, which, tick):
    """Let the IMU go wrong in one way; what to keep from being refreshed."""
    if which == "silent":
        return ("imu",)
    if which == "frozen":
        return ("noise",)
    if which == "nan":
        rig.imu.angular_velocity[1] = np.nan
    if which == "spiking":
        rig.imu.linear_acceleration[2] = 500.0 * (-1) ** tick
    return ()


IMU = {
    "silent": Fault.STALE_IMU,
    "frozen": Fault.FROZEN_IMU,
    "nan": Fault.STALE_IMU | Fault.NON_FINITE_SENSOR,
    "spiking": Fault.STALE_IMU | Fault.IMPLAUSIBLE_IMU,
}


@pytest.mark.parametrize("which", IMU)
def test_without_an_imu_the_robot_crouches_and_is_then_damped(which):
    rig = Rig()
    rig.step()
    for tick in range(CONFIG.imu_age_max_ns // (2 * MS)):
        rig.step(broken_imu(rig, which, tick))
        if rig.status.mode == Mode.CROUCHING:
            break
    rig.step(broken_imu(rig, which, 99))
    assert rig.status.mode == Mode.CROUCHING
    assert Fault(rig.status.fault) == IMU[which]
    assert rig.status.faults == 1
    assert not rig.damping, "crouching takes power"
    rig.body.orientation = (1.0, 0.0, 0.0, 0.0)
    rig.step(broken_imu(rig, which, 100))
    assert rig.status.mode == Mode.CROUCHING, "without an IMU the tilt is not known"
    rig.posture.stance = Stance.RESTING
    rig.step(broken_imu(rig, which, 101))
    assert rig.damping
    assert rig.status.faults == 1


def test_time_that_runs_backwards_is_no_sample():
    rig = Rig()
    rig.step()
    for _ in range(20):
        rig.imu.stamp_ns -= MS
        rig.step(("imu",))
    assert rig.status.mode == Mode.CROUCHING
    assert Fault(rig.status.fault) == Fault.STALE_IMU | Fault.IMU_TIME


def test_crouching_ends_in_time_whatever_the_posture_says():
    rig = Rig()
    rig.step()
    for _ in range((CONFIG.imu_age_max_ns + CONFIG.crouch_max_ns) // (2 * MS) + 3):
        rig.step(("imu",))
    assert rig.damping


def test_a_crouching_robot_with_another_fault_is_damped_at_once():
    rig = Rig()
    for _ in range(15):
        rig.step(("imu",))
    assert rig.status.mode == Mode.CROUCHING
    rig.joints.error[2] = 1
    rig.step(("imu",))
    assert rig.damping
    assert Fault(rig.status.fault) == Fault.STALE_IMU | Fault.MOTOR_FAULT


DERATE = {
    "temperature": (lambda rig: rig.joints.temperature.__setitem__(11, 85.1), Fault.TEMPERATURE),
    "motor_fault": (lambda rig: rig.joints.error.__setitem__(3, 2), Fault.MOTOR_FAULT),
    "voltage": (lambda rig: setattr(rig.battery, "voltage", 19.9), Fault.VOLTAGE),
    "saturation": (lambda rig: rig.joints.effort.__setitem__(5, -32.5), Fault.SATURATION),
}


@pytest.mark.parametrize("name", DERATE)
@pytest.mark.parametrize("answer", ["damp", "derate"])
def test_what_may_be_borne_for_a_while_is_answered_as_configured(name, answer):
    config = SafetyConfig(**{name: answer})
    rig = Rig(config=config)
    rig.command.effort = 25.0
    rig.step()
    cause, fault = DERATE[name]
    cause(rig)
    for _ in range(1 + (config.saturation_ns // (2 * MS) if name == "saturation" else 0)):
        rig.step()
    if answer == "damp":
        assert rig.damping
        assert rig.status.fault == fault
        return
    assert (rig.status.mode, Fault(rig.status.halt), rig.status.derated) == (Mode.ACTIVE, fault, True)
    np.testing.assert_array_equal(rig.output.effort, config.derated_effort_nm)
    for _ in range(config.derate_ns // (2 * MS)):
        assert rig.step().mode == Mode.ACTIVE
    assert rig.step().mode == Mode.DAMPED
    assert rig.status.fault == fault


def test_torque_returns_some_time_after_the_cause_has_gone():
    rig = Rig()
    rig.command.effort = 25.0
    rig.joints.temperature[4] = 90.0
    rig.step()
    rig.joints.temperature[4] = 40.0
    for _ in range(CONFIG.derate_clear_ns // (2 * MS)):
        rig.step()
        assert rig.status.derated
        assert rig.status.halt == Fault.TEMPERATURE
    rig.step()
    rig.step()
    assert not rig.status.derated
    assert rig.status.halt == 0
    np.testing.assert_array_equal(rig.output.effort, 25.0)


def test_a_cause_that_comes_and_goes_is_not_borne_for_ever():
    rig = Rig()
    for tick in range(2 + CONFIG.derate_ns // (2 * MS) + CONFIG.derate_clear_ns // (2 * MS)):
        rig.joints.temperature[4] = 90.0 if tick % 100 == 0 else 40.0
        rig.step()
    assert rig.status.mode == Mode.DAMPED


def test_no_robot_stands_up_with_a_fault_that_a_standing_one_would_bear():
    rig = Rig(Mode.STANDBY)
    rig.operator.arm = False
    rig.joints.temperature[4] = 90.0
    rig.step()
    assert rig.status.mode == Mode.DAMPED


def test_out_of_damped_by_reset_and_then_a_separate_arm():
    rig = Rig(Mode.DAMPED)
    rig.posture.stance = Stance.RESTING
    rig.operator.reset = True
    rig.step()
    assert rig.status.mode == Mode.DAMPED, "the arm is still held"
    rig.operator.arm = False
    rig.step()
    assert rig.status.mode == Mode.STANDBY
    assert rig.damping
    assert rig.status.fault == 0
    rig.operator.reset = False
    for _ in range(5):
        rig.step()
        assert rig.status.mode == Mode.STANDBY
        assert rig.damping
    rig.operator.arm = True
    rig.step()
    assert rig.status.mode == Mode.STANDING
    assert rig.damping
    rig.step()
    assert not rig.damping


@pytest.mark.parametrize("which", ["linear_acceleration", "angular_velocity"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_sensor_value_that_is_not_finite_is_a_warning_only(which, value):
    rig = Rig()
    rig.step()
    getattr(rig.imu, which)[1] = value
    rig.step()
    assert (rig.status.mode, Fault(rig.status.warning), rig.status.fault) == (Mode.ACTIVE, Fault.NON_FINITE_SENSOR, 0)
    assert not rig.damping


def test_inertial_samples_that_stay_bad_are_as_good_as_none():
    rig = Rig()
    rig.step()
    rig.imu.angular_velocity[1] = np.nan
    for _ in range(CONFIG.imu_age_max_ns // (2 * MS)):
        rig.step()
        assert (rig.status.mode, Fault(rig.status.warning)) == (Mode.ACTIVE, Fault.NON_FINITE_SENSOR)
    rig.step()
    assert rig.status.mode == Mode.CROUCHING
    assert Fault(rig.status.fault) == Fault.NON_FINITE_SENSOR | Fault.STALE_IMU


def test_a_good_inertial_sample_in_between_is_enough():
    rig = Rig()
    for tick in range(50):
        rig.imu.angular_velocity[1] = 0.0 if tick % 9 == 0 else np.nan
        rig.step()
        assert rig.status.mode == Mode.ACTIVE


def test_opposite_infinities_do_not_cancel():
    rig = Rig()
    rig.step()
    rig.imu.linear_acceleration = (np.inf, -np.inf, 0.0)
    rig.step()
    assert rig.status.warning == Fault.NON_FINITE_SENSOR
    rig.command.effort[:2] = np.inf, -np.inf
    rig.step()
    assert rig.status.fault & Fault.NON_FINITE_COMMAND
    assert rig.damping


def test_a_joint_that_sank_beyond_its_limits_without_power_may_come_back_but_not_go_further():
    rig = Rig(Mode.STANDBY)
    rig.posture.stance = Stance.RESTING
    for beyond in (0.5, 0.4, 0.55, 0.3, 0.1, 0.0):
        rig.joints.position[4] = rig.high[4] + beyond
        rig.step()
        assert rig.status.mode == Mode.STANDING
    rig.joints.position[4] = rig.high[4] + CONFIG.position_margin_rad + 0.01
    rig.step()
    assert Fault(rig.status.fault) == Fault.JOINT_POSITION


@pytest.mark.parametrize("stance", [Stance.GATHERING, Stance.RISING])
def test_while_the_robot_gets_up_a_sunken_joint_may_be_where_it_lay_and_no_longer(stance):
    rig = Rig(Mode.STANDBY)
    rig.posture.stance = Stance.RESTING
    rig.joints.position[4] = rig.high[4] + 0.5
    rig.step()
    rig.posture.stance = stance
    for beyond in (0.5, 0.0, 0.5, 0.1):
        rig.joints.position[4] = rig.high[4] + beyond
        assert rig.step().mode == Mode.STANDING
    rig.posture.stance = Stance.STANDING
    rig.step()
    rig.joints.position[4] = rig.high[4] + 0.5
    rig.step()
    assert Fault(rig.status.fault) == Fault.JOINT_POSITION


@pytest.mark.parametrize("beyond", [0.66, np.nan])
def test_a_sunken_joint_that_goes_further_damps(beyond):
    rig = Rig(Mode.STANDBY)
    rig.posture.stance = Stance.RESTING
    rig.joints.position[4] = rig.high[4] + 0.5
    rig.step()
    assert rig.step().mode == Mode.STANDING
    rig.joints.position[4] = rig.high[4] + beyond
    rig.step()
    assert rig.damping
    assert Fault(rig.status.fault) == Fault.JOINT_POSITION


def test_a_drive_that_reports_no_temperature_is_not_hot():
    rig = Rig()
    rig.joints.temperature = np.nan
    assert rig.step().mode == Mode.ACTIVE
    rig.joints.temperature[5] = 90.0
    assert rig.step().halt == Fault.TEMPERATURE


@pytest.mark.parametrize("mode", [Mode.OFF, Mode.STANDBY, Mode.DAMPED])
def test_without_power_the_output_is_damping_whatever_is_commanded(mode):
    rig = Rig(mode)
    rig.operator.arm = False
    rig.command.effort = 20.0
    for _ in range(5):
        rig.step()
        assert rig.damping


def test_a_robot_whose_drives_never_answered_stays_off():
    rig = Rig(Mode.OFF)
    rig.joints.reply_ns = 0
    for _ in range(50):
        assert rig.step(("joints",)).mode == Mode.OFF
    assert rig.step().mode == Mode.STANDBY


def test_right_legs_have_mirrored_abad_limits():
    low, high = joint_bounds(SafetyConfig(position_min_rad=(-0.4, -2.0, 0.1), position_max_rad=(0.9, 1.0, 2.0)))
    assert low[[0, 3, 6, 9]].tolist() == [-0.4, -0.9, -0.4, -0.9]
    assert high[[0, 3, 6, 9]].tolist() == [0.9, 0.4, 0.9, 0.4]
    assert low.reshape(4, 3)[:, 1:].tolist() == [[-2.0, 0.1]] * 4


@given(st.floats(-3.1, 3.1), st.floats(0.0, 3.1), st.floats(-3.1, 3.1))
def test_tilt_is_the_angle_of_the_trunks_z_axis_at_any_yaw(yaw, angle, direction):
    half = 0.5 * angle
    lean = np.array([np.cos(direction) * np.sin(half), np.sin(direction) * np.sin(half), 0.0, np.cos(half)])
    z, w = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    turned = np.array(
        [w * lean[0] - z * lean[1], w * lean[1] + z * lean[0], w * lean[2] + z * lean[3], w * lean[3] - z * lean[2]]
    )
    assert tilt(turned) == pytest.approx(angle, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position_min_rad": (0.0, 2.0, 0.0)}, "position_min_rad = 2.0 is not below position_max_rad = 1.5"),
        ({"forces_late_ns": 300_000_000}, "forces_late_ns = 300000000 is above forces_age_max_ns = 200000000"),
        ({"overruns_stand": 6}, "overruns_stand = 6 is above overruns_damp = 5"),
        ({"voltage_min_v": 40.0}, "voltage_min_v = 40.0 is not below voltage_max_v = 34.0"),
    ],
)
def test_limits_that_contradict_each_other_are_named(change, message):
    with pytest.raises(ConfigError, match=message):
        SafetyConfig(**change).check()
