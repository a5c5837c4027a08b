"""Runs' shares of averages over time stand in per_run.csv where an experiment asks for them."""

import numpy as np
import pytest
import yaml

from tests.papers import merwe_text
from trackbench import api
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.influential_runs import without_each_batch
from trackbench.statistics.sample_statistics import mean
from trackbench.verify.verify_folder import verify

CONFIG = """
name: shares
runs: 40
block: 16
scenario: MERWE
filters: {PF: {kind: pf, N: 20}, UKF: {kind: ukf}}
""".replace("MERWE", merwe_text(T=10))
TABLE = """
tables:
  t:
    kind: metrics
    columns: {A: time-mean(rmse), B: "ratio(time-mean(rmse), UKF)", C: rmse@last, D: anees@3, E: std@4}
"""


def run(folder, text):
    (folder / "c.yaml").write_text(text)
    api.run(folder / "c.yaml", out=folder / "out", workers=1, quiet=True, formats=())
    return Results(folder / "out")


def metrics(results):
    return {metric for _, metric in results.runs({})}


def row(results, metric):
    frame = results.summary
    return frame[(frame["filter"] == "PF") & (frame["metric"] == metric)].iloc[0]


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return run(tmp_path_factory.mktemp("shares"), CONFIG + TABLE)


def test_they_are_there_only_if_something_asks_for_them(results, tmp_path):
    plain = run(tmp_path, CONFIG)
    asked = {"time-mean(rmse)", "rmse@last", "anees@3", "std@4"}
    assert metrics(results) - metrics(plain) == asked
    a, b = (row(r, "time-mean(rmse)") for r in (results, plain))
    assert a["value"] == b["value"]
    assert a["stderr"] < b["stderr"]  # an upper bound, without them
    assert a["stderr"] == pytest.approx(mean(results.runs({})["PF", "time-mean(rmse)"]).stderr)


def test_they_average_to_the_value_of_every_step(results):
    steps, e = results.per_step, Evaluator(results, {})
    of_steps = [("rmse@last", "rmse", 10), ("anees@3", "anees", 3), ("std@4", "std", 4)]
    for expression, metric, step in of_steps:
        here = steps[(steps["filter"] == "UKF") & (steps["metric"] == metric)]
        at = here[here["step"] == step].iloc[0]
        term = e.term(measure(expression).of("UKF"))
        assert term.value == pytest.approx(at["value"], rel=1e-4)
        if metric != "std":  # the steps' sums know no fourth moment
            assert term.stderr == pytest.approx(at["stderr"], rel=1e-4)
        assert term.has_influences


def test_without_the_last_batch_a_number_is_nearly_that_of_the_other_runs(results, tmp_path):
    """To first order in what the batch changes."""
    rest = run(tmp_path, CONFIG.replace("runs: 40", "runs: 30") + TABLE)
    for expression in ("time-mean(rmse)", "rmse@last", "std@4", "minus(time-mean(rmse), UKF)"):
        part = without_each_batch(Evaluator(results, {}).term(measure(expression).of("PF")), 4)[3]
        alone = Evaluator(rest, {}).term(measure(expression).of("PF"))
        assert part.has_influences
        assert part.value == pytest.approx(alone.value, abs=0.15 * alone.stderr)


def test_they_come_out_again(results):
    assert verify(results.folder, 40) == []
    assert verify(results.folder, 7) == []


def test_a_published_file_asks_for_them(tmp_path):
    claims = "paper,claim,experiment,left,expression,right\np,c,shares,PF,time-mean(rmse),UKF\n"
    (tmp_path / "claims.csv").write_text(claims)
    results = run(tmp_path, CONFIG + "published: [claims.csv]\n")
    assert "time-mean(rmse)" in metrics(results)
    assert np.isfinite(
        Evaluator(results, {})
        .difference(*[measure("time-mean(rmse)").of(f) for f in ("PF", "UKF")])
        .z()
    )


def test_a_metric_that_is_not_kept_has_none(tmp_path):
    text = yaml.safe_load(CONFIG + TABLE)
    text |= {"metrics": ["nees"], "tables": {}}
    assert "time-mean(rmse)" not in metrics(run(tmp_path, yaml.safe_dump(text)))
