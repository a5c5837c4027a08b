"""Two rules: filters differ at 1 % over all pairs, claims of papers beyond five standard errors.

Rankings, marks, lists of pairs, captions and `compare` give one answer on the same two filters.
"""

import ast
import csv
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import trackbench
from tests.report.test_findings import RATIO, M, folder, ranked
from tests.simulated import filters_differ
from trackbench import api
from trackbench.config.published_numbers_and_claims import Claim
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.figures.heat_map import HeatMap
from trackbench.report.findings.best_filter_sentences import answer
from trackbench.report.findings.ranking import rankings
from trackbench.report.pairs_of_filters import pairs_of
from trackbench.report.tables.claims import ClaimRow, Claims
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claim_verdicts import judge
from trackbench.statistics.compare_all_pairs import compare_all
from trackbench.statistics.comparison import Sample


@pytest.mark.parametrize("statistic", ["mean", "rms"])
def test_two_filters_have_one_answer_on_every_screen(tmp_path: Path, rng, statistic: str) -> None:
    columns = {"Error": f"{statistic}(rmse_position)"}
    tables = {"t": {"kind": "metrics", "columns": columns}}
    expression = measure(f"{statistic}(rmse_position)")
    verdicts = {}
    for z in (1.0, 2.3, 3.0, 4.9, 5.3, 8.0):
        apart = rng.standard_normal(M)
        apart = (apart - apart.mean()) / apart.std(ddof=1) + z / M**0.5
        A = 50.0 + rng.random(M)
        results = folder(tmp_path, {"A": A, "B": A + apart}, tables=tables, verdict_seeds=4)
        (found,) = rankings(results)
        significant = bool(found.worse)
        # The first table, the marks, the list of pairs and the caption of a heat-map.
        assert ranked(results)["B"][RATIO].endswith("n.s.") != significant
        assert results.tables["t"].best == {(0, 0), *([] if significant else [(1, 0)])}
        ((_, (pair,)),) = results.pairs
        assert pair.word == ("better" if significant else "no significant difference")
        caption = HeatMap(metric=expression).default_caption(results)
        alike = "0 of 1 pair do" if significant else "1 of 1 pair does"
        assert caption.endswith(f"{alike} not differ significantly (at 1 % over all pairs).")
        # A claim needs more, and tells that the filters differ.
        claim = Claim(paper="p", claim="c", left="A", expression=expression, right="B")
        judged = judge(claim, Evaluator(results, {}))
        noted = "significant at 1 %, z +" in judged.note
        assert noted == (significant and judged.verdict.word == "inconclusive")
        verdicts[z] = significant, judged.verdict.word
        if statistic == "mean":
            (pair,) = (pair.comparison for pair in (pair,))
            p = stats.ttest_1samp(apart, 0.0).pvalue
            assert np.log(pair.p) == pytest.approx(np.log(p), rel=0.1)
            assert pair.difference.interval() == pytest.approx(measured_interval(results))
            row = ClaimRow(less="A", than="B", metric=measure("rmse_position"))
            (note,) = Claims(claims={"c": row}).table(results).notes
            assert f"{judged.verdict.word} at" in note
    assert verdicts[1.0] == verdicts[2.3] == (False, "inconclusive")
    assert verdicts[3.0] == (True, "inconclusive")
    assert verdicts[8.0] == (True, "holds")


def measured_interval(results: Results) -> tuple[float, float]:
    mean = measure("mean(rmse_position)")
    return Evaluator(results, {}).difference(mean.of("A"), mean.of("B")).interval()


def test_the_family_is_all_pairs_by_holm(rng) -> None:
    """By hand: p of each pair, sorted, times 6, 5, 4, ..., never decreasing."""
    x = {
        label: rng.standard_normal(40) + off for label, off in (("A", 0.0), ("B", 0.6), ("C", 1.0))
    }
    x["D"] = rng.standard_normal(40)
    found = compare_all({label: Sample(values) for label, values in x.items()})
    p = {(a, b): 2.0 * stats.norm.sf(abs(found[a, b].z)) for a, b in combinations("ABCD", 2)}
    least = 0.0
    for left, pair in zip(range(6, 0, -1), sorted(p, key=p.__getitem__), strict=True):
        least = max(least, min(1.0, left * p[pair]))
        assert found[pair].p == pytest.approx(least, rel=1e-9)
        assert found[pair].tests == 6


