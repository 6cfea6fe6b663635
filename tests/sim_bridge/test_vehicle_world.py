# SPDX-License-Identifier: Apache-2.0
"""The vehicle in its world, driven by frames: it moves as its wheels stand, and its unit brakes by itself."""

import itertools
import math

import msgspec
import mujoco
import numpy as np
import pytest

from drivers.guarded_frames import Flaw
from drivers.memory_bus import End, MemoryBus
from drivers.vcu import UnitCommandMode, UnitMode, UnitReadings, VehicleUnit, WheelFault
from drivers.vcu_database import OWN_DBC, UnitDatabase
from runtime.robots import load_configuration
from runtime.signals import Pose
from runtime.vehicle_signals import VehicleTruth
from sim_bridge import terrain
from sim_bridge.ground_friction import FrictionPatch, friction_at
from sim_bridge.vehicle_model import build
from sim_bridge.vehicle_world import VehicleWorld

MS = 1_000_000
CONFIG = load_configuration("4ws4wd")
VEHICLE, PHYSICS = CONFIG.vehicle, CONFIG.simulation
STRAIGHT = (0.0,) * 4
FIELD = terrain.flat((-6.0, 6.0, -6.0, 6.0))


def wheels_for(forward, left, yaw_rate):
    """Angles and speeds of the wheels for a twist of the centre, angles within 90 degrees."""
    x, y = VEHICLE.wheel_positions().T
    along, across = forward - yaw_rate * y, left + yaw_rate * x
    angle, speed = np.arctan2(across, along), np.hypot(along, across) / VEHICLE.wheel_radius_m
    back = np.abs(angle) > math.pi / 2 + 1e-9
    return np.where(back, angle - np.copysign(math.pi, angle), angle), np.where(back, -speed, speed)


class Rig:
    """A vehicle and the driver of its unit."""

    def __init__(self, ground=None, seed=0, patches=(), **changes):
        self.config = msgspec.structs.replace(PHYSICS, **changes)
        self.bus = MemoryBus(1, 500_000)
        self.world = VehicleWorld(
            VEHICLE, self.config, UnitDatabase(), ground, self.bus, seed, (0.0, 0.0, 0.0), patches
        )
        self.driver, self.readings = VehicleUnit(10**9), UnitReadings.empty()
        self.now_ns, self.track = 0, []

    def run(self, seconds, angles=STRAIGHT, speeds=STRAIGHT, mode=UnitCommandMode.DRIVE, enable=True, silent=False):
        for _ in range(round(100 * seconds)):
            arrived = self.bus.receive(End.HOST, self.now_ns)
            self.driver.decode(*arrived, arrived.bus.size, self.readings)
            if not silent:
                values = np.array(angles, float), np.array(speeds, float)
                frames = self.driver.encode(mode, enable, *values, self.now_ns, self.now_ns)
                self.bus.send(End.HOST, self.driver.bus, frames, self.now_ns)
            self.now_ns += 10 * MS
            self.world.advance(self.now_ns)
            self.track.append((*self.world.position[:2], *self.twist))
        return self

    @property
    def twist(self):
        cosine, sine = math.cos(self.world.yaw), math.sin(self.world.yaw)
        vx, vy = self.world.data.qvel[:2]
        return cosine * vx + sine * vy, cosine * vy - sine * vx, self.world.data.qvel[5]

    @property
    def speed(self):
        return float(np.hypot(*self.world.data.qvel[:2]))


def radius_of(points):
    """Of the circle nearest to points (n, 2)."""
    a, b, c = np.linalg.lstsq(np.c_[2 * points, np.ones(len(points))], (points**2).sum(axis=1), rcond=None)[0]
    return math.sqrt(c + a * a + b * b)


TWISTS = [
    (0.6, 0.0, 0.0),
    (0.6, 0.0, 0.3),
    (0.6, 0.0, -0.6),
    (0.4, 0.0, 1.0),
    (-0.6, 0.0, 0.3),
    (1.5, 0.0, 0.5),
    (0.3, 0.3, 0.0),
    (0.0, 0.5, 0.0),
    (0.5, 0.2, 0.3),
    (0.0, 0.0, 0.8),
]


@pytest.mark.parametrize(
    ("twist", "ground"), [*((twist, None) for twist in TWISTS), *((one, FIELD) for one in TWISTS[1::3])]
)
def test_where_tyres_hold_it_moves_as_its_wheels_stand(twist, ground):
    """Straight, arcs, crabbing and spinning in place: radius and twist within half a percent of the kinematics."""
    rig, (angles, speeds) = Rig(ground), wheels_for(*twist)
    rig.run(1.4, angles).run(1.0, angles, speeds).run(1.0, angles, speeds)
    rows = np.array(rig.track[-100:])
    np.testing.assert_allclose(rows[:, 2:].mean(axis=0), twist, atol=0.005 * max(np.abs(twist)))
    if twist[2]:
        radius = math.hypot(*twist[:2]) / abs(twist[2])
        assert radius_of(rows[:, :2]) == pytest.approx(radius, rel=0.005, abs=0.002)


