# SPDX-License-Identifier: Apache-2.0
"""The motor drives at the far end of the wire: they decode frames, close the joint's PD loop, and answer.

A drive knows nothing but the frames it receives and its own encoder. At every physics step it gives

    tau = kp (q_des - q) + kd (v_des - v) + tau_ff

on its own measured q (quantised) and v (noisy), in its own coordinates, and the motor limits the result to the
torque-speed curve. Without a command for the time-out it falls back to damping.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from drivers.addressing import Identified, Rejection, command_addresses
from drivers.can_frame import FRAME_WORDS, Frames, make_frames
from drivers.dialects import Dialect
from drivers.errors import DriverConfigError
from drivers.faults import FaultKind, code_of
from drivers.joints import Joint, column
from drivers.mit import DISABLE, ENABLE, SET_ZERO, SPECIAL_PREFIX, FloatArray, MitCodec

_NOISE_BLOCK = 512
_DAMPING = 2
"""Row of the gains: effort, stiffness, damping."""
_NEVER_NS = int(np.iinfo(np.int64).max)


@dataclass(frozen=True)
class DriveModel:
    """Physics and firmware of a drive.

    Attributes:
        peak_torque: N.m at the joint, standing still.
        no_load_speed: rad/s at the joint; the torque available in the sense of motion falls linearly to zero there.
        encoder_counts: counts of the drive's encoder in one turn of its output.
        velocity_noise: rad/s at the drive's output, standard deviation of the measured speed.
        command_timeout_ns: ns without a command after which the drive falls back to damping.
        timeout_damping: N.m.s/rad at the drive's output, the damping of that fall-back; 0 lets the motor idle.
        ambient_temperature: degC.
        heating: K/s for each (N.m)^2 at the joint.
        cooling_time: s, time constant of cooling.
        temperature_limit: degC; above it the drive reports a fault and gives no torque until enabled again.
        bus_voltage: V, reported by the dialects that do.
    """

    peak_torque: float
    no_load_speed: float
    encoder_counts: int
    velocity_noise: float
    command_timeout_ns: int
    timeout_damping: float
    ambient_temperature: float
    heating: float
    cooling_time: float
    temperature_limit: float
    bus_voltage: float

    def __post_init__(self) -> None:
        for name in ("peak_torque", "no_load_speed", "encoder_counts", "command_timeout_ns", "cooling_time"):
            if not 0 < getattr(self, name) < math.inf:
                raise DriverConfigError(f"drive model: {name} = {getattr(self, name)} is not a positive number")
        for name in ("velocity_noise", "timeout_damping", "heating"):
            if not 0 <= getattr(self, name) < math.inf:
                raise DriverConfigError(f"drive model: {name} = {getattr(self, name)} is negative or not finite")


class VirtualDrives:
    """The drives of n joints.

    Args:
        joints: how each joint hangs on its drive; the same as the controller's if it is configured rightly.
        dialect: spoken by all drives.
        model: one for all drives, or one for each.
        seed: of the velocity noise.

    Attributes:
        rejections: frames refused since start, indexed by `Rejection`.
        clipped_replies: batches of replies in which a value exceeded the range of its field, since start.
        applied: (n,) N.m, torque at the joints of the last `torque`.
        temperature: (n,) degC.
        enabled: (n,) whether each drive is switched on.
    """

    def __init__(
        self, joints: Sequence[Joint], dialect: Dialect, model: DriveModel | Sequence[DriveModel], seed: int
    ) -> None:
        count = len(joints)
        models = [model] * count if isinstance(model, DriveModel) else list(model)
        if len(models) != count:
            raise DriverConfigError(f"{count} joints need as many drive models, not {len(models)}")
        self.joints, self.dialect = tuple(joints), dialect
        self._codec = MitCodec(dialect, [joint.ranges for joint in joints])
        self._addresses = command_addresses(dialect, joints)
        self._configure(models)
        self.rejections, self.clipped_replies = np.zeros(len(Rejection), np.uint32), 0
        self._generator = np.random.Generator(np.random.PCG64(seed))
        self._noise, self._noise_row = np.zeros((0, count)), 0
        self._heated_ns, self._next_timeout_ns = 0, _NEVER_NS
        self._all_active = False
        self._reset_state()
        self._refresh(0)

    # -- physics --------------------------------------------------------------------------------------------------

    def torque(self, position: FloatArray, velocity: FloatArray, now_ns: int) -> FloatArray:
        """Torque of each motor at its joint, to hold until the next call.

        Args:
            position: (n,) rad, true joint positions.
            velocity: (n,) rad/s, true joint velocities.
            now_ns: time of the physics step.

        Returns:
            (n,) N.m; the array is overwritten by the next call.
        """
        self._heat(now_ns)
        if now_ns > self._next_timeout_ns:
            self._refresh(now_ns)
        self._measure(position, velocity)
        error, tau = self._error, self.applied
        np.subtract(self._commands[:2], self._measured, out=error[1:])
        np.multiply(error, self._gain, out=self._share)
        np.add.reduce(self._share, axis=0, out=tau)
        self._saturate(tau, velocity)
        return tau

    def _heat(self, now_ns: int) -> None:
        """First-order heating by the torque of the step that has passed."""
        elapsed, self._heated_ns = (now_ns - self._heated_ns) * 1e-9, now_ns
        if elapsed <= 0:
            return
        gained = self._scratch
        np.multiply(self.applied, self.applied, out=gained)
        np.multiply(gained, self._heating, out=gained)
        np.subtract(gained, self._excess, out=gained)
        np.multiply(gained, self._cooling_rate * elapsed, out=gained)
        np.add(self._excess, gained, out=self._excess)

    def _measure(self, position: FloatArray, velocity: FloatArray) -> None:
        """Encoder counts, wrapped at the ends of the drive's range, and noisy speed."""
        angle, speed = self._measured
        np.multiply(position, self._counts, out=angle)
        np.subtract(angle, self._zero_counts, out=angle)
        np.rint(angle, out=angle)
        np.multiply(angle, self._radians_per_count, out=angle)
        np.minimum(angle, self._last, out=self._scratch)
        np.maximum(self._scratch, self._first, out=self._scratch)
        if self._scratch.tobytes() != angle.tobytes():
            angle -= self._span * np.rint((angle - self._middle) / self._span)
        if self._noise_row == len(self._noise):
            block = self._generator.standard_normal((_NOISE_BLOCK, len(self.joints)))
            self._noise, self._noise_row = block * self._velocity_noise, 0
        np.multiply(velocity, self._multiplier, out=speed)
        np.add(speed, self._noise[self._noise_row], out=speed)
        self._noise_row += 1

    def _saturate(self, tau: FloatArray, velocity: FloatArray) -> None:
        """Limit torques to the torque-speed curve; against the motion the full peak torque is available."""
        bound = self._bound
        np.multiply(velocity, self._torque_per_speed, out=self._scratch)
        np.subtract(self._stall, self._scratch, out=bound)
        np.minimum(bound, self._bound_high, out=bound)
        np.maximum(bound, self._bound_low, out=bound)
        np.minimum(tau, bound[0], out=tau)
        np.maximum(tau, bound[1], out=tau)

    # -- the wire -------------------------------------------------------------------------------------------------

    def answer(
        self, frames: Frames, bus: npt.NDArray[np.uint8], arrival_ns: npt.NDArray[np.int64]
    ) -> tuple[Frames, npt.NDArray[np.uint8], npt.NDArray[np.int64]]:
        """Take up commands (of several for one drive the last counts) and answer each frame at once.

        Args:
            frames: (m,) as received.
            bus: (m,) bus index of each.
            arrival_ns: (m,) ns, of each.

        Returns:
            Replies, bus index of each, and when each is handed to the bus.
        """
        found = self._addresses.identify(frames, bus)
        if found.any_rejected:
            self.rejections += found.rejections
        if not found.rows.size:
            return self._reply_frames[:0], self._bus[:0], arrival_ns[:0]
        if SPECIAL_PREFIX in frames["data"].tobytes():
            self._obey_specials(frames, found)
        else:
            self._latch(frames, found)
        times = arrival_ns if found.in_order else arrival_ns[found.rows]
        self._commanded_ns[found.drives] = times
        self._put_in_force(found, times.tolist())
        return self._reply(found, times)

    def _latch(self, frames: Frames, found: Identified) -> None:
        words = frames.view(FRAME_WORDS)["word"]
        if found.in_order:
            self._command_word[:] = words
        else:
            self._command_word[found.drives] = words[found.rows]
        commands = self._codec.decode_commands(self._command_word)
        if found.all_heard:
            self._commands[:] = commands
        else:
            np.copyto(self._commands, commands, where=found.heard)

    def _obey_specials(self, frames: Frames, found: Identified) -> None:
        """A batch that holds enabling, disabling or zeroing frames: frame by frame, in order."""
        self._all_active = False
        for row, drive in zip(found.rows.tolist(), found.drives.tolist(), strict=True):
            data = frames["data"][row].tobytes()
            if data == ENABLE:
                self._enable(drive)
            elif data == DISABLE:
                self.enabled[drive] = False
            elif data == SET_ZERO:
                self._zero_counts[drive] += np.rint(self._measured[0, drive] / self._radians_per_count[drive])
                self._measured[0, drive] = 0.0
            else:
                self._command_word[drive] = int.from_bytes(data, "big")
                self._commands[:, drive] = self._codec.decode_commands(self._command_word)[:, drive]

    def _enable(self, drive: int) -> None:
        """Switch a drive on with no command latched; this also clears a fault whose cause is gone."""
        if not self.enabled[drive] or self._fault[drive]:
            self._commands[:, drive] = 0.0
        self.enabled[drive] = True
        self._fault[drive] = self._forced[drive]

    def _reply(
        self, found: Identified, times: npt.NDArray[np.int64]
    ) -> tuple[Frames, npt.NDArray[np.uint8], npt.NDArray[np.int64]]:
        values = self._reply_values
        values[:2] = self._measured
        np.divide(self.applied, self._multiplier, out=values[2])
        for row in self._temperature_rows:
            np.add(self._excess, self._ambient, out=values[row])
        self.clipped_replies += self._codec.encode_replies(values, self._reply_word)
        drives = found.drives
        if self._any_muted:
            speaking = ~self._muted[drives]
            drives, times = drives[speaking], times[speaking]
        elif found.in_order:
            return self._reply_frames.copy(), self._bus, times
        return self._reply_frames[drives], self._bus[drives], times

    def _put_in_force(self, found: Identified, times: list[int]) -> None:
        """Let the latched commands take effect; in the ordinary case of all drives alive, in one multiplication."""
        np.greater(self._excess, self._excess_limit, out=self._hot)
        if self._all_active and found.all_heard and b"\1" not in self._hot.tobytes():
            np.multiply(self._commands[2:], self._multiplier, out=self._gain)
            self._next_timeout_ns = min(times) + self._shortest_timeout_ns
        else:
            self._refresh(max(times))

    def _refresh(self, now_ns: int) -> None:
        """Work out for each drive which part of its command is in force: all, damping alone, or nothing."""
        np.greater(self._excess, self._excess_limit, out=self._hot)
        np.copyto(self._fault, self._overheat_code, where=self._hot & (self._fault == 0))
        active = self.enabled & (self._fault == 0) & ~self._hot
        timed_out = active & (now_ns - self._commanded_ns > self._timeout_ns)
        alive = active & ~timed_out
        np.multiply(self._commands[2:], self._multiplier * alive, out=self._gain)
        self._commands[1, ~alive] = 0.0
        np.copyto(self._gain[_DAMPING], self._timeout_damping * self._multiplier, where=timed_out)
        deadlines = (self._commanded_ns + self._timeout_ns)[alive]
        self._next_timeout_ns = int(deadlines.min()) if deadlines.size else _NEVER_NS
        self._all_active = bool(active.all())
        if self._error_row is not None:
            healthy = self.enabled * self.dialect.enabled_code
            self._reply_values[self._error_row] = np.where(self._fault != 0, self._fault, healthy)

    # -- faults for tests -----------------------------------------------------------------------------------------

    def mute(self, joint: int, muted: bool = True) -> None:
        """Let a drive obey but not answer."""
        self._muted[joint] = muted
        self._any_muted = bool(self._muted.any())

    def force_error(self, joint: int, code: int) -> None:
        """Let a drive report an error code and give no torque; 0 removes the cause, and enabling clears the fault."""
        self._forced[joint] = code
        if code:
            self._fault[joint] = code
        self._refresh(self._heated_ns)

    @property
    def temperature(self) -> FloatArray:
        """Temperature of each motor, degC."""
        return self._excess + self._ambient

    @property
    def error(self) -> npt.NDArray[np.uint8]:
        """Fault code of each drive, 0 for none."""
        return self._fault.copy()

    # -- construction ---------------------------------------------------------------------------------------------

    def _configure(self, models: Sequence[DriveModel]) -> None:
        joints = self.joints
        self._multiplier = column(joints, "multiplier")
        self._bus = column(joints, "bus", np.uint8)
        self._first, self._last = np.array([joint.ranges.position for joint in joints]).T.copy()
        self._middle, self._span = 0.5 * (self._first + self._last), self._last - self._first

        def of(name: str) -> FloatArray:
            return np.array([getattr(model, name) for model in models], np.float64)

        peak = of("peak_torque")
        self._torque_per_speed = peak / of("no_load_speed")
        self._stall, self._bound_high = np.stack([peak, -peak]), np.stack([peak, 0 * peak])
        self._bound_low = np.stack([0 * peak, -peak])
        self._radians_per_count = 2 * math.pi / of("encoder_counts")
        self._counts = self._multiplier / self._radians_per_count
        self._velocity_noise = of("velocity_noise")
        self._timeout_ns = of("command_timeout_ns").astype(np.int64)
        self._shortest_timeout_ns = int(self._timeout_ns.min())
        self._timeout_damping = of("timeout_damping")
        self._ambient, self._cooling_rate = of("ambient_temperature"), 1 / of("cooling_time")
        self._heating = of("heating") * of("cooling_time")
        self._excess_limit = of("temperature_limit") - self._ambient
        self._overheat_code = code_of(self.dialect, FaultKind.MOTOR_OVER_TEMPERATURE) or 0
        ids = [self.dialect.reply_id(joint.drive_id, joint.master_id) for joint in joints]
        self._reply_frames = make_frames(ids, self.dialect.reply_length)
        self._reply_word = self._reply_frames.view(FRAME_WORDS)["word"]
        rows = self._codec.replies.rows
        self._error_row = rows.get("error")
        self._temperature_rows = [rows[name] for name in ("temperature", "driver_temperature") if name in rows]
        self._reply_values = np.zeros((len(rows), len(joints)))
        bits = next(field.bits for field in self.dialect.reply if field.name == "id")
        self._reply_values[rows["id"]] = [joint.drive_id & ((1 << bits) - 1) for joint in joints]
        if "voltage" in rows:
            self._reply_values[rows["voltage"]] = of("bus_voltage")

    def _reset_state(self) -> None:
        count = len(self.joints)
        self._commands, self._command_word = np.zeros((5, count)), np.zeros(count, np.uint64)
        self._commanded_ns = np.zeros(count, np.int64)
        self.enabled, self._muted, self._hot = np.zeros((3, count), np.bool_)
        self._any_muted = False
        self._fault, self._forced = np.zeros((2, count), np.uint8)
        self._zero_counts = self._counts * column(self.joints, "offset")
        self._measured, self._bound = np.zeros((2, 2, count))
        self._error, self._gain, self._share = np.zeros((3, 3, count))
        self._error[0] = 1.0
        self.applied, self._excess, self._scratch = np.zeros((3, count))
