# SPDX-License-Identifier: Apache-2.0
"""Figures in real time are judged by the spread of those in lockstep, and by the stalls of the machine."""

from typing import Any

import pytest

from runtime.cli import main as cli
from runtime.cli.experiment_realtime import COMPLETED, FIGURES, LIVE_SEEDS, SCENARIOS, compared, figure_of, stall_of

STALLED = {
    "cause": "STALE_IMU",
    "bound": {"loops": ["sim", "link"], "ms": 16.0},
    "stall": {"loop": "sim", "ms": 34.2},
}
UNEXPLAINED = {"cause": "TILT", "bound": None, "stall": None}


def run_of(rms_m: float = 0.010, seed: int = 0, **changes: Any) -> dict[str, Any]:
    return {
        "scenario": "flat",
        "seed": seed,
        "completed": True,
        "fell": False,
        "completion_time_s": 17.0 + 10.0 * rms_m,
        "lateral_error_m": {"rms": rms_m, "max": 3.0 * rms_m},
        "speed_mps": {"mean": 0.6 + rms_m / 10.0},
        "faults": [],
        "pauses": [],
        "flaws": [],
        **changes,
    }


LOCKSTEP = [run_of(rms_m) for rms_m in (0.010, 0.011, 0.012, 0.013)]


def judged(live: dict[str, Any]) -> dict[str, tuple[bool, bool]]:
    return {one.name: (one.within, one.fails) for one in compared(LOCKSTEP, live)}


def test_every_figure_is_compared_with_its_own_spread():
    found = {one.name: one for one in compared(LOCKSTEP, run_of(0.012, seed=1))}
    assert list(found) == [COMPLETED, *FIGURES]
    assert all(one.within and not one.fails and one.seed == 1 for one in found.values())
    rms = found["lateral RMS cm"]
    assert (rms.spread.least, rms.spread.most, rms.figure) == (1.0, 1.3, 1.2)


def test_a_figure_outside_fails_unless_a_stall_beyond_a_bound_explains_it():
    assert judged(run_of(0.050))["lateral RMS cm"] == (False, True)
    assert judged(run_of(0.050, pauses=[STALLED]))["lateral RMS cm"] == (False, False)
    assert judged(run_of(0.050, faults=[UNEXPLAINED]))["lateral RMS cm"] == (False, True)


def test_a_run_that_is_not_completed_has_no_figures_and_fails():
    for change in ({"completed": False}, {"fell": True}):
        assert judged(run_of(**change)) == dict.fromkeys((COMPLETED, *FIGURES), (False, True))


def test_what_lockstep_has_too_few_figures_of_is_not_compared():
    without = [run_of(lateral_error_m={}, completion_time_s=None) for _ in range(4)]
    assert [one.name for one in compared(without, run_of())] == [COMPLETED, "mean speed m/s"]
    assert figure_of({"completed": True, "fell": False}, "lateral RMS cm") is None


def test_the_stall_is_told_with_the_bound_that_it_is_beyond():
    assert stall_of(run_of(faults=[UNEXPLAINED, STALLED])) == ("sim stalled for 34.2 ms, beyond the 16 ms of STALE_IMU")
    assert stall_of(run_of(faults=[UNEXPLAINED])) == ""


@pytest.mark.parametrize(
    ("live", "word", "code"),
    [
        ({}, "yes", 0),
        ({"rms_m": 0.05}, "NO", 1),
        ({"rms_m": 0.05, "pauses": [STALLED]}, "no, it stalled", 0),
        ({"completed": False, "faults": [STALLED]}, "flat: not shown, since this machine stalled in each run", 0),
        ({"flaws": ["power was lost to TILT"]}, "flat, seed 0: power was lost to TILT", 1),
    ],
)
def test_the_table_is_printed_and_what_differs_fails(monkeypatch, capsys, live, word, code):
    asked = []

    def simulate_live(robot, scenario, *, seed, out, progress):
        asked.append((robot, scenario, seed))
        assert out.is_dir()
        return run_of(**live, seed=seed)

    monkeypatch.setattr("runtime.cli.sil.simulate_live", simulate_live)
    monkeypatch.setattr("runtime.cli.batch.run_jobs", lambda jobs, progress: LOCKSTEP[: len(jobs)])
    assert cli.main(["experiment", "realtime", "--scenarios", "flat", "--seeds", "4"]) == code
    assert asked == [("uslgo1", "flat", seed) for seed in range(LIVE_SEEDS)]
    out = capsys.readouterr().out
    assert word in out
    assert ("not shown" in out) is ("not shown" in word)


def test_an_unknown_robot_and_too_few_seeds_are_refused(capsys):
    assert cli.main(["experiment", "realtime", "--robot", "r2d2"]) == 2
    assert "r2d2" in capsys.readouterr().err
    assert cli.main(["experiment", "realtime", "--seeds", "2"]) == 2
    assert "--seeds 2 is below the 3" in capsys.readouterr().err


def test_every_robot_has_scenarios_of_its_own_to_compare():
    from runtime.robots import ROBOTS, load_configuration
    from sim_bridge.simulation import simulation_of

    assert set(SCENARIOS) == set(ROBOTS)
    for robot, names in SCENARIOS.items():
        simulation = simulation_of(load_configuration(robot))
        assert all(simulation.scenario(name, 0).waypoints for name in names)
