# SPDX-License-Identifier: Apache-2.0
"""The torques that move the legs themselves, by inverse dynamics."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from runtime.models.quadruped import Quadruped
from runtime.models.rigid_body import build

Array = npt.NDArray[np.float64]


class LegDynamics:
    """Joint torques of a robot that touches nothing.

    Gravity is switched off and the trunk given the accelerometer's specific force instead, so that neither the trunk's
    attitude nor its velocity matters.
    """

    def __init__(self, description: Quadruped) -> None:
        self._model = build(description)
        self._model.gravity.linear = np.zeros(3)
        self._data = self._model.createData()
        self._q, self._v, self._a = pin.neutral(self._model), np.zeros(18), np.zeros(18)

    def free_torque(
        self,
        specific_force: Array,
        angular_velocity: Array,
        position: Array,
        velocity: Array,
        acceleration: Array,
    ) -> Array:
        """Torques (12,) that the joints need for this motion without any contact.

        Args:
            specific_force: of the trunk, in base, (3,), m/s^2.
            angular_velocity: of the trunk, in base, (3,), rad/s.
            position: of the joints, (12,), rad.
            velocity: of the joints, (12,), rad/s.
            acceleration: of the joints, (12,), rad/s^2.
        """
        self._q[7:] = position
        self._v[3:6], self._v[6:] = angular_velocity, velocity
        self._a[:3], self._a[6:] = specific_force, acceleration
        return np.array(pin.rnea(self._model, self._data, self._q, self._v, self._a)[6:])