@pytest.mark.parametrize(
    ("law", "M", "most"),
    [
        *(("normal", 5, 0.013), ("normal", 50, 0.011), ("lognormal", 5, 0.06)),
        *(("HDEPF", 200, 0.032), ("rare", 50, 0.045), ("rare, better", 50, 0.045)),
    ],
)
def test_filters_without_a_difference_are_called_different_about_once_in_a_hundred(
    law: str, M: int, most: float
) -> None:
    """The levels that docs/statistics.md prints; 4 standard errors of 20 000 repetitions are added."""
    repetitions, rng = 20_000, np.random.default_rng([22, M])
    (false, *power) = filters_differ(law, M, repetitions, rng)
    assert sum(false) < most + 4.0 * (most / repetitions) ** 0.5
    assert power[-1][0] > 0.4  # of a mean of two standard deviations
    assert [up for up, _ in power] == sorted(up for up, _ in power)


@pytest.mark.parametrize(
    ("law", "M", "worse", "better"), [("lognormal", 20, 0.97, 0.35), ("rare", 50, 1.0, 0.37)]
)
def test_a_difference_is_found_less_often_if_the_better_filter_has_the_far_runs(
    law: str, M: int, worse: float, better: float
) -> None:
    """The shares of docs/statistics.md for a mean of one standard deviation; 20 000 repetitions."""
    for name, share in ((law, worse), (f"{law}, better", better)):
        found = filters_differ(name, M, 20_000, np.random.default_rng([23, M]))
        assert found[2][0] == pytest.approx(share, abs=0.02)


def test_fewer_than_five_runs_do_not_decide(tmp_path: Path) -> None:
    A = np.array([1.0, 1.1, 0.9, 1.05, 0.95])
    errors = {"A": A, "B": A + 10.0 + 0.01 * A**2}
    for runs, decided in ((5, True), (4, False), (2, False)):
        results = folder(tmp_path, {label: x[:runs] for label, x in errors.items()})
        assert ("(" in ranked(results)["B"][RATIO]) == decided
        few = f"{runs} runs cannot decide which filter is best; at least 5 are needed."
        assert answer(results) == [few] * (not decided)
        assert results.tables["t"].best == ({(0, 0)} if decided else set())


def test_no_value_is_marked_that_is_larger_than_an_unmarked_one(tmp_path: Path, rng) -> None:
    """C is further from A than B is, but its runs vary so much that nothing shows it."""
    A = 10.0 + rng.standard_normal(M)
    errors = {"A": A, "B": A + 1.0 + 0.1 * rng.standard_normal(M)}
    errors["C"] = A + 2.0 + 60.0 * (rng.random(M) - 0.5)
    errors["C"] += 12.5 - errors["C"].mean()
    results = folder(tmp_path, errors)
    assert results.tables["t"].best == {(0, 0)}
    rows = ranked(results)
    assert rows["B"][RATIO].startswith("1.1")
    assert [label for label, row in rows.items() if row[RATIO].endswith("n.s.")] == ["C"]


@pytest.mark.parametrize(("metric", "word"), [("rmse", "worse"), ("log_score", "better")])
def test_the_word_of_a_pair_knows_which_side_is_better(rng, metric: str, word: str) -> None:
    B = rng.random(M)
    worse = B + 1.0 + 0.1 * rng.random(M)
    for a, b, expected in (
        (worse, B, word),
        (B[:1] + 1.0, B[:1], "untested"),
        (B, B.copy(), "equal"),
    ):
        (pair,) = pairs_of(metric, {"A": Sample(a), "B": Sample(b)})
        assert pair.word == expected


PACKAGE = Path(trackbench.__file__).parent
CLAIMS = """paper,claim,experiment,left,expression,relation,factor,right,tolerance
p,position,car-track,"KF, smoothed",rms(rmse_position),<,1,KF,
p,far,car-track,"KF, smoothed",rms(rmse_position),<,2,KF,
p,opposite,car-track,KF,rms(rmse_position),<,0.5,"KF, smoothed",
p,velocity,car-track,"KF, smoothed",rms(rmse_velocity),<,1,KF,
p,bound,car-track,KF,rms(rmse_position),<,1,,
p,equal,car-track,KF,rms(rmse_position),~,1.6,"KF, smoothed",0.05
"""


