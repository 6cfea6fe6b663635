# SPDX-License-Identifier: Apache-2.0
"""What /diagnostics says: every state that is not well, and every counter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import Any

from runtime.link.control_monitor import ControlMonitor
from runtime.link.loop_statistics import spread
from runtime.link.tally import Tally
from runtime.messages.diagnostics import Level, Status
from runtime.models.vehicle import WHEELS
from runtime.recording.recorder_status import RecorderStatus
from runtime.records import Record
from runtime.robots import topics
from runtime.signals import (
    Battery,
    BusState,
    BusStatus,
    ContactForces,
    Fault,
    JointCommand,
    JointState,
    Mode,
    OperatorEvent,
    SafetyStatus,
)
from runtime.vehicle_signals import WheelState, WheelStatus

RECORDER_SILENT_NS = 3_000_000_000
"""It speaks once a second."""


@lru_cache(maxsize=64)
def member_name(kind: type[IntEnum], number: int) -> str:
    """Name of an enumeration's member, or the number if it has none."""
    return next((member.name.lower() for member in kind if member == number), str(number))


@lru_cache(maxsize=64)
def fault_names(bits: int) -> str:
    """Names of fault bits, or `none`."""
    names = [fault.name.lower() for fault in Fault if fault and bits & fault and fault.name]
    unknown = bits & ~sum(Fault)
    return " ".join(names + ([f"{unknown:#x}"] if unknown else [])) or "none"


def hottest(temperatures: Iterable[float]) -> float:
    """The highest of the temperatures that are known, NaN if none is."""
    return max(filter(math.isfinite, temperatures), default=math.nan)


