# SPDX-License-Identifier: Apache-2.0
"""What a robot did about a fault in real time, from its log and from what its drives saw, and whether that is right.

A machine that stalls makes faults of its own. A trial shows nothing, and is to be repeated, if a fault came that is not
its own, after a stall beyond that fault's bound; or if all that it lacks are ticks or commands, for less time than a
stall meanwhile took. Any other flaw is the robot's: the time that stalls took is granted to it anyway.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from runtime.executors.companions import SIM
from runtime.recording.log import Signal
from runtime.recording.stalls import Stall, StallBound, explanation, stalled_ns
from runtime.robots import topics
from runtime.robots.uslgo1.config import Uslgo1Config
from runtime.signals import Fault, Mode
from sim_bridge.faults.flaw import Flaw
from sim_bridge.faults.live_logs import FAST, LiveLogs
from sim_bridge.faults.live_row import LiveRow
from sim_bridge.faults.live_session import Episode, Frames
from sim_bridge.faults.live_table import let_go_in_real_time
from sim_bridge.faults.log_flaws import WHOLE_NS, missing_log
from sim_bridge.faults.wires import FOREVER_NS
from sim_bridge.simulation import simulation_of

COMES_WITHIN_NS = 10_000_000
"""A command that drives hold is replaced by then, if any comes."""
BEYOND_LIMITS, TOO_STRONG = "a joint passed its limits", "a torque beyond its limit was commanded"
STILL_DRIVEN = "the drives never let go"
INEXCUSABLE = {BEYOND_LIMITS, TOO_STRONG, STILL_DRIVEN}
_POWERED = (Mode.STANDING, Mode.ACTIVE)


class Verdict(NamedTuple):
    """One trial, judged.

    Attributes:
        name, expected: of the row.
        answer: what the robot did, in order.
        bound_ms, time_ms: how soon the last of it was due, and when it came.
        joints_kept: whether no joint passed its limits before the drives let go.
        flaws: what is not as it is to be.
        stall_ms: the longest stall of the machine meanwhile, 0 without one.
        shows_nothing: whether stalls of the machine excuse the flaws; none excuses abused joints.
    """

    name: str
    expected: tuple[str, ...]
    answer: tuple[str, ...]
    bound_ms: float
    time_ms: float
    joints_kept: bool
    flaws: tuple[str, ...]
    stall_ms: float
    shows_nothing: bool


def judged(episode: Episode, logs: LiveLogs, config: Uslgo1Config) -> Verdict:
    """Judge one trial."""
    row, at_ns, until_ns = episode.row, episode.at_ns, episode.until_ns
    stalls = logs.stalls_between(at_ns - WHOLE_NS, until_ns, row.holds_up)
    times = _answers(episode, logs)
    lasting = [time_ns for answer, time_ns in times.items() if answer != "go on"]
    took_ns = max(lasting, default=at_ns) - at_ns
    bound_ns = row.bound_ns(config)
    answer = tuple(times) or ("walk on",)
    longest_ns = max((stall.length_ns for stall in stalls), default=0)
    flaws = [
        *_wrong_answer(row, answer, took_ns, bound_ns + stalled_ns(stalls, at_ns, at_ns + took_ns)),
        *_not_told(episode, logs),
        *abused(episode, logs, config),
        *_still_driven(episode, times, config, longest_ns),
        *missing_log(logs, at_ns, until_ns, config.loops.wbc_period_ns, row.breaks_log, FAST not in row.holds_up),
        *old_commands(episode, logs, config.drives.command_age_max_ns),
    ]
    bounds = simulation_of(config).stall_bounds()
    return Verdict(
        row.name,
        row.answer,
        answer,
        bound_ns * 1e-6,
        took_ns * 1e-6,
        episode.joints_kept,
        tuple(flaw.says for flaw in flaws),
        longest_ns * 1e-6,
        _excused(flaws, longest_ns, spoilt(episode, logs, stalls, bounds)),
    )


def _excused(flaws: Sequence[Flaw], longest_ns: int, spoilt: bool) -> bool:
    if any(flaw.says in INEXCUSABLE for flaw in flaws):
        return False
    late = [flaw.missing_ns is not None and flaw.missing_ns < longest_ns for flaw in flaws]
    return bool(flaws) and (spoilt or all(late))


def spoilt(episode: Episode, logs: LiveLogs, stalls: Sequence[Stall], bounds: Sequence[StallBound]) -> bool:
    """Whether a fault came that is not the trial's own, after a stall beyond that fault's bound."""
    status = logs.between(topics.SAFETY, episode.at_ns, episode.until_ns).values
    for bound in bounds:
        there = (status["warning"] & bound.fault.value) != 0
        if bound.fault & episode.row.fault or not there.any():
            continue
        if explanation(bound, stalls, int(status["stamp_ns"][there.argmax()]))[0] is not None:
            return True
    return False


def _answers(episode: Episode, logs: LiveLogs) -> dict[str, int]:
    """When the robot came to each of its answers, in order."""
    status = logs.between(topics.SAFETY, episode.at_ns, episode.until_ns).values
    gait = logs.between(topics.GAIT, episode.at_ns, episode.until_ns)
    walking = _as_of(status["stamp_ns"], gait.values["stamp_ns"], gait.values["walking"].astype(bool))
    mode = status["mode"]
    powered = np.isin(mode, _POWERED)
    stood = np.logical_or.accumulate(powered & ~walking)
    signs = {
        "derate": status["derated"].astype(bool),
        "stand": powered & ~walking,
        "go on": powered & walking & stood,
        "crouch": mode == Mode.CROUCHING,
        "damp": mode == Mode.DAMPED,
    }
    firsts = {answer: int(status["stamp_ns"][there.argmax()]) for answer, there in signs.items() if there.any()}
    if episode.released_ns is not None:  # by themselves, perhaps, before control could say so
        firsts["damp"] = min(firsts.get("damp", FOREVER_NS), episode.released_ns)
    end_ns = firsts.get("damp", episode.until_ns)
    return dict(sorted(((a, t) for a, t in firsts.items() if t <= end_ns), key=lambda first: first[1]))


def _as_of(
    wanted_ns: npt.NDArray[np.int64], stamps_ns: npt.NDArray[np.int64], values: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Values at the last of their stamps before each time."""
    if not len(values):
        return np.ones(len(wanted_ns), np.bool_)
    rows = np.searchsorted(stamps_ns, wanted_ns, side="right") - 1
    return values[np.maximum(rows, 0)]


