# SPDX-License-Identifier: Apache-2.0
"""The whole robot in its world for a few seconds: it walks, and faults injected anywhere bring it down safely."""

import mujoco
import numpy as np
import pytest

from drivers.bus_health import BusMonitor
from drivers.dialects import dialect_named
from drivers.memory_bus import MemoryBus
from drivers.memory_ports import MemoryReader, MemoryWriter
from runtime.executors.lockstep import Lockstep
from runtime.executors.tick import entries
from runtime.robots import load_configuration, topics
from runtime.robots.uslgo1.assembly import assemble
from runtime.signals import Fault, Mode
from sim_bridge.courses import scenario
from sim_bridge.quadruped_world import QuadrupedWorld
from sim_bridge.script import ScriptedOperator, ScriptedPath

MS = 1_000_000
CONFIG = load_configuration("uslgo1")
FAULT_NS = 1_600 * MS
"""The robot has trotted for a second by then."""


class Datagrams(list):
    """A sink that keeps what it is given."""

    dropped = 0

    def write(self, datagram):
        self.append(datagram)


class Port:
    """An input port whose record passes through a function; None withholds it."""

    def __init__(self, inner, change):
        self.inner, self.change = inner, change

    def read(self, record, now_ns):
        return bool(self.inner.read(record, now_ns)) and self.change(record, now_ns)


class Run:
    """Robot and world on the same wires, as `sim_bridge.run` builds them."""

    def __init__(self, ground="flat", estimator="kalman", tamper=None, imu=lambda sensor: sensor, seed=0):
        config = load_configuration("uslgo1", {"variant.estimator": estimator})
        course = scenario("flat")
        robot = assemble(config)
        self.bus = MemoryBus(config.drives.buses, config.drives.bit_rate_hz, tamper=tamper)
        self.world = QuadrupedWorld(
            config.quadruped,
            config.simulation,
            config.drives.joints(config.safety),
            dialect_named(config.drives.dialect),
            course.terrain(seed) if ground == "flat" else ground,
            self.bus,
            seed,
            course.start_pose,
            config.quadruped.standing_angles(config.posture.height_m),
            config.posture.height_m,
        )
        inputs = {
            topics.CAN_RECEIVED: MemoryReader(self.bus),
            topics.IMU: imu(self.world.imu),
            topics.LOCALIZATION: self.world.localization,
            topics.BATTERY: self.world.battery,
            topics.TRUTH: self.world,
            topics.BUS_STATUS: BusMonitor(self.bus.health),
            topics.OPERATOR_EVENT: ScriptedOperator(course, config.posture.rise_s),
            topics.PATH: ScriptedPath(course),
        }
        self.sink = Datagrams()
        self.executor = Lockstep(robot.loops, inputs, {topics.CAN_SENT: MemoryWriter(self.bus)}, self.world, self.sink)
        records = {record.topic: record for loop in robot.loops for record in loop.writes}
        self.safety, self.body = records[topics.SAFETY], records[topics.BODY_STATE]
        self.joints, self.safe = records[topics.JOINT_STATE], records[topics.JOINT_COMMAND_SAFE]
        self.gait = records[topics.GAIT]
        self.path, self.modes = [], []

    def until(self, seconds, at=None):
        """Run to a time; `at` maps times in ns to what to do then."""
        waiting = sorted((at or {}).items())

        def look(now_ns):
            while waiting and waiting[0][0] <= now_ns:
                waiting.pop(0)[1](self)
            if now_ns % (2 * MS) == 0:
                self.path.append(self.world.position)
                self.modes.append((now_ns, int(self.safety.mode), Fault(self.safety.fault)))
            return now_ns >= seconds * 1e9

        self.executor.run(10**12, look)
        return self

    @property
    def fault_seen(self):
        """When it was damped, and why."""
        return next(((at, fault) for at, mode, fault in self.modes if mode == Mode.DAMPED), (None, Fault.NONE))

    @property
    def damped(self):
        return not self.safe.stiffness.any() and not self.safe.effort.any()

    @property
    def distance(self):
        return self.path[-1][0] - self.path[0][0]


@pytest.fixture(scope="module")
def calm():
    """Three seconds without a fault."""
    return Run().until(3.0)


def test_it_walks(calm):
    assert calm.safety.mode == Mode.ACTIVE
    assert calm.gait.walking
    # at rest until 0.6 s, then up to 0.6 m/s at 0.5 m/s^2
    assert 0.8 < calm.distance < 1.4
    assert np.abs(np.array(calm.path)[:, 1]).max() < 0.05
    assert calm.world.tilt < 0.1
    assert calm.safety.faults == 0
    assert calm.joints.rejected == 0


def test_the_estimate_is_near_the_truth(calm):
    error = np.array(calm.body.position) - calm.world.position
    assert np.abs(error).max() < 0.03


def rows(run):
    """Every entry of a run, wall times left out."""
    channels = {channel.number: channel for channel in run.executor.manifest.channels}
    for datagram in run.sink:
        for number, body in entries(datagram):
            if channels[number].role == "tick":
                tick = channels[number].record.like()
                tick.load(body)
                tick.compute_ns = tick.cpu_ns = 0
                yield number, tick.to_bytes()
            else:
                yield number, bytes(body)


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(calm):
    again, other = Run().until(1.2), Run(seed=1).until(1.2)
    kept = list(rows(again))
    count = len(kept)
    expected = [row for row, _ in zip(rows(calm), range(count), strict=False)]
    assert kept == expected
    assert count > 5000
    assert list(rows(other)) != kept