@dataclass
class Diagnosis:
    """Looks at the robot through the ticks of its loops, and at the link itself.

    A counter makes a warning once, in the diagnosis after it has grown.

    Args:
        monitor: of the control loops.
        tally: of received messages.
        silent_ns: without a tick for so long, control is called silent.
        recorder: gives what the recorder says of itself, None if it has never said anything.
        battery_age_max_ns: with an older word of the battery it is called silent.
    """

    monitor: ControlMonitor
    tally: Tally
    silent_ns: int
    recorder: Callable[[], RecorderStatus | None]
    battery_age_max_ns: int

    def __post_init__(self) -> None:
        self._before: dict[str, float] = {}

    def state(self, now_ns: int) -> tuple[str, str]:
        """Mode and latched faults by name; the mode is `silent` while control is."""
        if self.monitor.silent(now_ns, self.silent_ns):
            return "silent", "none"
        safety = self.monitor.newest(topics.SAFETY, SafetyStatus)
        if safety is None:
            return "unknown", "none"
        return member_name(Mode, safety.mode), fault_names(safety.fault)

    def statuses(self, now_ns: int, link: Mapping[str, object]) -> list[Status]:
        """Every part's status.

        Args:
            now_ns: monotonic.
            link: figures of the link itself.
        """
        found = [self._control(now_ns), *self._signals(), *self._loops(), self._imu(), *self._inputs(now_ns)]
        found += [self._battery(now_ns), self._recorder(now_ns)]
        return [*found, self._counted("link", {"malformed_ticks": self.monitor.malformed}, link)]

    def _control(self, now_ns: int) -> Status:
        mode, faults = self.state(now_ns)
        values: dict[str, Any] = {"mode": mode, "faults": faults}
        safety = self.monitor.newest(topics.SAFETY, SafetyStatus)
        if safety is not None:
            warnings = fault_names(safety.warning)
            values |= {"warnings": warnings, "limited_commands": safety.limited, "falls_into_damped": safety.faults}
            if mode not in ("silent", "damped") and safety.warning:
                return Status("control", Level.WARN, f"{mode}, warning: {warnings}", values)
        if mode == "silent":
            return Status("control", Level.ERROR, "control is silent", values)
        if mode == "damped":
            return Status("control", Level.ERROR, f"damped: {faults}", values)
        return Status("control", Level.OK, mode, values)

    def _signals(self) -> Iterator[Status]:
        newest = self.monitor.newest
        joints = newest(topics.JOINT_STATE, JointState)
        if joints is not None:
            values = {
                "errors": " ".join(map(str, joints.error.tolist())),
                "hottest_degc": hottest(joints.temperature.tolist()),
            }
            yield self._counted("joints", {"rejected_frames": joints.rejected}, values, bool(joints.error.any()))
        wheels = newest(topics.WHEEL_STATE, WheelState)
        if wheels is not None:
            yield self._wheels(wheels, newest(topics.WHEEL_STATUS, WheelStatus))
        buses = newest(topics.BUS_STATUS, BusStatus)
        if buses is not None:
            yield from self._buses(buses)
        body: Any = newest(topics.BODY_STATE, Record)
        if body is not None:
            counts = {"rejected_imu": body.imu_rejected, "rejected_poses": body.localization_rejected}
            yield self._counted("estimator", counts, {"localization_age_ms": body.localization_age_ns / 1e6})
        forces, command = newest(topics.CONTACT_FORCES, ContactForces), newest(topics.JOINT_COMMAND, JointCommand)
        if forces is not None and command is not None:
            yield self._counted("solvers", {"mpc_failures": forces.failures, "wbc_failures": command.qp_failures}, {})
        tracker: Any = newest(topics.BODY_COMMAND, Record)
        if tracker is not None:
            counts = {"rejected_paths": tracker.rejected_paths, "foreign_paths": tracker.foreign_paths}
            yield self._counted("tracker", counts, {})
        event = newest(topics.OPERATOR_EVENT, OperatorEvent)
        if event is not None:
            yield self._counted("operator", {"lost_events": int(event.lost)}, {})

    def _wheels(self, wheels: WheelState, status: WheelStatus | None) -> Status:
        motors = [f"{wheel} {motor}" for motor in ("steering", "drive") for wheel in WHEELS]
        broken = [f"{motor} fault {code}" for motor, code in zip(motors, wheels.fault.tolist(), strict=True) if code]
        if status is not None:
            broken += [f"{wheel} stuck" for wheel, stuck in zip(WHEELS, status.stuck.tolist(), strict=True) if stuck]
        values = {
            "faults": " ".join(map(str, wheels.fault.tolist())),
            "hottest_degc": hottest(wheels.temperature.tolist()),
        }
        counts = {name: int(getattr(wheels, name)) for name in ("rejected", "corrupt", "stalled")}
        return self._counted("wheels", counts, values, bool(broken), ", ".join(broken))

    def _buses(self, buses: BusStatus) -> Iterator[Status]:
        counters = ("refused", "failed", "malformed", "errors", "overflow", "purged", "withheld")
        for number, state in enumerate(buses.state.tolist()):
            name = member_name(BusState, state)
            counts = {counter: int(getattr(buses, counter)[number]) for counter in counters}
            yield self._counted(f"bus {number}", counts, {"state": name}, state != BusState.UP, name)

    def _loops(self) -> Iterator[Status]:
        for name, loop in self.monitor.loops.items():
            figures = loop.figures()
            counts = {key: figures.pop(key) for key in ("skipped", "late", "missed")}
            yield self._counted(f"loop {name}", counts | {"recorder_drops": loop.dropped}, figures)

    def _imu(self) -> Status:
        values: dict[str, Any] = {"passed_over": self.monitor.imu_passed_over}
        return Status("imu", Level.OK, "age at use", values | spread("age_us", list(self.monitor.imu_age_ns)))

    def _inputs(self, now_ns: int) -> Iterator[Status]:
        accepted, rejected, lost = self.tally.snapshot()
        for topic in sorted({*accepted, *lost, *(topic for topic, _ in rejected)}):
            counts = {reason: number for (where, reason), number in sorted(rejected.items()) if where == topic}
            figures: dict[str, object] = {"accepted": accepted.get(topic, 0)}
            if topic in accepted:
                figures["age_ms"] = (now_ns - self.tally.last_ns[topic]) / 1e6
            yield self._counted(f"input {topic}", counts | {"lost": lost.get(topic, 0)}, figures)

    def _battery(self, now_ns: int) -> Status:
        """What it last said; a battery that says nothing is not watched for its voltage."""
        battery = self.monitor.newest(topics.BATTERY, Battery)
        if battery is None:
            return Status("battery", Level.WARN, "the battery has said nothing: its voltage is not watched", {})
        age_ns = now_ns - battery.stamp_ns
        figures = {"voltage_v": battery.voltage, "current_a": battery.current, "charge": battery.charge}
        figures["age_ms"] = age_ns / 1e6
        if age_ns > self.battery_age_max_ns:
            return Status("battery", Level.WARN, "the battery is silent: its voltage is no longer watched", figures)
        return Status("battery", Level.OK, "", figures)

    def _recorder(self, now_ns: int) -> Status:
        """Whether the log is written; control goes on without it."""
        status = self.recorder()
        if status is None:
            return Status("recorder", Level.WARN, "there has been no recorder", {})
        figures = {"log": status.bag, "bags": status.bags, "backlog_bytes": status.backlog_bytes}
        if now_ns - status.updated_ns > RECORDER_SILENT_NS:
            return Status("recorder", Level.ERROR, "the recorder is silent", figures)
        counts = {name: getattr(status, name) for name in ("gaps", "failed", "rejected", "overflowed")}
        failing = bool(status.error) and not status.recording
        return self._counted("recorder", counts, figures, failing, status.error if failing else "")

    def _counted(
        self,
        name: str,
        counts: Mapping[str, float],
        figures: Mapping[str, object],
        unwell: bool = False,
        message: str = "",
    ) -> Status:
        """A status whose counts make it a warning if they grew since the last time."""
        grown = [key for key, value in counts.items() if value > self._before.get(f"{name}/{key}", 0)]
        self._before |= {f"{name}/{key}": value for key, value in counts.items()}
        level = Level.ERROR if unwell else Level.WARN if grown else Level.OK
        words = ", ".join(part for part in (message, *(f"more: {key}" for key in grown)) if part)
        return Status(name, level, words, {**figures, **counts})