def test_it_has_its_mass_and_the_ground_carries_it():
    rig = Rig().run(0.5)
    assert rig.world.model.body_mass.sum() == pytest.approx(VEHICLE.mass_kg) == pytest.approx(120.0)
    np.testing.assert_allclose(rig.world.loads(), 120.0 * 9.81 / 4, rtol=1e-3)
    assert abs(rig.world.clearance) < 2e-3
    np.testing.assert_allclose(rig.world.data.sensordata[:3], (0.0, 0.0, 9.81), atol=0.02)


def test_wheels_turn_freely_though_they_overlap_the_chassis():
    """Off the ground a small torque turns each wheel and each steering axis: nothing of the vehicle touches it."""
    wide = msgspec.structs.replace(
        VEHICLE, chassis=msgspec.structs.replace(VEHICLE.chassis, box_m=(1.6, 1.0, 0.4), center_m=(0.0, 0.0, 0.2))
    )
    model = build(wide, PHYSICS, None)
    data = mujoco.MjData(model)
    data.qpos[2] = 5.0
    data.qfrc_applied[6:].reshape(4, 3)[:, 1:] = 2.0
    for _ in range(200):
        mujoco.mj_step(model, data)
    assert data.ncon == 0
    assert (data.qvel[6:].reshape(4, 3)[:, 1] > 0.2).all()
    assert (data.qvel[6:].reshape(4, 3)[:, 2] > 2.0).all()


def test_it_climbs_a_slope_and_its_brakes_hold_it_there():
    degrees = 20.0
    rig = Rig(terrain.slope(degrees, (-2.0, 7.0, -2.0, 2.0)))
    rig.run(4.5, STRAIGHT, [3.0] * 4)
    assert rig.world.tilt == pytest.approx(math.radians(degrees), abs=0.02)
    assert rig.speed == pytest.approx(0.6 * math.cos(math.radians(degrees)), rel=0.02)
    for enable, mode in ((True, UnitMode.BRAKED), (False, UnitMode.OFF)):
        rig.run(0.6, mode=UnitCommandMode.BRAKE, enable=enable)
        before = rig.world.position
        rig.run(1.0, mode=UnitCommandMode.BRAKE, enable=enable)
        assert np.linalg.norm(rig.world.position - before) < 1e-4
        assert rig.readings.mode == mode


def test_without_commands_it_brakes_by_itself_and_drives_again_only_after_it_was_asked_to_brake():
    rig, (angles, speeds) = Rig(), wheels_for(1.0, 0.0, 0.0)
    rig.run(2.0, angles, speeds)
    silent_from = rig.now_ns
    rig.run(0.08, silent=True)
    assert rig.world.unit.mode == UnitMode.DRIVE
    rig.run(0.04, silent=True)
    assert rig.world.unit.mode == UnitMode.TIMED_OUT
    rig.run(0.6, silent=True)
    assert rig.speed < 1e-3
    assert rig.now_ns - silent_from == 720 * MS
    rig.run(0.3, angles, speeds)
    assert rig.readings.mode == UnitMode.TIMED_OUT
    assert rig.speed < 1e-3
    rig.run(0.1, mode=UnitCommandMode.BRAKE).run(1.0, angles, speeds)
    assert rig.readings.mode == UnitMode.DRIVE
    assert rig.speed == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("wrong", ["checksum", "counter", "one frame"])
def test_commands_that_are_wrong_that_long_brake_it_too(wrong):
    rig, (angles, speeds) = Rig(), wheels_for(0.6, 0.0, 0.0)
    rig.run(1.0, angles, speeds)
    before = rig.world.unit.sets

    def tamper(sender, bus, arrival_ns, frame):
        changed = bytearray(frame)
        if sender == End.HOST and wrong == "checksum":
            changed[8] ^= 0x40
        if sender == End.HOST and wrong == "one frame" and frame[0] == 0x03:
            return None
        return bytes(changed)

    rig.bus.tamper = tamper
    if wrong == "counter":
        last = rig.driver.frames.copy()
        rig.driver.encode = lambda *arguments: last
    rig.run(0.14, angles, speeds)
    assert rig.world.unit.sets - before <= 1
    assert rig.world.unit.mode == UnitMode.TIMED_OUT