def _wrong_answer(row: LiveRow, answer: tuple[str, ...], took_ns: int, bound_ns: int) -> list[Flaw]:
    found = []
    if tuple(one for one in answer if one not in row.before) != row.answer:
        found.append(Flaw(f"answer is {', '.join(answer)}"))
    if took_ns > bound_ns:
        found.append(Flaw(f"took {took_ns * 1e-6:.0f} ms of {bound_ns * 1e-6:.0f} ms, stalls included"))
    return found


def _not_told(episode: Episode, logs: LiveLogs) -> list[Flaw]:
    """Faults that were not named, and counts that did not grow."""
    row, found = episode.row, list[Flaw]()
    status = logs.between(topics.SAFETY, episode.at_ns, episode.until_ns).values
    bits = status["warning"] | status["fault"] | status["halt"]
    missing = row.fault & ~Fault(int(np.bitwise_or.reduce(bits, initial=0)))
    if missing:
        found.append(Flaw(f"{missing.name} was not named"))
    if row.counted is not None:
        topic, name = row.counted
        before = _total(logs.between(topic, 0, episode.at_ns).values[name][-1:])
        after = _total(logs.between(topic, episode.at_ns, episode.until_ns).values[name][-1:])
        if after <= before:
            found.append(Flaw(f"{name} did not grow"))
    if row.recorder is not None and (episode.recorder is None or not row.recorder(episode.recorder)):
        found.append(Flaw("the recorder did not say what is wrong"))
    return found


def _total(values: npt.NDArray[Any]) -> int:
    return int(values.sum())


def abused(episode: Episode, logs: LiveLogs, config: Uslgo1Config) -> list[Flaw]:
    """Joints and torques beyond their limits, and falls."""
    found = []
    if not episode.joints_kept:
        found.append(Flaw(BEYOND_LIMITS))
    if episode.fell:
        found.append(Flaw("it fell before it was damped"))
    commands = logs.between(topics.JOINT_COMMAND_SAFE, episode.at_ns, episode.until_ns).values
    if np.abs(commands["effort"]).max(initial=0.0) > config.safety.effort_max_nm:
        found.append(Flaw(TOO_STRONG))
    return found


