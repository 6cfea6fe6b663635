# SPDX-License-Identifier: Apache-2.0
"""`ugv doctor`: is this host fit to run a robot? Looks at everything, changes nothing."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli.options import add_overrides

if TYPE_CHECKING:
    from runtime.cli.fitness.finding import Finding
    from runtime.cli.fitness.scheduling import Limits
    from runtime.robots.robot_config import RobotConfig

UNFIT = 2
SERVICE_RUNTIME, SERVICE_LOGS, SERVICE_CACHE = Path("/run/ugv"), Path("/var/log/ugv"), Path("/var/cache/ugv")
"""The directories of the units."""
DEFAULT_PRIORITY = 80
"""Of the fastest loop, where no robot says another one."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        "robot", metavar="ROBOT", nargs="?", help="whose buses and loops are looked at too, for example uslgo1"
    )
    parser.add_argument("--config", type=Path, metavar="FILE", help="configuration (default: the one of the robot)")
    parser.add_argument(
        "--runtime-dir", type=Path, metavar="DIR", default=SERVICE_RUNTIME, help="as of ugv run (default /run/ugv)"
    )
    parser.add_argument(
        "--log-dir", type=Path, metavar="DIR", default=SERVICE_LOGS, help="as of ugv run (default /var/log/ugv)"
    )
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    add_overrides(parser)


def run(options: argparse.Namespace) -> int:
    """Print every finding; `UNFIT` if one of them forbids to run."""
    from runtime.cli.fitness.finding import Verdict

    found = list(findings(configuration(options), options.runtime_dir, options.log_dir))
    fit = all(finding.verdict is not Verdict.FAIL for finding in found)
    print(as_json(found, fit) if options.json else as_text(found, fit))
    return 0 if fit else UNFIT


def configuration(options: argparse.Namespace) -> RobotConfig | None:
    """That of the robot, or of the file; None if neither was named."""
    from runtime.configuration import parse_overrides
    from runtime.errors import UsageError
    from runtime.robots import load_configuration

    source = str(options.config) if options.config is not None else options.robot
    overrides = parse_overrides(options.assignments)
    if source is None:
        if overrides:
            raise UsageError("ugv doctor: --set wants a robot, or a configuration with --config")
        return None
    return load_configuration(source, overrides)


def findings(config: RobotConfig | None, runtime_directory: Path, log_directory: Path) -> Iterator[Finding]:
    """Everything that there is to find on this host, for a robot if there is one."""
    from runtime.cli.fitness.scheduling import read_unit_limits

    unit = read_unit_limits()
    yield from _of_the_kernel(config, unit)
    if config is not None:
        yield from _of_the_wires(config, unit)
    yield from _of_the_software(runtime_directory, log_directory)


def _of_the_kernel(config: RobotConfig | None, unit: Limits | None) -> Iterator[Finding]:
    from runtime.cli.fitness import clocks, scheduling

    priority = DEFAULT_PRIORITY if config is None else config.highest_priority
    wanted = () if config is None else (*config.realtime.control_processors, *config.realtime.link_processors)
    own = scheduling.read_own_limits()
    yield scheduling.check_priority(priority, scheduling.try_priority(priority), own, unit)
    yield scheduling.check_memory(own, unit)
    yield scheduling.check_throttling(*scheduling.read_throttling())
    yield scheduling.check_preemption(scheduling.read_preemption())
    yield scheduling.check_request((unit or own).whose, scheduling.may_request(unit))
    yield scheduling.check_governors(scheduling.read_governors())
    yield scheduling.check_processors(os.sched_getaffinity(0), wanted)
    yield clocks.check_source(clocks.read_source(), clocks.read_resolution_s())
    yield clocks.check_date(clocks.read_synchronised())


def _of_the_wires(config: RobotConfig, unit: Limits | None) -> Iterator[Finding]:
    from drivers.bus_load import MAX_BUS_LOAD
    from runtime.cli.fitness import buses, endpoints, zenoh_file

    drives = config.drives
    if drives.interface == "socketcan":
        yield buses.check_kernel(buses.kernel_has_can())
        yield from buses.check_channels(drives.channels, drives.bit_rate_hz, buses.read_links())
    yield buses.check_loads(config.bus_loads(), MAX_BUS_LOAD)
    if config.link.zenoh_config:
        file = Path(config.link.zenoh_config)
        readable, refusal = zenoh_file.may_read(file, unit), zenoh_file.read_refusal(file)
        yield zenoh_file.check_file(file, unit, readable, refusal, refusal == "" and zenoh_file.is_open(file))
    else:
        free = [endpoints.is_free(text) for text in config.link.listen]
        yield from endpoints.check_endpoints(config.link.listen, free, endpoints.link_is_running())


def _of_the_software(runtime_directory: Path, log_directory: Path) -> Iterator[Finding]:
    from runtime.cli.fitness import files, software
    from runtime.kernel_cache import kept_directory

    logs = files.read_directory(log_directory)
    yield files.check_writable("runtime directory", files.read_directory(runtime_directory), "--runtime-dir")
    yield files.check_writable("log directory", logs, "--log-dir")
    yield files.check_room(logs)
    yield software.check_packages(
        software.read_required(), software.pins(software.read_constraints()), software.read_installed()
    )
    kernels = SERVICE_CACHE / "kernels" if SERVICE_CACHE.is_dir() else kept_directory()
    yield software.check_kernels(*software.read_kernels(kernels), kernels)


def as_text(found: Sequence[Finding], fit: bool) -> str:
    """A line for each finding, and one for its remedy."""
    width = max(len(finding.name) for finding in found)
    lines = []
    for finding in found:
        lines.append(f"{finding.verdict.value:<5} {finding.name:<{width}}  {finding.sentence}")
        if finding.remedy:
            lines.append(f"{'':<5} {'':<{width}}  -> {finding.remedy}")
    return "\n".join([*lines, "this host is fit to run" if fit else "this host is not fit to run"])


def as_json(found: Sequence[Finding], fit: bool) -> str:
    """The same for programs."""
    import json

    return json.dumps({"fit": fit, "findings": [finding._asdict() for finding in found]}, indent=2)
