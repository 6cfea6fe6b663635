# SPDX-License-Identifier: Apache-2.0
"""What is made of the outcomes: ratios, verdicts, sentences, tables and the report say what the figures say."""

import math
import re

import numpy as np
import pytest

from runtime.configuration import ConfigError
from runtime.errors import OutputError
from runtime.robots import load_configuration
from sim_bridge.paper_002.claims import Claim, claims
from sim_bridge.paper_002.contenders import COMPENSATED, CONTENDERS, FUZZY, GAINS, OURS, PAPERS, PLAIN, ROBOT
from sim_bridge.paper_002.findings import findings
from sim_bridge.paper_002.pictures import pictures
from sim_bridge.paper_002.plants import DELAYS_NS, IDEAL, PLANTS, PROMPT, WORST, late_command, late_pose
from sim_bridge.paper_002.report import write_report
from sim_bridge.paper_002.results import SHAPES
from sim_bridge.paper_002.tables import Table, claim_table, kinematic_tables
from sim_bridge.paper_002.vehicle import (
    DRIVEN_PLANTS,
    all_drives,
    driven_contenders,
    few_drives,
    settings_of,
    vehicle_claims,
    vehicle_table,
)
from sim_bridge.paper_002.vehicle_drive import Driven, Track, is_shown
from sim_bridge.paper_002.vehicle_pictures import vehicle_pictures


def settled(outcome, **changes):
    return outcome._replace(settling=type(outcome.settling)(**{**vars(outcome.settling), **changes}))


def by_title(tables, beginning):
    return next(table for table in tables if table.title.startswith(beginning))


def test_figures_over_the_shapes_count_each_alike(printed_results):
    errors = dict(zip(SHAPES, (0.01, 0.02, 0.03, 0.04, 0.10), strict=True))

    def change(outcome):
        if outcome.trial.course in errors and outcome.trial.contender.name == OURS.name:
            return settled(outcome, mean_after_m=errors[outcome.trial.course])._replace(
                mean_m=1.0, arrived=outcome.trial.course != "curve-s"
            )
        return outcome

    results = printed_results(change)
    assert results.after_m(PROMPT, OURS) == pytest.approx(0.04)
    assert results.ratio(PROMPT, OURS) == pytest.approx(0.04 / 0.121)
    assert results.whole_m(PROMPT, OURS) == 1.0
    assert results.arrived(PROMPT, OURS) == len(SHAPES) - 1
    assert results.inner_ratio(WORST, GAINS[2]) == pytest.approx(30.2 / 56.9)


@pytest.mark.parametrize(
    ("measured", "verdict"), [(0.5, "aim met"), (0.7, "kept"), (0.8, "kept"), (0.81, "MISSED"), (math.nan, "MISSED")]
)
def test_a_claim_says_whether_it_is_kept(measured, verdict):
    claim = Claim("ratio", measured, at_least=0.8, aim=0.6)
    assert claim.verdict == verdict
    assert claim.kept == (verdict != "MISSED")
    assert claim._replace(decides=False).verdict == ("beside" if claim.kept else "beside: above")


def test_claims_take_ours_on_the_worst_plant_and_the_worst_shape(printed_results):
    def change(outcome):
        course, plant, contender = outcome.trial
        if (course, plant, contender.name) == ("curve-loop", WORST, OURS.name):
            return settled(outcome, mean_after_m=0.09)
        return settled(outcome, mean_25_s_m=0.3) if plant == WORST and contender.name == OURS.name else outcome

    table = claims(printed_results(change))
    missed = {claim.what for claim in table if claim.decides and not claim.kept}
    assert missed == {
        f"straight, {WORST}, {OURS.name}: mean error over 25 s, m",
        f"curves, {WORST}, {OURS.name}: mean error after 12 s, worst shape, m",
    }
    assert not any(claim.decides for claim in table if claim.what.split(", ")[2:3] == [FUZZY.name])
    assert all(claim.kept for claim in claims(printed_results()) if claim.decides)


def test_where_the_paper_is_reproduced_the_findings_say_so(printed_results):
    said = findings(printed_results())
    assert sum("So it does on every plant" in sentence for sentence in said) == 3
    assert "0.234 to 0.209 m" in said[0]
    assert "15.3 to 7.5 s" in said[1]
    assert "0.53 of plain pursuit's" in said[2]
    assert "16.7 degrees, in the paper 16.7" in said[2]
    assert not any("misses the goal" in sentence for sentence in said)


