# SPDX-License-Identifier: Apache-2.0
"""The vehicle's control unit at the far end of the wire: it decodes commands, runs the motors, and reports.

It knows nothing but the frames that it receives and its own sensors. A set of commands takes effect when all of its
frames are there, good ones, with the same alive counter; without a good set for the time-out it brakes.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from drivers.can_frame import CAN_FRAME, Frames
from drivers.guarded_frames import Flaw, GuardedReceiver
from drivers.vcu import COMMAND_FRAMES, STATE_FRAMES, TEMPERATURES, UNIT_STATE, UnitCommandMode, UnitMode, WheelFault
from drivers.vcu_database import COUNTER, WHEEL_NAMES, UnitDatabase
from runtime.models.vehicle import WHEELS, Vehicle
from runtime.robots.vehicle_simulation import VehicleSimulationConfig
from sim_bridge.sensors import BatterySensor
from sim_bridge.vehicle_model import STEERING_FRICTION_NM
from sim_bridge.vehicle_motors import DRIVING, STEERING, VehicleMotors

Array = npt.NDArray[np.float64]
COUNT = len(WHEELS)
WATCH_PERIOD_NS = 10_000_000
"""How often temperatures and the steering are looked at."""
JAM_NM = 1e5


class _Command(NamedTuple):
    """A complete set, and when it takes effect."""

    due_ns: int
    drive: bool
    enable: bool
    steering: list[float]
    speed: list[float]


class VirtualUnit:
    """The control unit of a vehicle.

    Args:
        vehicle: geometry.
        config: of motors, controllers, delays and noise.
        database: of its frames; the same as the controller's if that is configured rightly.
        bus: index of its bus.
        battery: that it reports.
        seed: of the encoders' noise.

    Attributes:
        motors: that it drives.
        friction: (4, 2) N.m that hold back each steering axis and each wheel: bearings, brakes, a jam.
        flaws: of received frames, since start, indexed by `Flaw`.
        sets: complete sets of commands since start.
        enabled, timed_out: as it reports them.
        fault: (8,) `WheelFault`, the steering motors' before the driving motors'.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        config: VehicleSimulationConfig,
        database: UnitDatabase,
        bus: int,
        battery: BatterySensor,
        seed: int,
    ) -> None:
        self._config, self._database, self._bus, self._battery = config, database, bus, battery
        self._generator = np.random.Generator(np.random.PCG64(seed))
        self.motors = VehicleMotors(vehicle, config)
        self.friction = np.zeros((COUNT, 2))
        self._receiver = GuardedReceiver(database.commands, bus)
        self.flaws, self._alive = np.zeros(len(Flaw), np.uint32), np.zeros(COMMAND_FRAMES, np.uint32)
        self._latest: dict[int, tuple[dict[str, float], int]] = {}
        self._due: deque[_Command] = deque()
        self.sets, self._heard_ns = 0, 0
        self.enabled = self.timed_out = self._drive = False
        self.fault, self._forced = np.zeros((2, 2 * COUNT), np.uint8)
        self._jammed, self._stuck_ns = np.zeros(COUNT, np.bool_), np.zeros(COUNT)
        self._muted: set[int] = set()
        self._sent = [0] * STATE_FRAMES
        self._watch_ns = 0
        self._put_in_force()

    # -- physics --------------------------------------------------------------------------------------------------

    def drive(self, position: Array, velocity: Array, now_ns: int) -> Array:
        """One step of the controllers.

        Args:
            position: of the wheels' joints (suspension, steering, driving), (4, 3), m and rad.
            velocity: of the same, m/s and rad/s.
            now_ns: time of the physics step.

        Returns:
            (4, 2) N.m at each steering axis and each wheel; overwritten by the next call.
        """
        while self._due and self._due[0].due_ns <= now_ns:
            self._obey(self._due.popleft())
        if self.enabled and not self.timed_out and now_ns - self._heard_ns > self._config.command_timeout_ns:
            self.timed_out = True
            self._put_in_force()
        if now_ns >= self._watch_ns:
            self._watch_ns = now_ns + WATCH_PERIOD_NS
            self._watch(position, velocity, now_ns)
        self.motors.update(position, velocity)
        return self.motors.torque

    def _watch(self, position: Array, velocity: Array, now_ns: int) -> None:
        """Look for faults; they stay until the unit is enabled anew."""
        config = self._config
        self.motors.warm(now_ns)
        lagging = self.motors.lag(position) > config.stuck_error_rad
        lagging &= np.abs(velocity[:, STEERING]) < config.stuck_speed_radps
        self._stuck_ns = np.where(lagging, self._stuck_ns + WATCH_PERIOD_NS, 0)
        found = self._causes()
        news = (self.fault == WheelFault.NONE) & (found != WheelFault.NONE)
        if news.any():
            self.fault[news] = found[news]
            self._put_in_force()

    def _causes(self) -> npt.NDArray[np.uint8]:
        """What is wrong with each motor at present."""
        found = self._forced.copy()
        steering, driving = found[:COUNT], found[COUNT:]
        steering[(self._stuck_ns >= self._config.stuck_ns) & (steering == WheelFault.NONE)] = WheelFault.STUCK
        driving[self.motors.hot & (driving == WheelFault.NONE)] = WheelFault.OVER_TEMPERATURE
        return found

    # -- commands -------------------------------------------------------------------------------------------------

    def receive(self, frames: Frames, bus: npt.NDArray[np.uint8], arrival_ns: npt.NDArray[np.int64]) -> None:
        """Take frames (m,) that came on the buses (m,) at the times (m,) ns."""
        for message, values, at_ns in self._receiver.accepted(frames, bus, arrival_ns, self._alive, self.flaws):
            self._latest[message] = values, at_ns
            if len(self._latest) == COMMAND_FRAMES and self._is_one_set(at_ns):
                self._take_set(at_ns)

    def _is_one_set(self, at_ns: int) -> bool:
        """Whether the newest good frame of each kind has the same counter, and that not from a round before."""
        counts = {values[COUNTER] for values, _ in self._latest.values()}
        oldest_ns = min(arrival_ns for _, arrival_ns in self._latest.values())
        return len(counts) == 1 and at_ns - oldest_ns <= self._config.command_timeout_ns

    def _take_set(self, at_ns: int) -> None:
        unit, *wheels = (self._latest[message][0] for message in range(COMMAND_FRAMES))
        self._latest = {}
        self.sets, self._heard_ns = self.sets + 1, at_ns
        self._due.append(
            _Command(
                at_ns + self._config.command_delay_ns,
                unit["ModeCommand"] == UnitCommandMode.DRIVE,
                bool(unit["EnableCommand"]),
                [values["SteeringCommand"] for values in wheels],
                [values["SpeedCommand"] for values in wheels],
            )
        )

    def _obey(self, command: _Command) -> None:
        if command.enable and not self.enabled:
            self._stuck_ns[:] = 0
            self.fault[:] = self._causes()
        if not (command.drive and command.enable):
            self.timed_out = False
        self.enabled, self._drive = command.enable, command.drive
        self.motors.target[:] = command.steering, command.speed
        self._put_in_force()

    def _put_in_force(self) -> None:
        """Tell motors and brakes what mode and faults mean for them."""
        self.motors.braked = self.mode != UnitMode.DRIVE
        np.not_equal(self.fault, WheelFault.NONE, out=self.motors.idle)
        self.friction[:, 0] = np.where(self._jammed, JAM_NM, STEERING_FRICTION_NM)
        brake = self._config.brake_torque_nm if self.motors.braked else 0.0
        self.friction[:, 1] = self._config.rolling_resistance_nm + brake

    @property
    def mode(self) -> UnitMode:
        """As it reports it."""
        if not self.enabled:
            return UnitMode.OFF
        if self.timed_out:
            return UnitMode.TIMED_OUT
        return UnitMode.DRIVE if self._drive else UnitMode.BRAKED

    # -- states ---------------------------------------------------------------------------------------------------

    def report(self, position: Array, velocity: Array, now_ns: int) -> Frames:
        """The state frames that are due, given the wheels' joints (4, 3)."""
        config, messages = self._config, {}
        if (now_ns - config.state_phase_ns) % config.state_period_ns == 0:
            noise = self._generator.standard_normal((2, COUNT))
            angle = position[:, STEERING] + config.angle_noise_rad * noise[0]
            speed = velocity[:, DRIVING] + config.speed_noise_radps * noise[1]
            current = self.motors.torque[:, 1] / config.torque_constant_nm_pa
            for wheel in range(COUNT):
                if wheel not in self._muted:
                    messages[wheel] = {
                        "SteeringAngle": angle[wheel],
                        "WheelSpeed": speed[wheel],
                        "MotorCurrent": current[wheel],
                        "SteeringFault": self.fault[wheel],
                        "DriveFault": self.fault[COUNT + wheel],
                    }
            voltage, drawn, charge = self._battery.state
            messages[UNIT_STATE] = {
                "UnitMode": self.mode,
                "UnitEnabled": self.enabled,
                "BatteryVoltage": voltage,
                "BatteryCurrent": drawn,
                "BatteryCharge": charge,
            }
        if (now_ns - config.state_phase_ns) % config.temperature_period_ns == 0:
            found = zip(WHEEL_NAMES, self.motors.temperature.tolist(), strict=True)
            messages[TEMPERATURES] = {f"MotorTemperature_{name}": degrees for name, degrees in found}
        return self._frames(messages)

    def _frames(self, messages: dict[int, dict[str, float]]) -> Frames:
        frames = np.zeros(len(messages), CAN_FRAME)
        for row, (kind, values) in enumerate(messages.items()):
            message = self._database.states[kind]
            data = message.encode({name: float(value) for name, value in values.items()}, self._sent[kind])
            self._sent[kind] += 1
            frames[row] = message.can_id, message.length, 0, np.frombuffer(data.ljust(8, b"\0"), np.uint8)
        return frames

    # -- faults for tests -----------------------------------------------------------------------------------------

    def mute(self, wheel: int, muted: bool = True) -> None:
        """Let a wheel obey but not report."""
        (self._muted.add if muted else self._muted.discard)(wheel)

    def jam(self, wheel: int, jammed: bool = True) -> None:
        """Let the steering axis of a wheel be stuck where it is."""
        self._jammed[wheel] = jammed
        self._put_in_force()

    def force_fault(self, motor: int, code: int) -> None:
        """Let a motor (steering 0 to 3, driving 4 to 7) report a fault and give no torque; 0 removes the cause."""
        self._forced[motor] = code
        if code:
            self.fault[motor] = code
        self._put_in_force()