def _still_driven(episode: Episode, times: dict[str, int], config: Uslgo1Config, longest_ns: int) -> list[Flaw]:
    """Drives that were seen not to let go for longer than it takes them by themselves, whatever stalled meanwhile."""
    seen_ns = episode.until_ns - times.get("damp", episode.until_ns)
    let_go = episode.released_ns is not None or seen_ns <= let_go_in_real_time(config) + longest_ns
    return [] if let_go else [Flaw(STILL_DRIVEN)]


def old_commands(episode: Episode, logs: LiveLogs, age_max_ns: int) -> list[Flaw]:
    """Whether a command reached a drive that is too old, unless the world stood still by the fault itself."""
    from_ns = episode.at_ns - WHOLE_NS
    arrived = while_recorded(episode.frames, logs.ticks(from_ns, episode.until_ns))
    oldest_ns = oldest_command_ns(arrived, logs.between(topics.CAN_SENT, from_ns, episode.until_ns))
    if oldest_ns <= age_max_ns + COMES_WITHIN_NS or SIM.name in episode.row.holds_up:
        return []
    return [Flaw(f"a command of {oldest_ns * 1e-6:.1f} ms reached a drive", oldest_ns - age_max_ns)]


def moved_unarmed(logs: LiveLogs) -> list[str]:
    """Where in a log a robot that was not under power, or whose control had only started, was driven all the same."""
    status, commands = logs.whole(topics.SAFETY).values, logs.whole(topics.JOINT_COMMAND_SAFE).values
    idle = _as_of(commands["stamp_ns"], status["stamp_ns"], ~np.isin(status["mode"], (*_POWERED, Mode.CROUCHING)))
    asked = commands["stiffness"].any(axis=1) | commands["effort"].any(axis=1) | commands["velocity"].any(axis=1)
    stamps_ns = commands["stamp_ns"][idle & asked]
    found = [f"a robot without power was driven at {stamp_ns * 1e-9:.3f} s" for stamp_ns in stamps_ns[:1]]
    ticks = logs.ticks(0, FOREVER_NS)
    for row in np.flatnonzero(ticks["index"] == 0):
        mode = Mode(int(status["mode"][np.searchsorted(status["stamp_ns"], ticks["now_ns"][row])]))
        if mode not in (Mode.OFF, Mode.STANDBY):
            found.append(f"control began in {mode.name}")
    return found


def while_recorded(frames: Frames, ticks: npt.NDArray[Any]) -> Frames:
    """Those that did not arrive while ticks were lost: what was sent then is not known."""
    keep = np.ones(len(frames.arrival_ns), np.bool_)
    for row in np.flatnonzero(np.diff(ticks["index"]) > 1 + ticks["skipped"][1:]):
        begin_ns, end_ns = ticks["now_ns"][row : row + 2]
        keep &= (frames.arrival_ns <= begin_ns) | (frames.arrival_ns > end_ns + COMES_WITHIN_NS)
    return Frames(*(values[keep] for values in frames))


def oldest_command_ns(frames: Frames, sent: Signal) -> int:
    """Age of the oldest command that reached a drive, of those that are in the log.

    A frame is known by its bytes; of several alike the newest counts, since they ask for the same.
    """
    stamps: dict[tuple[int, bytes], list[int]] = {}
    for batch in sent.values:
        count = int(batch["count"])
        raw = batch["data"][: 16 * count].tobytes()
        for place, bus in enumerate(batch["bus"][:count].tolist()):
            stamps.setdefault((bus, raw[16 * place : 16 * place + 16]), []).append(int(batch["stamp_ns"]))
    oldest_ns = 0
    for arrival_ns, bus, raw in zip(frames.arrival_ns.tolist(), frames.bus.tolist(), frames.raw, strict=True):
        known = [stamp for stamp in stamps.get((bus, raw.tobytes()), ()) if stamp <= arrival_ns]
        if known:
            oldest_ns = max(oldest_ns, arrival_ns - known[-1])
    return oldest_ns
