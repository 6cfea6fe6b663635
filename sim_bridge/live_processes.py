# SPDX-License-Identifier: Apache-2.0
"""A robot in simulation as it is on a robot: control, link and recorder as `ugv run` starts them, and a simulator."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec

from runtime.configuration import dump
from runtime.executors.processes import ProcessError, Processes, how_it_ended
from runtime.robots import load_configuration
from runtime.robots.robot_config import RobotConfig
from sim_bridge.free_port import free_port
from sim_bridge.live_buses import MakeBuses, live_buses
from sim_bridge.process import Task
from sim_bridge.run import packed
from sim_bridge.simulation import simulation_of

STOP_ORDER = ("control", "sim", "link", "recorder")


@contextmanager
def wired(
    robot: str, chosen: Mapping[str, str], directory: Path, make: MakeBuses = live_buses
) -> Iterator[tuple[RobotConfig, str]]:
    """The configuration of a robot on buses made for one run, its link with a port of its own; and what the buses are.

    Args:
        robot: its name.
        chosen: overrides of its configuration.
        directory: runtime directory.
        make: makes the buses.
    """
    with make(load_configuration(robot, chosen).drives.buses, directory) as buses:
        wiring = {
            "drives.interface": buses.interface,
            "drives.channels": json.dumps(buses.channels),
            "link.listen": json.dumps([f"tcp/127.0.0.1:{free_port()}"]),
        }
        yield load_configuration(robot, {**chosen, **wiring}), buses.note


class LiveProcesses:
    """The processes of one run, as a context manager.

    Args:
        config: as of `wired`.
        task: of the simulator, but for its configuration, which is written into the runtime directory.
        out: directory that the recorder writes in.

    Attributes:
        processes: those that run.
        refused: what the system did not grant the simulator, as sentences.
    """

    def __init__(self, config: RobotConfig, task: Task, out: Path) -> None:
        directory = Path(task.directory)
        file = directory / "config.toml"
        file.write_text(dump(config))
        terrain = simulation_of(config).scenario(task.scenario, task.seed).terrain(task.seed)
        (directory / "terrain.npz").write_bytes(packed(terrain))
        self._task = msgspec.structs.replace(task, config=str(file))
        self._ugv = [sys.executable, "-m", "runtime.cli.main", "run", config.robot, "--config", str(file)]
        self._ugv += ["--runtime-dir", str(directory), "--log-dir", str(out.resolve()), "--process"]
        self.processes = Processes(directory=directory)
        self.refused: list[str] = []

    def __enter__(self) -> LiveProcesses:
        self.processes.__enter__()
        try:
            for name in ("recorder", "link"):
                self.start(name)
                self.processes.wait_ready(name)
            self.start_simulator()
            self.start("control")
        except BaseException:
            self.processes.__exit__(None, None, None)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.processes.__exit__(kind, error, trace)

    def start(self, name: str) -> None:
        """Start control, link or recorder."""
        self.processes.start(name, [*self._ugv, name])

    def restart(self, name: str) -> None:
        """Do what a service manager does about control, link or recorder that died; all but control are then ready.

        Control is ready when it keeps time: that is for the robot's state to tell.
        """
        self.processes.stop(name)
        self.start(name)
        if name != "control":
            self.processes.wait_ready(name)

    def start_simulator(self) -> None:
        """Start the simulator, and wait until it is ready."""
        simulator = self.processes.start("sim", [sys.executable, "-m", "sim_bridge.process"], piped=True)
        assert simulator.stdin is not None
        assert simulator.stdout is not None
        self._orders, self._lines = simulator.stdin, simulator.stdout
        self.order(self._task)
        for answer in self.answers():
            if "ready" in answer:
                self.refused = answer["refused"]
                break

    def order(self, order: msgspec.Struct) -> None:
        """Tell the simulator something.

        Raises:
            ProcessError: if it is gone.
        """
        try:
            self._orders.write(msgspec.json.encode(order) + b"\n")
            self._orders.flush()
        except BrokenPipeError:
            raise ProcessError("the simulator takes no more orders") from None

    def answers(self) -> Iterator[dict[str, Any]]:
        """What the simulator says, until it has said how the run went; when that is over, control ends, then it.

        Raises:
            ProcessError: if it ends before that.
        """
        for line in self._lines:
            answer = json.loads(line)
            if "over" in answer:
                self.processes.stop("control")
                self.processes.terminate("sim")
            yield answer
            if "outcome" in answer:
                return
        raise ProcessError(f"the simulator {how_it_ended(self.processes.stop('sim'))} before the run was over")

    def stop(self) -> None:
        """End in order all that still run: the recorder is the last, so that it has heard everything."""
        for name in STOP_ORDER:
            if name in self.processes.names:
                self.processes.stop(name)
