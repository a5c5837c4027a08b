"""One rule: rankings, claims and tables of claims decide the same differences, of runs and of steps."""

import csv
from pathlib import Path

import numpy as np
import pytest

from tests.report.test_findings import M, folder
from trackbench import api
from trackbench.config.published import Claim
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.figures.heat_map import HeatMap
from trackbench.report.findings.ranking import rankings
from trackbench.report.paired import pairs_of
from trackbench.report.results import Results
from trackbench.report.tables.differences import ClaimRow, Claims
from trackbench.report.verdicts.claims import judge
from trackbench.statistics import rules


@pytest.mark.parametrize("statistic", ["mean", "rms"])
def test_a_claim_holds_where_the_ranking_says_so(tmp_path: Path, rng, statistic: str) -> None:
    columns = {"Error": f"{statistic}(rmse_position)"}
    tables = {"t": {"kind": "metrics", "columns": columns}}
    decided = set()
    for z in (1.0, 4.0, 4.9, 5.3, 8.0):
        apart = rng.standard_normal(M)
        apart = (apart - apart.mean()) / apart.std(ddof=1) + z / M**0.5
        A = 50.0 + rng.random(M)
        errors = {"A": A, "B": A + apart}
        results = folder(tmp_path, errors, tables=tables, verdict_seeds=4)
        (found,) = rankings(results)
        expression = measure(f"{statistic}(rmse_position)")
        claim = Claim(paper="p", claim="c", left="A", expression=expression, right="B")
        word = judge(claim, Evaluator(results, {})).verdict.word
        assert (word == "holds") == bool(found.worse)
        decided.add(word)
        if statistic == "mean":
            ((_, (pair,)),) = results.pairs
            assert pair.verdict == ("better" if found.worse else "no significant difference")
            assert pair.interval == pytest.approx(measured_interval(results))
            row = ClaimRow(less="A", than="B", metric=measure("rmse_position"))
            (note,) = Claims(claims={"c": row}).table(results).notes
            assert f"{word} at" in note
            caption = HeatMap(metric=expression).default_caption(results)
            assert caption.endswith(
                f"{int(not found.worse)} of 1 pair do not differ significantly (by "
                f"{rules.DECIDED:g} standard errors, and {rules.SURE:g} without any one batch of runs)."
            )
    assert decided == {"holds", "inconclusive"}


def measured_interval(results: Results) -> tuple[float, float]:
    mean = measure("mean(rmse_position)")
    return Evaluator(results, {}).difference(mean.of("A"), mean.of("B")).interval()


@pytest.mark.parametrize(("metric", "word"), [("rmse", "worse"), ("log_score", "better")])
def test_the_word_of_a_pair_knows_which_side_is_better(rng, metric: str, word: str) -> None:
    B = rng.random(M)
    (pair,) = pairs_of(metric, ["A", "B"], {"A": B + 1.0 + 0.1 * rng.random(M), "B": B}, batches=4)
    assert pair.verdict == word
    (pair,) = pairs_of(metric, ["A", "B"], {"A": B[:1] + 1.0, "B": B[:1]})
    assert pair.verdict == "untested"


CLAIMS = """paper,claim,experiment,left,expression,relation,factor,right,tolerance
p,position,car-track,"KF, smoothed",rms(rmse_position),<,1,KF,
p,opposite,car-track,KF,rms(rmse_position),<,1,"KF, smoothed",
p,velocity,car-track,"KF, smoothed",rms(rmse_velocity),<,1,KF,
p,bound,car-track,KF,rms(rmse_position),<,1,,
p,equal,car-track,KF,rms(rmse_position),~,1.6,"KF, smoothed",0.05
"""


def test_claims_on_a_recording_are_decided_by_its_steps(tmp_path: Path) -> None:
    """The smoother's position error is lower by more than three errors of the steps."""
    (tmp_path / "claims.csv").write_text(CLAIMS)
    published = f"published=[{tmp_path / 'claims.csv'}]"
    words = [published, "figures={}", "key_figure=null"]
    options = api.Options(engine="serial", quiet=True, formats=(), times=False, set=words)
    report = api.run("car-track", options, out=tmp_path / "out")
    found = {row.claim.claim: row.verdict for row in report.comparison.claims}
    assert [verdict.word for verdict in found.values()] == [
        *("holds", "fails", "inconclusive", "holds", "inconclusive"),
    ]
    ((_, two),) = report.results.pairs
    assert {pair.metric: pair.verdict for pair in two}["rmse_position"] == "worse"
    page = (report.folder / "report.html").read_text()
    assert "95 % interval" in page
    assert ">worse</td>" in page
    with (report.folder / "paired.csv").open() as file:
        pairs = {row["metric"]: float(row["z"]) for row in csv.DictReader(file)}
    assert found["position"].z == pytest.approx(pairs["rmse_position"], rel=1e-9)
    assert found["velocity"].z == pytest.approx(pairs["rmse_velocity"], rel=1e-9)
    assert any("2.51 standard errors, and 3 decide" in note for note in report.notes)
    caption = HeatMap(metric=measure("mean(rmse_position)")).default_caption(report.results)
    assert caption.endswith(
        f"0 of 1 pair do not differ significantly (by {rules.SURE:g} standard errors)."
    )
    (ranking,) = rankings(report.results)
    assert [c.label for c, _ in ranking.worse] == ["KF"]
    (difference,) = (d for _, d in ranking.worse)
    low, high = difference.interval()
    assert 0.0 < low < difference.value < high
    assert high - low > 2 * 1.96 * difference.stderr  # Student's t of few degrees of freedom
    assert not np.isnan(difference.stderr)