def test_claims_on_a_recording_are_decided_by_its_steps(tmp_path: Path) -> None:
    """The smoother's position error is lower than twice that of the filter beyond three errors."""
    (tmp_path / "claims.csv").write_text(CLAIMS)
    published = f"published=[{tmp_path / 'claims.csv'}]"
    words = [published, "figures={}", "key_figure=null"]
    options = api.Options(engine="serial", quiet=True, formats=(), times=False, set=words)
    report = api.run("car-track", options, out=tmp_path / "out")
    found = {row.claim.claim: row.verdict for row in report.comparison.claims}
    assert [verdict.word for verdict in found.values()] == [
        *("inconclusive", "holds", "fails", "inconclusive", "holds", "inconclusive"),
    ]
    ((_, two),) = report.results.pairs
    words = {pair.metric: pair.word for pair in two}
    assert words["rmse_position"] == "worse"
    page = (report.folder / "report.html").read_text()
    assert "95 % interval" in page
    assert ">worse</td>" in page
    with (report.folder / "paired.csv").open() as file:
        pairs = {row["metric"]: float(row["z"]) for row in csv.DictReader(file)}
    assert found["position"].z == pytest.approx(pairs["rmse_position"], rel=1e-9)
    assert found["velocity"].z == pytest.approx(pairs["rmse_velocity"], rel=1e-9)
    assert any("2.64 standard errors, and 3 decide" in note for note in report.notes)
    caption = HeatMap(metric=measure("mean(rmse_position)")).default_caption(report.results)
    assert caption.endswith("0 of 1 pair do not differ significantly (at 1 % over all pairs).")
    (ranking,) = rankings(report.results)
    assert [rival.filter.label for rival in ranking.worse] == ["KF"]
    (difference,) = (rival.difference for rival in ranking.worse)
    low, high = difference.interval()
    assert 0.0 < low < difference.value < high
    assert high - low > 2 * 1.96 * difference.stderr  # by tails that are heavier than normal
    assert not np.isnan(difference.stderr)


def test_a_short_recording_decides_nothing_and_names_its_steps(tmp_path: Path) -> None:
    """No filter is marked, and no number of runs is asked for: there is one recording."""
    words = ["scenario.last=40", "figures={}", "key_figure=null", "published=[]"]
    options = api.Options(engine="serial", quiet=True, formats=(), times=False, set=words)
    results = api.run("car-track", options, out=tmp_path / "out").results
    (sentence,) = answer(results)
    assert sentence.endswith("KF: 40 judged steps, and 50 are needed.")
    assert sentence.startswith("On this recording ")
    assert not any(table.best for table in results.tables.values())


OTHER_QUESTIONS = {"report/uniformity_of_ranks.py", "report/figures/critical_difference.py"}
"""Tests of uniformity and of mean ranks: their level is a key of the table or figure."""
JUDGED = {"z", "p", "p_holm", "z_worse", "z_score", "stderr"}
THRESHOLDS = {"LEVEL", "DECIDED", "SURE", "NOT_CHANCE", "LOSSES_LEVEL"}


def _compared_names(node: ast.Compare) -> set[str]:
    found = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Name | ast.Attribute):
            found.add(part.id if isinstance(part, ast.Name) else part.attr)
    return found


def _has_threshold(node: ast.Compare) -> bool:
    """A number other than zero; those from 20 on are of printed digits."""
    numbers = [part.value for part in ast.walk(node) if isinstance(part, ast.Constant)]
    return any(isinstance(x, int | float) and 0.0 < x < 20.0 for x in numbers)


@pytest.mark.parametrize("room", ["report", "commands", "cli", "tuning", "results"])
def test_thresholds_of_significance_stand_in_one_module(room: str) -> None:
    for path in sorted((PACKAGE / room).rglob("*.py")):
        where = str(path.relative_to(PACKAGE))
        tree = ast.parse(path.read_text())
        imported = {
            a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names
        }
        if where not in OTHER_QUESTIONS:
            assert not imported & {"holm", "two_sided", "ndtr", "ndtri"}, where
        for node in ast.walk(tree):
            if isinstance(node, ast.Compare):
                names = _compared_names(node)
                text = f"{where}:{node.lineno}: {ast.unparse(node)}"
                assert not names & THRESHOLDS, text
                assert not (names & JUDGED and _has_threshold(node)), text