def test_a_set_that_lacks_a_frame_takes_none_from_the_set_before(tmp_path):
    """Lost on the way, or refused since it asks for an angle beyond the unit's range, which its sender thinks wider."""
    wide = tmp_path / "wide.dbc"
    wide.write_text(OWN_DBC.read_text().replace('[-1.65|1.65] "rad"', '[-3|3] "rad"'))
    sender, unit, times_ns = VehicleUnit(10**9, wide), Rig().world.unit, itertools.count(0, 10 * MS)

    def taken(angles, *rows):
        frames = sender.encode(UnitCommandMode.DRIVE, True, np.array(angles), np.zeros(4), 0, 0)[list(rows)]
        at_ns = next(times_ns)
        unit.receive(frames, np.zeros(len(rows), np.uint8), np.full(len(rows), at_ns))
        unit.drive(np.zeros((4, 3)), np.zeros((4, 3)), at_ns)
        return unit.sets, unit.motors.target[0].round(3).tolist()

    assert taken([0.1] * 4, 0, 1, 2, 3, 4) == (1, [0.1] * 4)
    assert taken([0.2] * 4, 0, 1, 2, 3) == (1, [0.1] * 4)
    assert taken([0.3, 0.3, 3.0, 0.3], 0, 1, 2, 3, 4) == (1, [0.1] * 4)
    assert taken([0.4] * 4, 1, 2, 3, 4) == (1, [0.1] * 4)
    assert taken([0.5] * 4, 0, 1, 2, 3, 4) == (2, [0.5] * 4)
    assert unit.flaws[Flaw.OUT_OF_RANGE] == 1
    assert unit.flaws[Flaw.MISSED] == 2
    assert taken([0.6] * 4, 0, 1, 2, 3, 4) == (3, [0.6] * 4)
    # of a round before: sixteen sets later the counter is the same
    assert taken([0.7] * 4, 4) == (3, [0.6] * 4)
    for _ in range(17):
        assert taken([0.8] * 4, 0, 1, 2, 3) == (3, [0.6] * 4)


def test_the_command_delay_and_the_pose_delay_are_as_configured():
    rig = Rig(command_delay_ns=600 * MS, localization_latency_ns=600 * MS)
    rig.run(0.6, STRAIGHT, [3.0] * 4)
    assert not np.abs(rig.world.wheel_speeds).max() > 1e-3
    rig.run(1.0, STRAIGHT, [3.0] * 4)
    assert rig.world.wheel_speeds.min() > 2.0
    pose = Pose("/pose")
    assert rig.world.localization.read(pose, rig.now_ns)
    assert pose.stamp_ns == rig.now_ns - 600 * MS


@pytest.mark.parametrize("limit", [{"steering_rate_radps": 0.349}, {"center_rate_radps": 0.349}])
def test_steering_is_as_fast_as_it_is_allowed(limit):
    """20 degrees a second: of each motor, or of the centre angle, from which the inner wheels turn faster."""
    angles, _ = wheels_for(0.6, 0.0, 0.6)
    rig = Rig(steering_lag_s=0.0, **limit).run(0.2)
    rig.run(0.5, angles)
    inner, outer = rig.world.steering_angles[:2]
    if "steering_rate_radps" in limit:
        np.testing.assert_allclose(np.abs(rig.world.steering_angles), 0.5 * 0.349, atol=0.01)
    else:
        cotangent = 0.5 * (1 / math.tan(inner) + 1 / math.tan(outer))
        assert math.atan(1 / cotangent) == pytest.approx(0.5 * 0.349, abs=0.01)
        assert 1 / math.tan(outer) - 1 / math.tan(inner) == pytest.approx(
            2 * VEHICLE.track_m / VEHICLE.wheelbase_m, rel=0.02
        )


def test_the_true_angles_lag_as_configured():
    """Behind a ramp, by r T (1 - exp(-t / T)); a command takes up to 10 ms to its wheel."""
    rate, lag_s = PHYSICS.steering_rate_radps, 0.2
    rig = Rig(steering_lag_s=lag_s).run(0.2)
    for tick in range(1, 61):
        rig.run(0.01, (1.2,) * 4)
        t = 0.01 * tick
        expected = rate * (t - lag_s * -math.expm1(-t / lag_s))
        np.testing.assert_allclose(rig.world.steering_angles, expected, atol=0.012 * rate)


def test_it_speeds_up_as_its_motors_profiles_say_and_no_further_than_their_torque_carries_it():
    """At r a, then to where the torque that the motors have left is that of rolling: w_0 (1 - M_r / M)."""
    rig = Rig().run(0.2)
    rig.run(1.0, STRAIGHT, [30.0] * 4)
    assert rig.speed == pytest.approx(VEHICLE.wheel_radius_m * PHYSICS.acceleration_radps2, rel=0.03)
    rig.run(5.0, STRAIGHT, [30.0] * 4)
    left = 1.0 - PHYSICS.rolling_resistance_nm / PHYSICS.peak_torque_nm
    assert rig.world.wheel_speeds == pytest.approx(PHYSICS.no_load_speed_radps * left, rel=0.01)


