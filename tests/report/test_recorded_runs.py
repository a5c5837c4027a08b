"""What the ranking, its sentences and the figure `track` say of one recording, and of several."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import same_color

from trackbench import api
from trackbench.report.figures.track import Track
from trackbench.report.findings.best_filter_sentences import _explain_undecided, answer
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.ranking import ranking_of, rankings
from trackbench.report.findings.ranking_table import ranking_tables
from trackbench.report.html.report_page import write_report
from trackbench.report.plotting import file_formats
from trackbench.report.suite.problem_scores import _ratio_to_best
from trackbench.report.suite.score_words import word_of_score
from trackbench.report.suite.scores import BEST, Ratio
from trackbench.statistics.comparison import Sample
from trackbench.statistics.significance_rules import BETTER, WORSE

STEPS = 120
FAST, SLOW = 0.08, 0.05
CONFIG = """
name: two
seed: 1
scenario:
  kind: tracking
  target: {kind: measured, measurements: m.csv, truth: truth.csv, RUNS}
  sensor: {kind: position, sigma: 1}
  start: {kind: one-scan, sigma_velocity: 10}
  assume: {motion: {kind: cwna, q: 1}}
GRID
filters:
  KF: {kind: kf}
  Stiff: {kind: kf, assume: {motion: {kind: cwna, q: 1e-9}}}
  Lost: {kind: prior-mean}
tables:
  errors: {kind: metrics, columns: {RMSE: rms(rmse_position), ANEES: anees}}
figures:
  track: {kind: track, filters: [Stiff, Lost]}
