# SPDX-License-Identifier: Apache-2.0
"""The MuJoCo robot is the controller's robot, on the ground asked for, under the physics specified."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from runtime.models.quadruped import FEET, JOINT_NAMES
from runtime.models.rigid_body import RigidBody
from runtime.robots import load_configuration
from sim_bridge import terrain
from sim_bridge.courses import scenario
from sim_bridge.quadruped_model import build

CONFIG = load_configuration("uslgo1")
ROBOT, PHYSICS = CONFIG.quadruped, CONFIG.simulation
XYZW = [1, 2, 3, 0]


class Sim:
    """A robot in MuJoCo without drives; its joints are held by a stiff law."""

    def __init__(self, ground=None, stiffness=400.0, damping=6.0):
        self.model = build(ROBOT, PHYSICS, ground)
        self.data = mujoco.MjData(self.model)
        self.stiffness, self.damping = stiffness, damping
        self.target = ROBOT.standing_angles(CONFIG.posture.height_m)

    def put(self, position, rotation):
        self.data.qpos[:3], self.data.qpos[3:7] = position, pin.Quaternion(rotation).coeffs()[[3, 0, 1, 2]]
        self.data.qpos[7:] = self.target
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def run(self, seconds):
        for _ in range(round(seconds / self.model.opt.timestep)):
            hold = self.stiffness * (self.target - self.data.qpos[7:]) - self.damping * self.data.qvel[6:]
            self.data.qfrc_applied[6:] = hold
            mujoco.mj_step(self.model, self.data)

    def feet(self):
        return np.array([self.data.geom(f"{foot}_foot").xpos for foot in FEET])


def dense_mass(model, data):
    """By definition: the force that each unit acceleration takes, less the bias."""
    still = mujoco.MjData(model)
    still.qpos[:] = data.qpos
    mujoco.mj_forward(model, still)
    columns = []
    for axis in np.eye(model.nv):
        force = np.zeros(model.nv)
        mujoco.mj_mulM(model, still, force, axis)
        columns.append(force)
    return np.array(columns).T


@pytest.mark.parametrize("seed", range(10))
def test_mass_matrix_and_bias_are_the_controllers(seed):
    """Generalised velocities: MuJoCo's angular part is in the trunk's frame, the controller's in odom."""
    rng = np.random.default_rng(seed)
    sim, body = Sim(), RigidBody(ROBOT)
    data = sim.data
    rotation = pin.exp3(rng.uniform(-1.7, 1.7, 3))
    quaternion = pin.Quaternion(rotation).coeffs()
    position, linear, angular = rng.uniform(-2, 2, (3, 3)) * ((1,), (2,), (3,))
    position[2] += 5.0
    angles, rates = rng.uniform(-2, 2, 12), rng.uniform(-10, 10, 12)
    data.qpos[:3], data.qpos[3:7], data.qpos[7:] = position, quaternion[[3, 0, 1, 2]], angles
    data.qvel[:3], data.qvel[3:6], data.qvel[6:] = linear, rotation.T @ angular, rates
    mujoco.mj_forward(sim.model, data)
    body.update(position, quaternion, linear, rotation.T @ angular, angles, rates)
    to_mujoco = np.eye(18)
    to_mujoco[3:6, 3:6] = rotation.T
    np.testing.assert_allclose(body.mass_matrix, to_mujoco.T @ dense_mass(sim.model, data) @ to_mujoco, atol=1e-10)
    bias = to_mujoco.T @ data.qfrc_bias
    np.testing.assert_allclose(body.bias, bias, atol=1e-9 * (1 + np.abs(bias).max()))
    np.testing.assert_allclose(body.foot_position, sim.feet(), atol=1e-12)
    np.testing.assert_allclose(body.center_of_mass, data.subtree_com[1], atol=1e-12)


def test_the_robot_has_the_papers_mass_and_the_joints_their_names_and_order():
    model = build(ROBOT, PHYSICS, None)
    assert model.body_mass.sum() == pytest.approx(12.786, abs=1e-9)
    assert tuple(model.joint(i).name for i in range(1, 13)) == JOINT_NAMES
    assert model.opt.timestep == pytest.approx(1e-3)
    assert model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert model.opt.impratio == 100.0
    for foot in FEET:
        np.testing.assert_allclose(model.geom(f"{foot}_foot").solref, (0.005, 1.0))


