# SPDX-License-Identifier: Apache-2.0
"""The joints of a robot as the controller sees them: commands to frames, frames to measurements.

Everything that must survive from one call to the next is in two places that the caller may own: `counters`, and the
`Readings` given to `decode`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from drivers.addressing import Identified, reply_addresses, reply_id_mask
from drivers.can_frame import FRAME_WORDS, Frames, make_frames
from drivers.dialects import Dialect
from drivers.errors import DriverConfigError, NonFiniteError
from drivers.faults import is_healthy
from drivers.joints import Joint, column, command_limits, transform_of
from drivers.mit import DISABLE, ENABLE, SET_ZERO, FloatArray, MitCodec
from drivers.patterns import Recognizer, data_words


class Counter(IntEnum):
    """Meaning of each element of `JointGroup.counters`."""

    LIMITED_POSITION = 0
    LIMITED_VELOCITY = 1
    LIMITED_EFFORT = 2
    LIMITED_STIFFNESS = 3
    LIMITED_DAMPING = 4
    STALE_COMMAND = 5
    NON_FINITE_COMMAND = 6
    WRONG_LENGTH = 7
    UNKNOWN_ID = 8
    ERROR_FRAME = 9
    REMOTE_FRAME = 10
    OUT_OF_RANGE = 11


LIMITED = slice(Counter.LIMITED_POSITION, Counter.LIMITED_DAMPING + 1)
"""The counters of values that a limit altered."""
REJECTED = slice(Counter.WRONG_LENGTH, Counter.OUT_OF_RANGE + 1)
"""The counters of rejected frames, in the order of `Rejection`."""


@dataclass(frozen=True)
class Readings:
    """What the drives last said, in joint coordinates; `decode` writes into these arrays.

    Attributes:
        position: (n,) rad, unwrapped.
        velocity: (n,) rad/s.
        effort: (n,) N.m.
        temperature: (n,) degC, the hottest that the drive reports, NaN where it reports none.
        error: (n,) the drive's error code, 0 if it has no fault.
        reply_ns: (n,) arrival of the last valid reply, 0 if there was none yet.
    """

    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    temperature: FloatArray
    error: npt.NDArray[np.uint8]
    reply_ns: npt.NDArray[np.int64]

    @classmethod
    def empty(cls, joints: int) -> Readings:
        """Readings before any reply."""
        position, velocity, effort = np.zeros((3, joints))
        temperature = np.full(joints, np.nan)
        return cls(position, velocity, effort, temperature, np.zeros(joints, np.uint8), np.zeros(joints, np.int64))


class JointGroup:
    """Encodes commands to n joints and decodes their replies.

    Args:
        joints: the joints, in the order of every array.
        dialect: of all drives.
        max_command_age_ns: ns; an older command is replaced by damping.
        counters: (len(Counter),) uint32 array to count in; None for one of its own.

    Attributes:
        counters: as given.
        bus: (n,) bus index of each command frame.
        frames: (n,) command frames of the last `encode`, in joint order.
        data: (16 n,) their bytes.

    Raises:
        DriverConfigError: if two drives share an address, or a joint's limits exceed what its drive can represent.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        dialect: Dialect,
        max_command_age_ns: int,
        counters: npt.NDArray[np.uint32] | None = None,
    ) -> None:
        if not joints:
            raise DriverConfigError("a joint group needs at least one joint")
        self.joints, self.dialect, self.max_command_age_ns = tuple(joints), dialect, max_command_age_ns
        self.counters = np.zeros(len(Counter), np.uint32) if counters is None else counters
        ranges = [joint.ranges for joint in joints]
        low, high = command_limits(joints)
        self._codec = MitCodec(dialect, ranges, transform=transform_of(joints), low=low, high=high)
        self._recognizer = Recognizer(reply_addresses(dialect, joints), bool(reply_id_mask(dialect)))
        self.bus = column(joints, "bus", np.uint8)
        self.frames = self._command_frames()
        self.data = self.frames.view(np.uint8)
        self._word = self.frames.view(FRAME_WORDS)["word"]
        self._damping_word = self._encoded_damping()
        continuous = column(joints, "continuous", np.bool_)
        self._continuous = continuous if continuous.any() else None
        self._rest = column(joints, "offset")
        self._error_before = b""
        self._prepare_decoding()

    # -- commands -------------------------------------------------------------------------------------------------

    def encode(
        self,
        position: FloatArray,
        velocity: FloatArray,
        effort: FloatArray,
        stiffness: FloatArray,
        damping: FloatArray,
        stamp_ns: int,
        now_ns: int,
    ) -> Frames:
        """Encode one command for every joint into `frames`.

        Values beyond a joint's limits or its drive's range are clipped and counted. A command older than the bound (or
        stamped after `now_ns`), or with any value that is not finite, is replaced for all joints by damping: zero
        stiffness, zero effort, zero velocity, `fallback_damping`; that is counted too.

        Args:
            position: (n,) rad; ignored for continuous joints.
            velocity: (n,) rad/s.
            effort: (n,) N.m, feed-forward.
            stiffness: (n,) N.m/rad.
            damping: (n,) N.m.s/rad.
            stamp_ns: when the command was made.
            now_ns: the present.

        Returns:
            `frames`, overwritten by the next call.
        """
        if not 0 <= now_ns - stamp_ns <= self.max_command_age_ns:
            self.counters[Counter.STALE_COMMAND] += 1
            return self.encode_damping()
        if self._continuous is not None:
            position = np.where(self._continuous, self._rest, position)
        try:
            limited = self._codec.encode_commands(position, velocity, effort, stiffness, damping, self._word)
        except NonFiniteError:
            self.counters[Counter.NON_FINITE_COMMAND] += 1
            return self.encode_damping()
        if limited:
            self.counters[LIMITED] += self._codec.commands.clipped
        return self.frames

    def encode_damping(self) -> Frames:
        """Encode damping alone for every joint into `frames`."""
        self._word[...] = self._damping_word
        return self.frames

    def enable_frames(self) -> Frames:
        """Frames (n,) that switch the drives on; they do not set a zero."""
        return self._special_frames(ENABLE)

    def disable_frames(self) -> Frames:
        """Frames (n,) that switch the drives off."""
        return self._special_frames(DISABLE)

    def set_zero_frames(self) -> Frames:
        """Frames (n,) that make the present position each drive's zero: for calibration only."""
        return self._special_frames(SET_ZERO)

    # -- replies --------------------------------------------------------------------------------------------------

    def decode(
        self,
        frames: Frames,
        bus: npt.NDArray[np.uint8],
        arrival_ns: npt.NDArray[np.int64],
        count: int,
        readings: Readings,
    ) -> int:
        """Take up replies; of several from one drive the last counts.

        Frames of wrong length or unknown id, error frames, remote frames and values that are not plausible are
        rejected and counted.

        Args:
            frames: of which the first `count` are looked at.
            bus: bus index of each.
            arrival_ns: ns, of each.
            count: how many.
            readings: updated for the joints that answered.

        Returns:
            How many frames were accepted as belonging to a joint.
        """
        if not count:
            return 0
        frames, arrival_ns = frames[:count], arrival_ns[:count]
        raw = frames.tobytes()
        found, words = self._recognizer.identify(raw, frames, bus[:count]), data_words(raw)
        if found.any_rejected:
            self.counters[REJECTED] += found.rejections
            words, arrival_ns = words[found.rows], arrival_ns[found.rows]
        drives = found.drives
        if not drives.size:
            return 0
        self._reply_word[drives] = words
        self._arrival_ns[drives] = arrival_ns
        values = self._codec.decode_replies(self._reply_word)
        if self._continuous is not None:
            self._unwrap(values[0], readings)
        self._store(values, self._plausible(values, found), readings)
        return int(drives.size)

    def _unwrap(self, position: FloatArray, readings: Readings) -> None:
        """Add the whole turns that bring each position nearest to the one before it.

        Only for joints that turn on and on: the limits of the others lie within the range of their drives.
        """
        turns = np.rint((readings.position - position) / self._span)
        turns *= self._continuous & (readings.reply_ns != 0)
        position += turns * self._span

    def _plausible(self, values: FloatArray, found: Identified) -> npt.NDArray[np.bool_] | None:
        """Which joints to update, None for all."""
        everywhere = None if found.all_heard else found.heard
        if self._all_plausible:
            return everywhere
        motion, inside = values[:2], self._inside
        np.minimum(motion, self._plausible_high, out=inside)
        np.maximum(inside, self._plausible_low, out=inside)
        if inside.tobytes() == motion.tobytes():
            return everywhere
        wild: npt.NDArray[np.bool_] = (inside != motion).any(axis=0)
        wild &= found.heard
        self.counters[Counter.OUT_OF_RANGE] += np.uint32(np.count_nonzero(wild))
        np.logical_xor(found.heard, wild, out=wild)
        return wild

    def _store(self, values: FloatArray, update: npt.NDArray[np.bool_] | None, readings: Readings) -> None:
        news: list[tuple[npt.NDArray[Any], npt.NDArray[Any]]] = [
            (readings.position, values[0]),
            (readings.velocity, values[1]),
            (readings.effort, values[2]),
            (readings.reply_ns, self._arrival_ns),
        ]
        if self._temperature_rows:
            temperature = values[self._temperature_rows[0]]
            for row in self._temperature_rows[1:]:
                temperature = np.maximum(temperature, values[row])
            news.append((readings.temperature, temperature))
        if self._error_row is not None:
            np.copyto(self._error, values[self._error_row], casting="unsafe")
            if self._error.tobytes() != self._error_before:
                self._error_before = self._error.tobytes()
                self._fault = self._fault_code[self._error]
            news.append((readings.error, self._fault))
        for reading, value in news:
            if update is None:
                reading[:] = value
            else:
                reading[update] = value[update]

    # -- construction ---------------------------------------------------------------------------------------------

    def _command_frames(self) -> Frames:
        ids = [self.dialect.command_id(joint.drive_id) for joint in self.joints]
        return make_frames(ids, self.dialect.command_length)

    def _special_frames(self, data: bytes) -> Frames:
        frames = self.frames.copy()
        frames["data"] = np.frombuffer(data, np.uint8)
        return frames

    def _encoded_damping(self) -> npt.NDArray[np.uint64]:
        zero, word = np.zeros(len(self.joints)), np.zeros(len(self.joints), np.uint64)
        plain = MitCodec(self.dialect, [j.ranges for j in self.joints], transform=transform_of(self.joints))
        rest = np.array([self._resting_position(joint) for joint in self.joints])
        plain.encode_commands(rest, zero, zero, zero, column(self.joints, "fallback_damping"), word)
        return word

    @staticmethod
    def _resting_position(joint: Joint) -> float:
        """A joint position that every drive can represent; with zero stiffness it has no effect."""
        low, high = joint.ranges.position
        return joint.offset + 0.5 * (low + high) / joint.multiplier

    def _prepare_decoding(self) -> None:
        joints, count = self.joints, len(self.joints)
        self._reply_word, self._arrival_ns = np.zeros(count, np.uint64), np.zeros(count, np.int64)
        self._span = np.array([(j.ranges.position[1] - j.ranges.position[0]) / j.gear_ratio for j in joints])
        self._inside = np.empty((2, count))
        speed = column(joints, "plausible_velocity")
        reach = np.array([joint.plausible_position for joint in joints])
        self._plausible_low = np.stack([reach[:, 0], -speed])
        self._plausible_high = np.stack([reach[:, 1], speed])
        self._all_plausible = not np.isfinite((self._plausible_low, self._plausible_high)).any()
        rows = self._codec.replies.rows
        self._temperature_rows = [rows[name] for name in ("temperature", "driver_temperature") if name in rows]
        self._error_row = rows.get("error")
        self._error, self._fault = np.zeros((2, count), np.uint8)
        codes = range(256)
        self._fault_code: npt.NDArray[np.uint8] = np.array(
            [0 if is_healthy(self.dialect, code) else code for code in codes], np.uint8
        )