def test_where_it_is_not_they_name_the_plants_and_the_figures(printed_results):
    def change(outcome):
        _, plant, contender = outcome.trial
        if plant == IDEAL and contender.name == PLAIN.name:
            return settled(outcome, mean_25_s_m=0.17, mean_after_m=0.03)
        if plant == WORST and contender.name == PAPERS.name:
            return settled(outcome, mean_after_m=0.5)._replace(arrived=outcome.trial.course == "curve-u")
        return outcome

    error, settling, _, curves, *_ = findings(printed_results(change))
    assert error.endswith(f"it does not for {IDEAL} (0.170 to 0.209 m).")
    assert "So it does on every plant" in settling
    assert f"it does not for {IDEAL} (0.030 to 0.085 m) and {WORST} (0.121 to 0.500 m)." in curves
    assert curves.endswith(f"It misses the goal on 4 of 5 for {WORST}.")


def test_who_never_settles_has_not_settled_sooner(printed_results):
    def change(outcome):
        return settled(outcome, time_s=math.nan) if outcome.trial.contender.name == GAINS[2].name else outcome

    results = printed_results(change)
    assert "It does so on no plant" in findings(results)[1]
    row = by_title(kinematic_tables(results), "Table II").rows[2]
    assert row[:5] == (IDEAL, GAINS[2].name, "0.209", "0.209", "-")


def test_late_commands_help_plain_pursuit_only_where_they_do(printed_results):
    errors = {late_command(delay): error for delay, error in ((0, 0.03), (300_000_000, 0.02), (600_000_000, 0.01))}

    def change(outcome):
        error = errors.get(outcome.trial.plant) if outcome.trial.contender.name == PLAIN.name else None
        return outcome if error is None else settled(outcome, mean_after_m=error)

    assert "take back some of the corners" in findings(printed_results(change))[5]
    errors[WORST] = 0.05
    assert "take back" not in findings(printed_results(change))[5]


def test_tables_have_every_plant_and_every_contender_beside_the_papers_figures(printed_results):
    results = printed_results()
    tables = [*kinematic_tables(results), claim_table(claims(results))]
    for table in tables:
        assert {len(row) for row in table.rows} == {len(table.header)}
    table_ii = by_title(tables, "Table II")
    assert [row[:2] for row in table_ii.rows] == [(plant, who.name) for plant in PLANTS for who in GAINS]
    assert all(row[2] == row[3] and row[4] == row[5] and row[6] == row[7] for row in table_ii.rows)
    for table in tables:
        if table.header[1:7] == tuple(PLANTS):
            assert [row[0] for row in table.rows] == [who.name for who in CONTENDERS]
    whole = by_title(tables, "Curves, start")
    assert [row[-1] for row in whole.rows if row[-1] != "-"] == ["0.121", "0.085"]


def test_a_goal_that_was_not_reached_is_counted_in_its_cell(printed_results):
    results = printed_results(lambda outcome: outcome._replace(arrived=outcome.trial.course != "curve-s"))
    rows = by_title(kinematic_tables(results), "Curves after the first 12 s: mean error over").rows
    assert all(cell.endswith(", 1 not") for row in rows for cell in row[1:])


def test_the_report_stands_on_its_own(printed_results, tmp_path):
    results = printed_results()
    tables = [
        claim_table(claims(results)),
        *kinematic_tables(results),
        Table("<odd>", ("a", "b"), [("1 < 2", "MISSED")]),
    ]
    path = write_report(tmp_path, ["kinematic"], findings(results), tables, pictures(results))
    text = path.read_text()
    assert "$" not in re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL)
    assert not re.search(r'(?:src|href)="(?!#)', re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL))
    assert "&lt;odd&gt;" in text
    assert "What came out" in text
    assert '<td class="missed">MISSED</td>' in text
    assert '<th class="text">method</th>' in text
    assert f'<td class="text">{OURS.name}</td>' in text
    assert text.count("<svg") == 10
    for title in (
        f"Straight, {IDEAL}: the paper",
        f"Straight, {WORST}: methods",
        f"Curves, {PROMPT}",
        f"Curves, {WORST}",
        *(f"Curves, {late_pose(delay)}" for delay in DELAYS_NS),
    ):
        assert f"<h2>{title}" in text
    for shape in SHAPES.values():
        assert f"<!-- {shape} -->" in text or f">{shape}<" in text


def test_a_report_without_findings_does_not_announce_any(tmp_path):
    assert "What came out" not in write_report(tmp_path, ["mujoco"], [], [], []).read_text()


def test_a_report_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(OutputError, match=r"report.html: cannot be written: No such file or directory"):
        write_report(tmp_path / "none", [], [], [], [])


