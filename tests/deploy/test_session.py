# SPDX-License-Identifier: Apache-2.0
"""`ugv run` without a service manager keeps the processes running by the same times as the units."""

from pathlib import Path

import pytest

from runtime.cli.run import PROCESSES
from runtime.cli.session import services

UNITS = Path(__file__).parents[2] / "deploy" / "systemd"


def seconds(value):
    return float(value.removesuffix("ms")) * 1e-3 if value.endswith("ms") else float(value)


def settings(name):
    lines = (UNITS / f"ugv-{name}.service").read_text().splitlines()
    return dict(line.split("=", 1) for line in lines if "=" in line and not line.startswith("#"))


@pytest.mark.parametrize("service", services(["ugv", "--process"]), ids=lambda service: service.name)
def test_the_times_are_those_of_the_unit(service):
    unit = settings(service.name)
    assert service.command[-1] == service.name
    assert service.ready_within_s == seconds(unit["TimeoutStartSec"])
    assert service.silent_for_s == seconds(unit["WatchdogSec"])
    assert service.pause_s == seconds(unit["RestartSec"])
    assert (service.starts, service.within_s) == (int(unit["StartLimitBurst"]), seconds(unit["StartLimitIntervalSec"]))


def test_the_order_is_that_of_the_units():
    names = [service.name for service in services([])]
    assert names == list(PROCESSES)
    for place, name in enumerate(names):
        after = settings(name).get("After", "").split()
        assert [one for one in names if f"ugv-{one}.service" in after] == names[:place]