def test_on_a_flat_height_field_it_walks_as_on_a_plane():
    """The controllers and all noise are the same; what differs is how MuJoCo finds the contact point (a prism of the
    field against a sphere, in single precision), which the feedback of a trot neither removes nor lets grow."""
    field, plane = (Run(ground, estimator="truth").until(3.0) for ground in ("flat", None))
    away = np.linalg.norm(np.array(field.path) - np.array(plane.path), axis=1)
    # 0.2 mm after 3 s, 0.06 mm after 0.6 s of standing
    assert away.max() < 2e-3
    assert away[:300].max() < 2e-4
    assert field.distance == pytest.approx(plane.distance, abs=1e-3)


def test_a_drive_that_falls_silent_damps_the_robot():
    run = Run().until(2.4, {FAULT_NS: lambda run: run.world.drives.mute(7)})
    at, fault = run.fault_seen
    assert fault == Fault.STALE_MOTOR
    assert run.damped
    assert 0 < at - FAULT_NS <= (CONFIG.safety.missing_replies_max + 2) * CONFIG.loops.wbc_period_ns
    assert run.safety.faults == 1


def test_a_drive_that_reports_an_error_damps_the_robot():
    run = Run().until(2.4, {FAULT_NS: lambda run: run.world.drives.force_error(2, 3)})
    at, fault = run.fault_seen
    assert fault == Fault.MOTOR_FAULT
    assert run.damped
    assert 0 < at - FAULT_NS <= 8 * MS


class Silent:
    """An IMU that gives nothing from a time on."""

    def __init__(self, inner, from_ns):
        self.inner, self.from_ns = inner, from_ns

    def read(self, record, now_ns):
        return now_ns < self.from_ns and self.inner.read(record, now_ns)


def test_an_imu_that_falls_silent_has_the_robot_crouch_and_damps_it():
    run = Run(imu=lambda sensor: Silent(sensor, FAULT_NS)).until(2.4)
    at, fault = run.fault_seen
    assert fault == Fault.STALE_IMU
    assert run.damped
    crouched_ns = CONFIG.safety.imu_age_max_ns + int(CONFIG.posture.crouch_s * 1e9)
    assert crouched_ns < at - FAULT_NS <= crouched_ns + 10 * MS
    assert run.world.tilt < 0.3


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_one_bad_sample_of_the_imu_does_not_stop_it(value):
    def change(record, now_ns):
        if now_ns == FAULT_NS:
            record.angular_velocity[1] = value
        return True

    run = Run(imu=lambda sensor: Port(sensor, change)).until(2.6)
    assert run.safety.mode == Mode.ACTIVE
    assert run.gait.walking
    assert run.safety.faults == 0
    assert run.body.imu_rejected == 1
    assert run.distance > 0.6
    assert run.world.tilt < 0.15


def corruption(share, seed=0):
    """Flips one bit of some of the frames, and destroys as many."""
    rng = np.random.default_rng(seed)

    def tamper(sender, bus, arrival_ns, frame):
        if arrival_ns < FAULT_NS:
            return frame
        chance = rng.random()
        if chance < 0.5 * share:
            return None
        if chance < share:
            bit = int(rng.integers(128))
            changed = bytearray(frame)
            changed[bit // 8] ^= 1 << bit % 8
            return bytes(changed)
        return frame

    return tamper


@pytest.mark.parametrize("seed", [0, 1])
def test_corrupted_and_lost_frames_are_counted_and_never_crash_anything(seed):
    run = Run(tamper=corruption(0.02, seed)).until(2.6)
    rejected = int(run.joints.rejected) + int(run.world.drives.rejections.sum())
    assert rejected > 0
    assert np.isfinite(run.body.position).all()
    assert np.isfinite(run.safe.effort).all()
    assert run.safety.mode == Mode.ACTIVE or run.damped


def test_a_cut_wire_damps_the_robot_and_its_drives():
    def cut(sender, bus, arrival_ns, frame):
        return None if bus == 1 and arrival_ns >= FAULT_NS else frame

    run = Run(tamper=cut).until(2.4)
    assert run.fault_seen[1] == Fault.STALE_MOTOR
    assert run.damped
    # the drives behind the cut got no damping command: their own time-out brakes them
    torque = run.world.drives.torque(run.world.data.qpos[7:], np.full(12, 1.0), 10**10)
    np.testing.assert_allclose(torque[3:6], -CONFIG.simulation.timeout_damping_nms_prad, atol=0.3)


def test_a_robot_that_was_damped_lies_still():
    run = Run().until(4.0, {FAULT_NS: lambda run: run.world.drives.force_error(2, 3)})
    assert run.damped
    path = np.array(run.path)
    assert np.linalg.norm(path[-1] - path[-100]) < 0.01
    assert np.abs(run.world.data.qvel[:3]).max() < 0.05
    assert np.abs(run.world.data.qvel[3:6]).max() < 0.3
    assert run.world.tilt < 0.6


def test_true_contact_forces_are_all_that_the_ground_does_to_the_robot():
    run = Run()
    for step in range(1, 9):
        run.until(0.15 * step)
        total = run.world.contact_forces().sum(axis=0)
        np.testing.assert_allclose(total, run.world.data.qfrc_constraint[:3], atol=1e-6)
    assert total[2] > 20.0
    assert run.gait.walking


def test_a_push_is_an_impulse_on_the_trunk_in_its_direction():
    """In the air, so that nothing else acts: 10 N.s on 12.8 kg."""
    run = Run()
    world = run.world
    world.data.qpos[2] += 30.0
    world.push(10 * MS, 100 * MS, np.pi / 2, 100.0)
    world.advance(200 * MS)
    mujoco.mj_forward(world.model, world.data)
    mujoco.mj_subtreeVel(world.model, world.data)
    velocity = world.data.subtree_linvel[0]
    np.testing.assert_allclose(velocity[:2] * 12.786, (0.0, 10.0), atol=0.05)
    assert not world.data.xfrc_applied.any()