def test_drives_of_the_vehicle_have_the_delays_and_rates_of_their_plants():
    drives = all_drives(2)
    assert len(drives) == (1 + len(SHAPES)) * len(DRIVEN_PLANTS) * len(driven_contenders()) * 2
    chosen = [drive for drive in drives if drive.scenario == "straight" and drive.seed == 0]
    for drive in [drive for drive in chosen if drive.plant == WORST or drive.contender.name == OURS.name]:
        settings = {**settings_of(drive), "variant.controller": drive.contender.controller}
        try:
            config = load_configuration(ROBOT, settings)
        except ConfigError as error:
            pytest.fail(f"{drive}: {error}")
        plant, simulation = PLANTS[drive.plant], config.simulation
        assert simulation.command_delay_ns == plant.command_delay_ns
        assert simulation.localization_latency_ns == (plant.pose_delay_ns or 80_000_000)
        assert simulation.center_rate_radps == pytest.approx(math.radians(20.0))
        assert config.tracker.following.answer.rate_radps == pytest.approx(math.radians(20.0))
        assert config.safety.steering_stuck_ns > plant.command_delay_ns + 500_000_000
        assert config.safety.refusal_ns > plant.command_delay_ns + 500_000_000
        if drive.contender.name in (PLAIN.name, PAPERS.name):
            assert config.delay.initial_s == config.delay.maximum_s == 0.0
        if drive.contender.name == COMPENSATED.name:
            assert config.delay.maximum_s > 0.6


def summary_of(drive):
    """Ours completes every drive, all others only those of the first seed, and do worse in the second."""
    good = drive.contender.name == OURS.name
    after = 0.01 if good else 0.02 + 0.02 * drive.seed
    settling = {"mean_25_s_m": 0.2 + 0.1 * drive.seed, "time_s": 7.0, "overshoot_m": 0.0, "mean_after_m": after}
    if drive.plant == WORST and drive.contender.name == PLAIN.name and drive.scenario == "straight":
        settling["time_s"] = None
    return {"completed": drive.seed == 0 or good, "settling": settling}


def test_the_vehicles_table_has_the_means_of_what_was_completed_and_says_how_much_that_is():
    table = vehicle_table([(drive, summary_of(drive)) for drive in all_drives(2)])
    assert len(table.rows) == len(DRIVEN_PLANTS) * len(driven_contenders())
    rows = {row[:2]: row[2:] for row in table.rows}
    assert rows[PROMPT, OURS.name] == ("2 of 2", "0.250", "7.0", "0.000", "10 of 10", "0.0100", "0.50")
    assert rows[WORST, PLAIN.name] == ("1 of 2", "0.200", "-", "0.000", "5 of 10", "0.0200", "1.00")


def test_of_a_method_that_completes_nothing_there_are_no_figures():
    def nothing(drive):
        return {**summary_of(drive), "completed": drive.contender.name != PLAIN.name}

    rows = {row[:2]: row[2:] for row in vehicle_table([(drive, nothing(drive)) for drive in few_drives(1)]).rows}
    assert set(rows) == {(plant, who.name) for plant in (PROMPT, WORST) for who in (PLAIN, PAPERS, COMPENSATED, OURS)}
    assert rows[WORST, PLAIN.name] == ("0 of 1", "-", "-", "-", "0 of 1", "-", "-")
    assert rows[WORST, OURS.name][4:] == ("1 of 1", "0.0100", "-")


def test_it_is_claimed_that_ours_completes_every_drive():
    driven = [(drive, summary_of(drive)) for drive in all_drives(2)]
    ours, beside = vehicle_claims(driven)
    assert (ours.decides, ours.measured, ours.kept) == (True, 0, True)
    assert (beside.decides, beside.measured) == (False, len(DRIVEN_PLANTS) * 6)
    lost = [(drive, {**summary, "completed": drive.plant != WORST}) for drive, summary in driven]
    assert vehicle_claims(lost)[0].measured == 12
    assert not vehicle_claims(lost)[0].kept
    assert not vehicle_claims([])[0].kept


def test_the_tracks_that_are_shown_are_among_the_few_drives_and_are_drawn():
    shown = [drive for drive in few_drives(2) if is_shown(drive)]
    assert [drive for drive in all_drives(2) if is_shown(drive)] == shown
    assert {(drive.scenario, drive.contender.name) for drive in shown} == {
        (course, who.name) for course in ("straight", "curve-s") for who in (PLAIN, PAPERS, OURS)
    }
    t = np.arange(0.0, 40.0, 0.1)
    track = Track(t, np.column_stack((0.6 * t, 1.5 * np.exp(-t))), 1.5 * np.exp(-t))
    figures = vehicle_pictures([Driven(drive, {}, track if is_shown(drive) else None) for drive in few_drives(2)])
    assert [figure.title for figure in figures] == [
        f"The simulated vehicle (MuJoCo) on {course}, {WORST}" for course in ("straight", "curve-s")
    ]
    for who in (PLAIN, PAPERS, OURS):
        assert all(f"<!-- {who.name} -->" in figure.svg for figure in figures)
    assert vehicle_pictures([Driven(drive, {}) for drive in few_drives(1)]) == []
