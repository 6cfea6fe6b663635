# SPDX-License-Identifier: Apache-2.0
"""The motor drives at the far end of the wire: they decode frames, close the joint's PD loop, and answer.

A drive knows nothing but the frames it receives and its own encoder. At every physics step it gives

    tau = kp (q_des - q) + kd (v_des - v) + tau_ff

on its own measured q (quantised) and v (noisy), in its own coordinates, and the motor limits the result to the
torque-speed curve. Without a command for the time-out it falls back to damping.

Inside, positions are encoder counts, speeds those of the drive's output, and torques (with stiffness and damping) act
at the joint; the codec takes and gives these units, so that no conversion is left to do at each step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from drivers.addressing import Rejection, command_addresses
from drivers.can_frame import FRAME_SIZE, FRAME_WORDS, Frames, make_frames
from drivers.dialects import Dialect
from drivers.errors import DriverConfigError
from drivers.faults import FaultKind, code_of
from drivers.joints import Joint
from drivers.mit import DISABLE, ENABLE, SET_ZERO, SPECIAL_PREFIX, FloatArray, MitCodec, Transform, Words
from drivers.patterns import Recognizer, data_words
from runtime.compiled import compiled
from sim_bridge.drive_model import DriveModel, Encoders, Windings, available_torque, parameter

_POSITION, _VELOCITY, _EFFORT, _STIFFNESS, _DAMPING = range(5)
"""Rows of commands."""
NO_EFFORT_NM = 0.1
_NEVER_NS = int(np.iinfo(np.int64).max)

Answer = tuple[Frames, npt.NDArray[np.uint8], npt.NDArray[np.int64]]
"""Replies, bus index of each, and when each is handed to the bus."""


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
        asked: (n,) N.m, likewise what the commands in force asked for, before the limits of the motors.
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
        self._encoders, self._windings = Encoders(joints, models, seed), Windings(models)
        self._peak = parameter(models, "peak_torque")
        self._slope = self._peak / parameter(models, "no_load_speed")
        ranges = [joint.ranges for joint in joints]
        self._codec = MitCodec(dialect, ranges, transform=_inner_units(self._encoders))
        self._recognizer = Recognizer(command_addresses(dialect, joints), id_in_data=False)
        self._timeout_ns = parameter(models, "command_timeout_ns").astype(np.int64)
        self._timeout_damping = parameter(models, "timeout_damping") * self._encoders.multiplier
        self._overheat_code = code_of(dialect, FaultKind.MOTOR_OVER_TEMPERATURE) or 0
        self.rejections, self.clipped_replies = np.zeros(len(Rejection), np.uint32), 0
        self.enabled, self._muted, self._hot = np.zeros((3, count), np.bool_)
        self._any_muted, self._all_obey = False, False
        self._fault, self._forced = np.zeros((2, count), np.uint8)
        self._prepare_replies(models)
        self._prepare_commands(count)
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
        if self._windings.due(now_ns):
            self._warm(now_ns)
        if now_ns > self._deadline_ns:
            self._check_timeouts(now_ns)
        self._encoders.measure(position, velocity)
        _torque(self._in_force, self._measured, velocity, self._peak, self._slope, self.asked, self.applied)
        return self.applied

    def _warm(self, now_ns: int) -> None:
        windings = self._windings
        windings.update(self.applied, now_ns)
        for row in self._temperature_rows:
            np.add(windings.excess, windings.ambient, out=self._reply_values[row])
        hot = windings.hot
        if hot.tobytes() != self._hot.tobytes():
            self._hot = hot
            self._refresh(now_ns)

    # -- the wire -------------------------------------------------------------------------------------------------

    def answer(self, frames: Frames, bus: npt.NDArray[np.uint8], arrival_ns: npt.NDArray[np.int64]) -> Answer:
        """Take up commands (of several for one drive the last counts) and answer each frame at once.

        Args:
            frames: (m,) as received.
            bus: (m,) bus index of each.
            arrival_ns: (m,) ns, of each.

        Returns:
            Replies, bus index of each, and when each is handed to the bus.
        """
        raw = frames.tobytes()
        found = self._recognizer.identify(raw, frames, bus)
        if found.any_rejected:
            self.rejections += found.rejections
            frames, bus, arrival_ns = frames[found.rows], bus[found.rows], arrival_ns[found.rows]
            raw = frames.tobytes()
        drives = found.drives
        if not drives.size:
            return self._reply_frames[:0], bus, arrival_ns
        self._commanded_ns[drives] = arrival_ns
        if SPECIAL_PREFIX in raw:
            self._obey_specials(frames, drives, int(arrival_ns.max()))
        else:
            self._obey(data_words(raw), drives, arrival_ns)
        return self._reply(drives, bus, arrival_ns)

    def _obey(self, words: Words, drives: npt.NDArray[np.intp], arrival_ns: npt.NDArray[np.int64]) -> None:
        """Let commands take effect; if all drives obey what was last sent to them, decoding does it."""
        self._command_word[drives] = words
        self._codec.decode_commands(self._command_word)
        if not self._all_obey:
            self._latched[:, drives] = self._decoded[:, drives]
            self._refresh(int(arrival_ns.max()))

    def _obey_specials(self, frames: Frames, drives: npt.NDArray[np.intp], now_ns: int) -> None:
        """A batch that holds enabling, disabling or zeroing frames: frame by frame, in order."""
        self._leave_decoded()
        for drive, frame in zip(drives.tolist(), frames["data"], strict=True):
            data = frame.tobytes()
            if data == ENABLE:
                self._enable(drive)
            elif data == DISABLE:
                self.enabled[drive] = False
            elif data == SET_ZERO:
                self._encoders.set_zero(drive, self._measured[0, drive])
                self._measured[0, drive] = 0.0
            else:
                self._command_word[drive] = int.from_bytes(data, "big")
                self._latched[:, drive] = self._codec.decode_commands(self._command_word)[:, drive]
        self._refresh(now_ns)

    def _enable(self, drive: int) -> None:
        """Switch a drive on with no command latched; this also clears a fault whose cause is gone."""
        if not self.enabled[drive] or self._fault[drive]:
            self._latched[:, drive] = 0.0
        self.enabled[drive] = True
        self._fault[drive] = self._forced[drive]

    def _reply(self, drives: npt.NDArray[np.intp], bus: npt.NDArray[np.uint8], times: npt.NDArray[np.int64]) -> Answer:
        self.clipped_replies += self._codec.encode_replies(self._reply_values, self._reply_word)
        if self._any_muted:
            speaking = ~self._muted[drives]
            drives, bus, times = drives[speaking], bus[speaking], times[speaking]
        return self._reply_opaque[drives].view(self._reply_frames.dtype), bus, times

    # -- what is in force -----------------------------------------------------------------------------------------

    def _check_timeouts(self, now_ns: int) -> None:
        if self._all_obey:
            self._deadline_ns = int((self._commanded_ns + self._timeout_ns).min())
        if now_ns > self._deadline_ns:
            self._refresh(now_ns)

    def _leave_decoded(self) -> None:
        """From here on what is latched is no longer what the last frames say."""
        if self._all_obey:
            self._latched[:] = self._decoded
            self._all_obey = False

    def _refresh(self, now_ns: int) -> None:
        """Work out for each drive which part of its command is in force: all, damping alone, or nothing."""
        self._leave_decoded()
        np.copyto(self._fault, self._overheat_code, where=self._hot & (self._fault == 0))
        active = self.enabled & (self._fault == 0) & ~self._hot
        timed_out = active & (now_ns - self._commanded_ns > self._timeout_ns)
        alive = active & ~timed_out
        if self._error_row is not None:
            healthy = self.enabled * self.dialect.enabled_code
            self._reply_values[self._error_row] = np.where(self._fault != 0, self._fault, healthy)
        deadlines = (self._commanded_ns + self._timeout_ns)[alive]
        self._deadline_ns = int(deadlines.min()) if deadlines.size else _NEVER_NS
        self._all_obey = bool(alive.all()) and np.array_equal(self._latched, self._decoded)
        if self._all_obey:
            self._put_in_force(self._decoded)
            return
        self._latched[_VELOCITY, ~alive] = 0.0
        np.multiply(self._latched, alive, out=self._partial)
        np.copyto(self._partial[_DAMPING], self._timeout_damping, where=timed_out)
        self._put_in_force(self._partial)

    def _put_in_force(self, commands: FloatArray) -> None:
        """Let `torque` look at these commands (5, n)."""
        self._in_force = commands

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
        self._refresh(self._windings.updated_ns)

    @property
    def driven(self) -> bool:
        """Whether any drive has more in force than damping; a torque of zero has no code of its own on the wire."""
        in_force = self._in_force
        return bool(in_force[_STIFFNESS].any() or (np.abs(in_force[_EFFORT]) > NO_EFFORT_NM).any())

    @property
    def temperature(self) -> FloatArray:
        """Temperature of each motor, degC."""
        return self._windings.excess + self._windings.ambient

    @property
    def error(self) -> npt.NDArray[np.uint8]:
        """Fault code of each drive, 0 for none."""
        return self._fault.copy()

    # -- construction ---------------------------------------------------------------------------------------------

    def _prepare_commands(self, count: int) -> None:
        self._command_word, self._commanded_ns = np.zeros(count, np.uint64), np.zeros(count, np.int64)
        self._decoded = self._codec.decode_commands(self._command_word)
        self._latched, self._partial = np.zeros((2, 5, count))

    def _prepare_replies(self, models: Sequence[DriveModel]) -> None:
        """Reply values are kept where they are computed: the measurement, the torque, the rest when it changes."""
        rows, joints = self._codec.replies.rows, self.joints
        self._reply_values = np.zeros((len(rows), len(joints)))
        self._measured, self.applied = self._reply_values[:2], self._reply_values[rows["effort"]]
        self.asked = np.zeros(len(joints))
        self._encoders.write_to(self._measured)
        self._error_row = rows.get("error")
        self._temperature_rows = [rows[name] for name in ("temperature", "driver_temperature") if name in rows]
        for row in self._temperature_rows:
            self._reply_values[row] = self.temperature
        bits = next(field.bits for field in self.dialect.reply if field.name == "id")
        self._reply_values[rows["id"]] = [joint.drive_id & ((1 << bits) - 1) for joint in joints]
        if "voltage" in rows:
            self._reply_values[rows["voltage"]] = parameter(models, "bus_voltage")
        ids = [self.dialect.reply_id(joint.drive_id, joint.master_id) for joint in joints]
        self._reply_frames = make_frames(ids, self.dialect.reply_length)
        self._reply_word = self._reply_frames.view(FRAME_WORDS)["word"]
        self._reply_opaque = self._reply_frames.view((np.void, FRAME_SIZE))


@compiled
def _torque(
    commands: FloatArray,
    measured: FloatArray,
    velocity: FloatArray,
    peak: FloatArray,
    slope: FloatArray,
    asked: FloatArray,
    torque: FloatArray,
) -> None:
    """The PD law of n drives into `asked`, and within their torque-speed curves into `torque`."""
    for drive in range(torque.shape[0]):
        wanted = commands[_STIFFNESS, drive] * (commands[_POSITION, drive] - measured[0, drive])
        wanted += commands[_DAMPING, drive] * (commands[_VELOCITY, drive] - measured[1, drive])
        asked[drive] = wanted + commands[_EFFORT, drive]
        torque[drive] = available_torque(asked[drive], velocity[drive], peak[drive], slope[drive])


def _inner_units(encoders: Encoders) -> Transform:
    """From counts, rad/s of the drive and torque at the joint to what the drive's frames hold."""
    count, per_joint = encoders.radians_per_count, 1 / encoders.multiplier
    factor = np.stack([count, np.ones_like(count), per_joint, per_joint / count, per_joint])
    return Transform(factor, np.zeros_like(factor))