def test_a_jammed_axis_is_reported_until_it_is_free_and_the_unit_enabled_anew():
    rig = Rig().run(0.2)
    rig.world.unit.jam(1)
    rig.run(1.0, (0.3,) * 4)
    assert rig.readings.fault.tolist() == [0, WheelFault.STUCK, 0, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(rig.readings.steering, (0.3, 0.0, 0.3, 0.3), atol=0.01)
    rig.world.unit.jam(1, False)
    rig.run(0.5, (0.3,) * 4)
    assert rig.readings.fault[1] == WheelFault.STUCK
    rig.run(0.1, enable=False).run(1.0, (0.3,) * 4)
    assert not rig.readings.fault.any()
    np.testing.assert_allclose(rig.readings.steering, 0.3, atol=0.01)


def test_a_hot_motor_gives_no_torque_and_says_so():
    rig = Rig().run(0.2)
    rig.world.unit.motors.heat(2, 100.0)
    rig.run(1.0, STRAIGHT, [3.0] * 4)
    assert rig.readings.fault.tolist() == [0] * 6 + [WheelFault.OVER_TEMPERATURE, 0]
    assert rig.readings.temperature[2] > PHYSICS.motor_limit_degc
    assert rig.readings.current[2] == 0.0


def test_a_wheel_that_answers_nothing_is_heard_no_more_while_the_others_are():
    rig = Rig().run(0.2)
    rig.world.unit.mute(3)
    before = rig.readings.reply_ns.copy()
    rig.run(0.3)
    assert rig.readings.reply_ns[3] <= before[3] + 20 * MS
    assert (rig.readings.reply_ns[[0, 1, 2, 4]] > before[3] + 250 * MS).all()


def test_on_slippery_ground_it_takes_longer_to_stop():
    distances = []
    for friction in (0.9, 0.1):
        rig = Rig(patches=[FrictionPatch((-5.0, 50.0), (-5.0, 5.0), friction)])
        rig.run(1.0, STRAIGHT, [3.0] * 4).run(1.0, STRAIGHT, [3.0] * 4)
        before = rig.world.position[0]
        rig.run(1.5, mode=UnitCommandMode.BRAKE)
        distances.append(rig.world.position[0] - before)
    # locked wheels slide: v^2 / (2 mu g), after up to 20 ms at full speed
    assert distances[1] == pytest.approx(0.6**2 / (2 * 0.1 * 9.81), abs=0.02)
    assert distances[0] < 0.06


def test_patches_lie_where_they_are_said_to():
    x, y = np.array([0.0, 1.5, 1.5, 3.0]), np.array([0.0, 0.0, 2.0, 0.0])
    patches = [FrictionPatch((1.0, 2.0), (-1.0, 1.0), 0.3)]
    assert friction_at(x, y, patches, 0.9).tolist() == [0.9, 0.3, 0.9, 0.9]
    with pytest.raises(ValueError, match="is not a rectangle"):
        FrictionPatch((2.0, 1.0), (0.0, 1.0), 0.3)
    with pytest.raises(ValueError, match="must be positive"):
        FrictionPatch((1.0, 2.0), (0.0, 1.0), 0.0)


def test_over_undulating_ground_all_wheels_carry_and_it_goes_straight_on():
    rig = Rig(terrain.undulation(0.06, (-2.0, 5.0, -2.0, 2.0), 1))
    loads = []
    for _ in range(40):
        rig.run(0.1, STRAIGHT, [3.0] * 4)
        loads.append(rig.world.loads().copy())
    assert (np.array(loads) > 1.0).mean() > 0.95
    assert rig.world.position[0] > 2.0
    assert abs(rig.world.position[1]) < 0.1


def test_the_truth_tells_of_wheels_and_slip():
    rig, record = Rig().run(1.5, STRAIGHT, [3.0] * 4), VehicleTruth("/truth", {"wheel": 4})
    assert rig.world.read(record, rig.now_ns)
    np.testing.assert_allclose(record.speed, 3.0, rtol=0.01)
    np.testing.assert_allclose(record.slip, 0.0, atol=0.01)
    assert sum(record.normal_force) == pytest.approx(120.0 * 9.81, rel=0.01)


def test_the_same_seed_gives_the_same_frames():
    runs = [Rig(seed=seed).run(0.5, STRAIGHT, [3.0] * 4) for seed in (1, 1, 2)]
    one, again, other = (np.concatenate((r.readings.speed, r.readings.steering)).tobytes() for r in runs)
    assert one == again != other
