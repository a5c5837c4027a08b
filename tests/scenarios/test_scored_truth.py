"""Scored steps without a truth: errors that no step measures stop a run, and are never equal."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.commands import trackbench
from trackbench import api
from trackbench.config.load import load
from trackbench.errors import UserError
from trackbench.report.findings.ranking import rankings
from trackbench.report.html.report_page import write_report

STEPS = 160
CONFIG = """
name: half
seed: 1
scenario:
  kind: tracking
  target: {kind: measured, measurements: m.csv, truth: truth.csv}
  sensor: {kind: position, sigma: 1}
  start: {kind: one-scan, sigma_velocity: 10}
  assume: {motion: {kind: cwna, q: 1}}
  score: {train: 0.5}
filters:
  KF: {kind: kf}
  Stiff: {kind: kf, assume: {motion: {kind: cwna, q: 1e-3}}}
tables:
  errors: {kind: metrics, columns: {COLUMNS}}
"""
ERRORS = "RMSE: rms(rmse_position)"
PREDICTIONS = "Log score: mean(log_score)"


def written(
    folder: Path,
    columns: str = ERRORS,
    truth: dict[str, range] | None = None,
    names: str = "px,py,vx,vy",
) -> Path:
    """Write a config with runs on a circle, and the truth of some of their steps."""
    truth = {"a": range(STEPS // 2)} if truth is None else truth
    rng = np.random.default_rng(3)
    measured = ["run,time,x,y"]
    true = [f"run,time,{names}"]
    for name, steps in truth.items():
        for k in range(STEPS):
            turn = 0.05 * k
            x = 100.0 * np.cos(turn)
            y = 100.0 * np.sin(turn)
            dx, dy = rng.normal(size=2)
            measured.append(f"{name},{k},{x + dx:.4f},{y + dy:.4f}")
            if k in steps:
                state = [x, y, -0.05 * y, 0.05 * x][: names.count(",") + 1]
                true.append(",".join([name, str(k), *(f"{value:.4f}" for value in state)]))
    (folder / "m.csv").write_text("\n".join(measured) + "\n")
    (folder / "truth.csv").write_text("\n".join(true) + "\n")
    (folder / "half.yaml").write_text(CONFIG.replace("COLUMNS", columns))
    return folder / "half.yaml"


def mistakes(config: Path, *words: str) -> list[str]:
    with pytest.raises(UserError) as caught:
        load(config, overrides=words)
    return [str(problem).removeprefix(f"{config.parent}/") for problem in caught.value.problems]


def run(config: Path, *words: str) -> Any:
    options = api.Options(engine="serial", quiet=True, formats=(), set=words)
    return api.run(config, options, out=config.parent / "out").results


NO_TRUTH = (
    "no scored step has a truth: it is known from 0 to 79 s after the first step, and scored are 80 to "
    "159 s; write a share below 0.49, or ask for predictions alone, such as mean(log_score)"
)


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_truth_of_the_trained_part_alone_stops_before_anything_runs(
    tmp_path: Path, command: str
) -> None:
    config = written(tmp_path)
    out = () if command == "check" else ("--out", tmp_path / "out")
    result = trackbench(command, config, *out)
    assert result.returncode == 2
    assert result.stderr == f"{config}:10:18: scenario.score.train: {NO_TRUTH}\n"
    assert not (tmp_path / "out").exists()


def test_a_default_table_asks_for_errors(tmp_path: Path) -> None:
    config = written(tmp_path)
    config.write_text(config.read_text().partition("tables:")[0])
    assert mistakes(config) == [f"half.yaml:10:18: scenario.score.train: {NO_TRUTH}"]


def test_the_way_on_fits_the_key_that_chooses_the_steps(tmp_path: Path) -> None:
    config = written(tmp_path)
    (line,) = mistakes(config, "scenario.score={steps: [100, null]}")
    assert "scenario.score.steps: no scored step has a truth" in line
    assert "score steps within 0 to 79, or ask for predictions" in line
    # The scenario ends before the truth begins.
    config = written(tmp_path, truth={"a": range(100, STEPS)})
    (line,) = mistakes(config, "scenario.score={}", "scenario.last=60")
    assert "scenario.target.truth: no scored step has a truth: 0 to 60 s after the" in line


def test_a_share_that_leaves_a_truth_is_good(tmp_path: Path) -> None:
    load(written(tmp_path), overrides=["scenario.score.train=0.48"])


def test_predictions_alone_run_with_a_note_and_no_pair_of_errors(tmp_path: Path) -> None:
    config = written(tmp_path, PREDICTIONS)
    (note,) = load(config).points[0].scenario.cautions
    assert note.startswith("no scored step has a truth: it is known from 0 to 79 s")
    results = run(config)
    with (results.folder / "paired.csv").open() as file:
        metrics = {row["metric"] for row in csv.DictReader(file)}
    assert "log_score" in metrics
    assert not {"rmse_position", "rmse_velocity", "rms(rmse_position)"} & metrics
    (ranking,) = rankings(results)
    assert ranking.metric.metric == "log_score"
    write_report(results)
    page = (results.folder / "report.html").read_text()
    assert ">equal<" not in page


def test_without_tables_of_metrics_the_ranking_is_by_a_metric_that_is_measured(
    tmp_path: Path,
) -> None:
    config = written(tmp_path)
    results = run(config, "tables={a: {kind: innovations}}")
    (ranking,) = rankings(results)
    assert ranking.metric.metric == "log_score"


def test_runs_whose_truth_is_not_scored_are_noted(tmp_path: Path) -> None:
    config = written(tmp_path, truth={"a": range(STEPS), "b": range(60), "c": range(60)})
    (note,) = load(config).points[0].scenario.cautions
    assert note == (
        "2 of 3 runs have a truth, but at no scored step (b, c): errors are those of the others"
    )


def test_a_window_without_a_truth_is_named_where_it_is_asked_for(tmp_path: Path) -> None:
    config = written(tmp_path, "RMSE: rms(rmse_position), Late: 'rms(rmse_position[late])'")
    score = "scenario.score={windows: [{name: late, first: 100}]}"
    (line,) = mistakes(config, score)
    assert "tables.errors.columns.Late: 'rmse_position[late]' is not measured: " in line
    assert line.endswith("no step of the window has a truth; leave it out")


def test_a_column_without_the_truth_that_it_needs_says_so(tmp_path: Path) -> None:
    columns = "RMSE: rms(rmse_position), Speed: rms(rmse_velocity)"
    for names, notes in (("px,py", 1), ("px,py,vx,vy", 0)):
        results = run(written(tmp_path, columns, truth={"a": range(STEPS)}, names=names))
        text = "Speed is empty, as the truth has no velocity at any scored step."
        assert results.tables["errors"].notes.count(text) == notes


TUNED = ("tune={KF: {assume.motion.q: 'log:1e-2..10'}}", "tuning.evaluations=4")


def test_tuning_takes_the_log_score_if_training_or_results_have_no_truth(tmp_path: Path) -> None:
    for columns, steps in ((PREDICTIONS, range(80)), (ERRORS, range(80, STEPS))):
        config = written(tmp_path, columns, truth={"a": steps})
        assert load(config, overrides=TUNED).settings.tuning.metric == "log_score"
    config = written(tmp_path, truth={"a": range(STEPS)})
    assert load(config, overrides=TUNED).settings.tuning.metric == "rms(rmse_position)"


def test_a_metric_of_tuning_needs_a_truth_in_training_and_in_the_results(tmp_path: Path) -> None:
    words = (*TUNED, "tuning.metric=rms(rmse_position)")
    config = written(tmp_path, truth={"a": range(80, STEPS)})
    (line,) = mistakes(config, *words)
    assert "tuning.metric: no step of the training has a truth; tune by log_score" in line
    config = written(tmp_path, PREDICTIONS)
    (line,) = mistakes(config, *words)
    assert "scenario.score.train: no scored step has a truth" in line