@pytest.mark.parametrize("name", ["line-6cm", "s-curve", "slope-up-15", "slope-down-20"])
def test_the_height_field_has_its_own_heights(name):
    """Rays from above. MuJoCo splits each cell in two triangles: within a cell it differs from the bilinear surface by
    at most a quarter of the cell's twist |a - b - c + d|, and its numbers are single precision."""
    field = scenario(name).terrain(3)
    model = build(ROBOT, PHYSICS, field)
    data = mujoco.MjData(model)
    data.qpos[2] = 50.0
    mujoco.mj_forward(model, data)
    heights, rng = field.heights_m, np.random.default_rng(0)
    x0, x1, y0, y1 = field.extent
    twist = np.abs(heights[:-1, :-1] - heights[:-1, 1:] - heights[1:, :-1] + heights[1:, 1:])
    rounding = 4e-7 * (1.0 + np.ptp(heights))
    largest = 0.0
    for x, y in rng.uniform((x0 + 0.01, y0 + 0.01), (x1 - 0.01, y1 - 0.01), (400, 2)):
        geom = np.full((1, 1), -1, np.int32)
        length = mujoco.mj_ray(model, data, np.array([x, y, 10.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, geom)
        assert length > 0
        assert model.geom(int(geom[0, 0])).name == "terrain"
        row, column = int((y - y0) / field.spacing_m), int((x - x0) / field.spacing_m)
        difference = abs(10.0 - length - float(field.height(x, y)))
        assert difference <= 0.25 * twist[row, column] + rounding + 1e-6
        largest = max(largest, difference)
    # at a grid point there is nothing to interpolate
    for row, column in rng.integers((1, 1), np.array(heights.shape) - 1, (50, 2)):
        x, y = x0 + column * field.spacing_m, y0 + row * field.spacing_m
        geom = np.full((1, 1), -1, np.int32)
        length = mujoco.mj_ray(
            model, data, np.array([x + 1e-7, y + 1e-7, 10.0]), np.array([0.0, 0.0, -1.0]), None, 1, -1, geom
        )
        assert 10.0 - length == pytest.approx(heights[row, column], abs=rounding + 1e-6)
    assert largest < 0.02


def test_in_free_fall_momentum_and_energy_are_kept():
    sim = Sim()
    sim.model.dof_damping[:], sim.model.dof_frictionloss[:] = 0.0, 0.0
    rng = np.random.default_rng(2)
    sim.put((0.0, 0.0, 20.0), pin.exp3(rng.uniform(-1, 1, 3)))
    sim.data.qvel[:] = rng.uniform(-1, 1, 18)
    sim.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    sim.stiffness = sim.damping = 0.0
    mujoco.mj_forward(sim.model, sim.data)
    mujoco.mj_subtreeVel(sim.model, sim.data)
    energy, velocity = sim.data.energy.sum(), sim.data.subtree_linvel[0].copy()
    spin = sim.data.subtree_angmom[0].copy()
    sim.run(0.5)
    mujoco.mj_forward(sim.model, sim.data)
    mujoco.mj_subtreeVel(sim.model, sim.data)
    np.testing.assert_allclose(sim.data.subtree_linvel[0] - velocity, (0.0, 0.0, -9.81 * 0.5), atol=2e-3)
    np.testing.assert_allclose(sim.data.subtree_angmom[0], spin, atol=0.02 * np.linalg.norm(spin) + 2e-3)
    # first order in the time step of 1 ms
    assert sim.data.energy.sum() == pytest.approx(energy, rel=5e-3)


def test_standing_still_the_ground_carries_the_weight_and_the_imu_feels_it():
    sim = Sim()
    sim.put((0.0, 0.0, CONFIG.posture.height_m), np.eye(3))
    sim.run(1.0)
    np.testing.assert_allclose(sim.data.sensordata[:3], (0, 0, 9.81), atol=0.25)
    assert np.linalg.norm(sim.data.sensordata[:3]) == pytest.approx(9.81, abs=1e-3)
    np.testing.assert_allclose(sim.data.sensordata[3:6], 0.0, atol=1e-3)
    total = sum(contact_force(sim, index) for index in range(sim.data.ncon))
    assert total[2] == pytest.approx(12.786 * 9.81, rel=1e-3)


def contact_force(sim, index):
    wrench = np.zeros(6)
    mujoco.mj_contactForce(sim.model, sim.data, index, wrench)
    return wrench[:3] @ sim.data.contact.frame[index].reshape(3, 3)


@pytest.mark.parametrize("degrees", [15.0, 20.0, -20.0])
def test_feet_do_not_creep_on_a_slope(degrees):
    """Standing for 2 s with stiff joints: less than 1 mm/s (the default pyramidal cone creeps 2 to 4 mm/s)."""
    angle = np.radians(degrees)
    ground = terrain.slope(degrees, (-1.0, 7.0, -2.0, 2.0))
    sim = Sim(ground)
    rotation = pin.rpy.rpyToMatrix(0.0, -angle, 0.0)
    place = np.array([3.0, 0.0, float(ground.height(3.0, 0.0))])
    sim.put(place + rotation @ (0.0, 0.0, CONFIG.posture.height_m + 0.001), rotation)
    sim.run(1.0)
    before = sim.feet()
    sim.run(2.0)
    drift = np.linalg.norm(sim.feet() - before, axis=1) / 2.0
    assert drift.max() < 1e-3
    total = sum(contact_force(sim, index) for index in range(sim.data.ncon))
    np.testing.assert_allclose(total, (0, 0, 12.786 * 9.81), atol=0.5)


def test_on_too_steep_a_slope_it_slides():
    """Friction is that of the terrain, 0.8, not the feet's own: 35 degrees hold (0.70), 42 do not (0.90)."""
    moved = {}
    for degrees in (35.0, 42.0):
        angle = np.radians(degrees)
        sim = Sim(terrain.slope(degrees, (-1.0, 7.0, -2.0, 2.0)))
        rotation = pin.rpy.rpyToMatrix(0.0, -angle, 0.0)
        place = np.array([3.0, 0.0, 2.0 * np.tan(angle)])
        # lying on its trunk it cannot tip over
        sim.target = ROBOT.standing_angles(0.07)
        sim.put(place + rotation @ (0.0, 0.0, 0.072), rotation)
        sim.run(0.4)
        before = sim.data.qpos[:3].copy()
        sim.run(0.4)
        moved[degrees] = np.linalg.norm(sim.data.qpos[:3] - before)
    assert moved[35.0] < 2e-3 < 0.03 < moved[42.0]


def test_a_flat_height_field_is_as_high_as_the_plane():
    heights = []
    for ground in (None, terrain.flat((-2.0, 2.0, -2.0, 2.0))):
        sim = Sim(ground)
        sim.put((0.0, 0.0, CONFIG.posture.height_m), np.eye(3))
        sim.run(1.0)
        heights.append(sim.data.qpos[:7].copy())
    np.testing.assert_allclose(heights[0], heights[1], atol=2e-4)
