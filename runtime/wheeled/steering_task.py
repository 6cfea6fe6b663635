# SPDX-License-Identifier: Apache-2.0
"""From the motion that is asked for to the angle and speed of every wheel."""

from __future__ import annotations

from runtime.models.vehicle import VehicleGeometry
from runtime.records import Record, boolean, float64, float64_array, int64, uint8
from runtime.tasks import Task
from runtime.vehicle_signals import TwistCommand, WheelCommand, WheelState
from runtime.wheeled.steering import Twist
from runtime.wheeled.steering_sequence import SteeringLimits, SteeringState, next_targets, standing


class SteeringMemory(Record):
    """A `SteeringState`, and when it was made."""

    stamp_ns = int64("ns", "of the last step, 0 before the first")
    mode = uint8()
    phase = uint8()
    moving = boolean()
    stopped_s = float64("s")
    angles = float64_array("wheel", "rad")


class SteeringTask(Task):
    """Steering kinematics and the order of stop, steer, go; braking and power are for the safety filter to say.

    Args:
        geometry: of the vehicle.
        limits: of the wheels, and when the vehicle waits for them.
        drive: mode to ask of the control unit.
        period_ns: of the loop.
        twist, wheels: records read.
        output: record written.
    """

    name = "steering"

    def __init__(
        self,
        geometry: VehicleGeometry,
        limits: SteeringLimits,
        drive: int,
        period_ns: int,
        twist: TwistCommand,
        wheels: WheelState,
        output: WheelCommand,
    ) -> None:
        self._geometry, self._limits, self._drive, self._period_ns = geometry, limits, drive, period_ns
        self._twist, self._wheels, self._output = twist, wheels, output
        self.reads, self.writes = (twist, wheels), (output,)
        self.state: SteeringMemory = SteeringMemory("/ugv/state/steering", output.sizes)

    def step(self, now_ns: int) -> None:
        """One tick; see `Task`."""
        memory, twist, output = self.state, self._twist, self._output
        if self._wheels.stamp_ns == 0:
            return
        measured = self._wheels.steering.tolist()
        dt = (now_ns - memory.stamp_ns if memory.stamp_ns else self._period_ns) * 1e-9
        held = _held(memory) if memory.stamp_ns else standing(measured)
        forward, lateral = twist.velocity.tolist()
        wanted = Twist(forward, lateral, twist.yaw_rate)
        state, targets = next_targets(
            held, wanted, twist.manner, measured, self._wheels.speed.tolist(), dt, self._geometry, self._limits
        )
        memory.stamp_ns, memory.mode, memory.phase = now_ns, state.mode, state.phase
        memory.moving, memory.stopped_s, memory.angles = state.moving, state.stopped_s, state.angles
        output.stamp_ns, output.mode, output.enable = now_ns, self._drive, True
        output.steering, output.speed = targets
        output.manner, output.phase = state.mode, state.phase


def _held(memory: SteeringMemory) -> SteeringState:
    return SteeringState(
        memory.mode, memory.phase, bool(memory.moving), memory.stopped_s, tuple(memory.angles.tolist())
    )