"""


def ran(
    folder: Path, runs: str = "axes: 2", grid: str = "", truth_names: str = "px,py,vx,vy"
) -> Any:
    """Run the config on two circles of different speed; return its results."""
    rng = np.random.default_rng(2)
    lines, truth = ["run,time,x,y"], [f"run,time,{truth_names}"]
    for name, turn in (("a", FAST), ("b", SLOW)):
        for k in range(STEPS):
            x, y = 100 * np.cos(turn * k), 100 * np.sin(turn * k)
            dx, dy = rng.normal(size=2)
            lines.append(f"{name},{k},{x + dx:.4f},{y + dy:.4f}")
            truth.append(f"{name},{k},{x:.4f},{y:.4f},{-turn * y:.4f},{turn * x:.4f}")
    (folder / "m.csv").write_text("\n".join(lines) + "\n")
    (folder / "truth.csv").write_text("\n".join(truth) + "\n")
    text = CONFIG.replace("RUNS", runs).replace("GRID", grid)
    (folder / "two.yaml").write_text(text)
    out = folder / "out"
    return api.run(folder / "two.yaml", out=out, engine="serial", quiet=True, formats=()).results


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return ran(tmp_path_factory.mktemp("one"), "runs: [b]")


def test_a_diverged_run_is_named_where_no_run_is_lost(one: Any) -> None:
    (table,) = ranking_tables(one)
    assert not table.title.endswith("no lost runs")
    (note,) = [note for note in table.notes if note.startswith("Diverged: ")]
    assert "Stiff in 1 of 1 run" in note
    assert "KF in" not in note


def test_one_recording_says_why_an_error_has_no_interval(one: Any, tmp_path: Path) -> None:
    notes = [note for note in ranking_tables(one)[0].notes if note.startswith("One recording: ")]
    assert len(notes) == 1
    assert "own error has no ±, as it depends on the path" in notes[0]
    two = ran(tmp_path)
    assert not any(note.startswith("One rec") for note in ranking_tables(two)[0].notes)


def test_what_is_undecided_is_said_once_with_names_and_a_way(one: Any) -> None:
    """The recording is described, with those far off as far off, and nothing is called better."""
    text = " ".join(answer(one))
    assert text.startswith(
        "On this recording KF has the lowest position RMSE. Stiff and Lost are far"
    )
    (ranking,) = rankings(one)
    ratios = [
        candidate.overall.value / ranking.order[0].overall.value for candidate in ranking.order
    ]
    assert f"far off, at {ratios[1]:.3g} and {ratios[2]:.3g} times its error." in text
    assert text.count("and no test compares it with Stiff and Lost: the autocorrelation") == 1
    assert "better" not in text
    assert text.count("autocorrelation of neighboring steps may be 0.97 or more") == 1
    assert (
        "5 recordings as runs of one experiment may decide, or the log score: filters are ranked"
        in text
    )
    (table,) = ranking_tables(one)
    (note,) = [note for note in table.notes if note.startswith("untested: ")]
    assert "has no standard error (the autocorrelation of neighboring steps may be" in note


def test_recordings_of_a_grid_are_judged_alone(tmp_path: Path) -> None:
    note = "Each recording is judged alone, by its steps: no test is over all of them."
    for grid in (
        "scenario.target.runs: [[a], [b]]",
        "scenario.target.runs & scenario.sensor.sigma: [[[a], 1], [[b], 1]]",
    ):
        results = ran(tmp_path, grid=f"grid: {{{grid}}}")
        assert note in ranking_tables(results)[0].notes


def test_recordings_with_inputs_are_not_runs_of_one_experiment() -> None:
    """Runs with inputs of their own exclude each other, so that more recordings decide nothing."""
    text = described("rmse_position", has_inputs=True, A=1.0, B=30.0)
    assert "recordings as runs" not in text
    assert text.endswith(
        "The log score may decide: filters are ranked by the first column of the first table. A grid "
        "over recordings judges each alone."
    )


def described(metric: str, *, has_inputs: bool = False, **numbers: float) -> str:
    """Sentences on one recording of filters with these numbers, whose steps are alike for long."""
    steps = np.cumsum(np.random.default_rng(1).normal(size=400))
    steps += 10.0 - steps.min()
    candidates = []
    for place, (label, number) in enumerate(numbers.items()):
        if metric.startswith("rmse"):
            of_steps = (
                number**2 * (steps + place * steps[::-1]) / (steps + place * steps[::-1]).mean()
            )
            sample = Sample.from_values(np.array([number]), "rms", of_steps)
        else:
            of_steps = number + 0.01 * (place + 1) * (steps - steps.mean())
            sample = Sample.from_values(np.array([number]), "mean", of_steps)
        candidates.append(Candidate(label, {}, np.zeros(1), sample))
    ranking = ranking_of(candidates, metric)
    return _explain_undecided(ranking, is_recorded=True, has_inputs=has_inputs)


def test_the_first_of_a_suite_is_the_best_if_another_misses_steps(rng: np.random.Generator) -> None:
    """The ranking then has copies of all filters, over the steps that they have in common."""
    steps = 1.0 + 0.1 * rng.standard_normal(400)
    late = np.where(np.arange(400) < 3, np.nan, steps + 0.5)
    candidates = []
    for label, of_steps in (("KF", steps), ("Late", late)):
        sample = Sample.from_values(np.array([np.nanmean(of_steps)]), "mean", of_steps)
        candidates.append(Candidate(label, {}, np.zeros(1), sample))
    ranking = ranking_of(candidates, "rmse_position")
    assert ranking.order[0] is not candidates[0]
    assert [word_of_score(ranking, candidate) for candidate in candidates] == [BEST, WORSE]
    assert _ratio_to_best(ranking, candidates[0]) == Ratio(value=1.0, low=1.0, high=1.0)


def test_a_filter_that_is_better_than_the_first_on_common_runs_is_not_called_worse(
    rng: np.random.Generator,
) -> None:
    """KF has the lower error of all its runs, since it lost the two that were hard for EKF."""
    errors = 1.0 + 0.1 * rng.standard_normal(400)
    lost = np.zeros(400)
    lost[:2] = 1.0
    of_kf = np.where(lost, np.nan, errors)
    of_ekf = np.where(lost, 100.0, 0.98 * errors)
    candidates = [
        Candidate("KF", {}, lost, Sample.from_values(of_kf, "mean")),
        Candidate("EKF", {}, np.zeros(400), Sample.from_values(of_ekf, "mean")),
    ]
    ranking = ranking_of(candidates, "rmse_position")
    assert ranking.order[0].name == "KF"
    assert [word_of_score(ranking, candidate) for candidate in candidates] == [BEST, BETTER]


def test_filters_are_near_the_best_farther_off_or_far_off() -> None:
    text = described("rmse_position", IMM=5.0, KF=5.04, UKF=9.0, EKF=21.0, Gated=997.7, RPF=1341.0)
    assert text.startswith(
        "On this recording IMM has the lowest position RMSE. KF and UKF are within a factor of 1.8 of "
        "it; EKF is farther off, at 4.2 times its error; Gated and RPF are far off, at 200 and 268 "
        "times its error. One recording cannot decide how it would be on another, and no test "
    )
    assert "KF is within 1 % of it." in described("rmse_position", IMM=5.0, KF=5.04)
    # As the table has it, 1.02 x, not rounded up.
    assert "KF is within a factor of 1.02 of it" in described("rmse_position", IMM=5.0, KF=5.12)
    text = described("log_score", IMM=2.0, KF=1.8, UKF=0.5, RPF=-9.0)
    assert "IMM has the highest log score. KF is within 0.2 nats of it; " in text
    assert "UKF is farther off, 1.5 nats below; RPF is far off, 11 nats below." in text


def test_an_untested_pair_has_a_dash_for_its_interval(one: Any, tmp_path: Path) -> None:
    page = write_report(one, path=tmp_path / "report.html").read_text()
    assert "<td>untested</td>" in page
    assert "– to –" not in page


def test_two_recordings_are_told_of_the_grid(tmp_path: Path) -> None:
    results = ran(tmp_path)
    (sentence,) = [line for line in answer(results) if "cannot decide" in line]
    assert "`grid: {scenario.target.runs: [[NAME], [NAME]]}`" in sentence
    # Runs of other paths are not drawn over the truth of the first one.
    spec = results.parts("figures")["track"]
    figure = spec.draw(results)
    for ax in figure.axes:
        tracks = [line for line in ax.lines if len(line.get_xdata()) > 10]
        assert len(tracks) == 3  # measurements, truth and one estimate
    assert spec.default_caption(results).startswith("The target in the plane in the first run,")
    file_formats.close(figure)


def test_a_grid_names_its_errors_and_the_point_that_is_drawn(tmp_path: Path) -> None:
    results = ran(tmp_path, grid="grid: {scenario.target.runs: [[b], [a]]}")
    table, _ = ranking_tables(results, numbers=True)
    assert table.heads[2] == "Position RMSE (m)"
    low, high = (float(word) for word in table.rows[0][2].text.split(" to "))
    assert 0.0 < low <= high < 3.0
    spec = results.parts("figures")["track"]
    figure = spec.draw(results)
    assert "runs = b" in figure.get_suptitle()
    assert "runs = b" in spec.default_caption(results)
    # A panel for each filter that is named, and none for the best one.
    assert [ax.get_title() for ax in figure.axes] == ["Stiff", "Lost"]
    file_formats.close(figure)


def test_the_truth_lies_below_the_estimates_of_one_run(one: Any) -> None:
    figure = Track(filters=("KF",)).draw(one)
    (ax,) = figure.axes
    lines = {line.get_label(): line for line in ax.lines if len(line.get_xdata()) > 10}
    truth = lines["Truth"]
    assert truth.get_marker() in ("", "None", None)
    others = [line for label, line in lines.items() if str(label).startswith("_")]
    assert all(truth.get_zorder() < line.get_zorder() for line in others)
    assert not same_color(truth.get_color(), "black")
    # The legend has the color of the filter.
    labels = {line.get_label(): line for line in ax.lines}
    assert same_color(labels["KF"].get_color(), others[0].get_color())
    file_formats.close(figure)


def test_an_empty_anees_says_why(tmp_path: Path, one: Any) -> None:
    assert not any("ANEES" in note for note in one.tables["errors"].notes)
    results = ran(tmp_path, "runs: [b]", truth_names="px,py,speed_x,speed_y")
    (note,) = [note for note in results.tables["errors"].notes if "ANEES" in note]
    assert (
        "is empty, as the truth has no velocity at any scored step, and it is of the whole" in note
    )
    assert "`score: {marginals: [position]}` adds anees_position" in note


def test_an_empty_anees_of_a_simulation_names_the_covariance(tmp_path: Path) -> None:
    """The filter is exact from the start: its covariance is zero at every step."""
    (tmp_path / "c.yaml").write_text(
        "name: c\nruns: 3\nscenario:\n  kind: tracking\n  last: 4\n  target: {kind: driven, motion: "
        "{kind: cwna, q: 0}, launch: {x: 9, vx: 1}}\n  sensor: {kind: position, sigma: 2}\n"
        "  start: {kind: gaussian, sigma: [0, 0, 0, 0]}\nfilters: {KF: {kind: kf}}\n"
        "tables: {t: {kind: metrics, columns: {A: anees, E: rms(rmse_position)}}}\n"
    )
    report = api.run(
        tmp_path / "c.yaml", engine="serial", quiet=True, out=tmp_path / "o", formats=()
    )
    (note,) = [n for n in report.results.tables["t"].notes if n.startswith("A is empty")]
    assert "needs a covariance of full rank" in note


def test_a_held_out_score_names_its_key(tmp_path: Path) -> None:
    from trackbench.errors import UserError

    (tmp_path / "m.csv").write_text("time,x,y\n" + "".join(f"{k},{k},0\n" for k in range(9)))
    text = CONFIG.replace(", truth: truth.csv, RUNS", "").replace("GRID\n", "")
    text = text.replace("rms(rmse_position)", "mean(held_log_score)").partition("figures:")[0]
    (tmp_path / "m.yaml").write_text(text)
    with pytest.raises(UserError, match=r"no metric here; the key `hold_out` adds it"):
        api.run(tmp_path / "m.yaml", quiet=True)


def test_an_infinite_anees_is_not_an_empty_one(tmp_path: Path) -> None:
    """Two members leave a state of four components without spread in three directions."""
    scenario = {
        "kind": "tracking",
        "last": 10,
        "target": {"kind": "driven", "motion": {"kind": "cwna", "q": 1.0}},
        "sensor": {"kind": "position", "sigma": 1.0},
        "start": {"kind": "two-scan"},
    }
    table = {"kind": "metrics", "columns": {"ANEES": "anees"}}
    config = {
        "name": "two",
        "seed": 1,
        "runs": 2,
        "scenario": scenario,
        "filters": {"EnKF": {"kind": "enkf", "N": 2}},
        "tables": {"errors": table},
        "figures": {},
    }
    results = api.run(config, out=tmp_path / "out", formats=(), quiet=True).results
    (value,) = results.summary.query("metric == 'anees'").value
    assert np.isinf(value)
    assert not any("is empty" in note for note in results.tables["errors"].notes)
