"""Claims: which comparison counts, which losses, and how counts of verdicts are written."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.report.test_expressions import RUNS, Folder, table
from trackbench.config.published_numbers_and_claims import Claim
from trackbench.evaluation.metric_expression import measure
from trackbench.report.expressions import Evaluator
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.ranking import ranking_of
from trackbench.report.verdicts.claim_verdicts import judge
from trackbench.report.verdicts.verdict_counts import Bar, tallies
from trackbench.results.rows_and_columns import Columns
from trackbench.statistics import sample_statistics as st
from trackbench.statistics import share_of_runs
from trackbench.statistics.comparison import Sample
from trackbench.statistics.estimates import RunEstimate, Share
from trackbench.statistics.influential_runs import with_few_runs_changed
from trackbench.statistics.skewness_corrected_t_test import studentized
from trackbench.statistics.verdict_meanings import CLAIM_WORDS, NUMBER_WORDS
from trackbench.statistics.verdict_rules import Verdict

NONE = table("filter metric value stderr runs lost", [("-", "-", 0.0, 0.0, 1, 0)])
NO_TIMES = table("filter runs cpu_s_per_run stderr blocks", [("-", 1, 0.0, 0.0, "")])


@dataclass
class Steps(Folder):
    """A folder with the steps of per_step.csv, too."""

    per_step: Any = None


def measured(values: dict[tuple[str, str], np.ndarray], steps: Columns | None = None) -> Evaluator:
    rows = steps or table("filter metric step value stderr runs", [("-", "-", 0, 0.0, 0.0, 1)])
    return Evaluator(Steps(values, NONE, NO_TIMES, per_step=rows), {})


def claimed(expression: str, **keys: Any) -> Claim:
    return Claim(paper="p", claim="c", left="A", expression=measure(expression), **keys)


def codes(lost: int) -> np.ndarray:
    """One for so many runs that are lost: the code of those without a number."""
    return (np.arange(RUNS) < lost).astype(float)


@pytest.mark.parametrize(("of_b", "of_c", "word"), [
    (0, 20, "inconclusive"), (20, 0, "inconclusive"), (20, 20, "holds"), (16, 16, "holds"),
])  # fmt: skip
def test_a_better_filter_may_not_lose_more_than_any_of_the_others(of_b, of_c, word, rng):
    values = {}
    for label, level, lost in (("A", 1.0, 20), ("B", 2.0, of_b), ("C", 3.0, of_c)):
        values[label, "lost"] = codes(lost)
        errors = level + 0.1 * rng.standard_normal(RUNS)
        values[label, "rmse"] = np.where(codes(lost) > 0, np.nan, errors)
    found = judge(claimed("mean(rmse)", right="B;C"), measured(values))
    assert found.verdict.word == word
    told = [f"A loses 20 runs, {label} 0" for label, n in (("B", of_b), ("C", of_c)) if n == 0]
    assert [part for part in found.note.split("; ") if "loses" in part] == told


@pytest.mark.parametrize(("events", "word"), [(28, "holds"), (23, "inconclusive")])
def test_a_share_is_exact_so_that_three_standard_errors_show_it(events, word):
    """28 of 120 against 12 %: z is 3.39; 23 of 120: 2.15."""
    expressions = measured({("A", "beyond_10_sigma"): codes(events)})
    z = share_of_runs.share_z(events, RUNS, 0.12)
    assert (3.0 < z < 5.0) == (word == "holds")
    found = judge(claimed("mean(beyond_10_sigma)", relation=">", factor=0.12), expressions)
    assert (found.verdict.word, found.verdict.z) == (word, z)
    # A mean of the same size is not.
    values = {("A", "rmse"): codes(events)}
    found = judge(claimed("mean(rmse)", relation=">", factor=0.12), measured(values))
    assert found.verdict.word == "inconclusive"


def test_a_claim_at_many_steps_counts_those_that_hold_by_themselves(rng):
    values, levels = {}, {2: 0.5, 3: 0.96, 4: 0.7, 9: 3.0}
    for k, level in levels.items():
        common = rng.standard_normal(RUNS)
        values["A", f"rmse@{k}"] = level * np.abs(common + 0.1 * rng.standard_normal(RUNS))
        values["B", f"rmse@{k}"] = np.abs(common)
    values["B", "rmse@5"] = values["B", "rmse@4"]  # which A has not
    found = judge(claimed("rmse@1..8", right="B"), measured(values))
    assert found.verdict.word == "inconclusive"
    assert "at step 3; 2 of 3 comparisons hold by themselves" in found.note


def test_a_share_beside_an_error_or_of_no_run_is_normal():
    share = Share(0.1, 0.03, None, 100)
    plain = RunEstimate(0.1, 0.03, None, 100)
    for other in (0.01, 0.9):
        assert share.z(0.2, other) == plain.z(0.2, other)
        assert share.interval(other=other) == plain.interval(other=other)
    assert share.z(0.2) == share_of_runs.share_z(10, 100, 0.2)
    nothing = Share(np.nan, np.nan, None, 0)
    assert np.isnan(nothing.z(0.2))
    assert np.isnan(nothing.interval()).all()


def test_a_term_that_is_divided_has_the_error_divided():
    term = RunEstimate(3.0, 0.3, np.array([1.0, -1.0]), 2)
    found = term.scaled(1.5, factor=-2.0, divisor=4.0)
    assert (found.value, found.stderr) == (1.5, pytest.approx(0.15))
    assert found.influences.tolist() == [-0.5, 0.5]


def test_a_difference_of_variances_under_stress_is_that_of_its_influences(rng):
    """Its limits are those of the runs that were drawn."""
    common = rng.standard_normal(RUNS)
    x, y = 1.5 * common, common + 0.3 * rng.standard_normal(RUNS)
    values = {("A", "rmse"): x, ("B", "rmse"): y}
    term = measured(values).difference(*(measure("variance(rmse)").of(label) for label in "AB"))
    assert term.pair is not None
    influences = st.influence("variance", x) - st.influence("variance", y)
    assert len(with_few_runs_changed(term)) == 2
    less = np.delete(influences, np.argmax(np.abs(influences)))
    for found, made_by in zip(with_few_runs_changed(term)[:1], [less], strict=True):
        value = term.value + made_by.mean()
        assert found.z() == pytest.approx(studentized(value, made_by - made_by.mean()))


def test_parts_of_a_bar_have_the_order_of_the_words_and_their_verbs():
    def row(word, fragile=False):
        return SimpleNamespace(verdict=Verdict(word, 1.0, (), fragile))

    words = ["differs", "agrees", "agrees", "inconclusive"]
    rows = [row(word, word == "differs") for word in words] + [row("compatible")] * 2
    found = [(t.number, t.word, t.verb, t.fragile) for t in tallies(rows)]
    assert found == [
        (2, "agrees", "agree", 0),
        (2, "compatible", "compatible", 0),
        (1, "differs", "differs", 1),
        (1, "inconclusive", "inconclusive", 0),
    ]
    claims = [row("inconclusive"), row("fails"), *[row("holds", True)] * 3]
    bar = Bar("5 claims", tallies(claims))
    assert bar.words == "5 claims: 3 hold (3 fragile), 1 fails, 1 inconclusive"
    assert set(NUMBER_WORDS) | set(CLAIM_WORDS) >= set(words)


def test_values_of_a_grid_are_each_a_filter_of_their_own(rng):
    common = rng.gamma(4.0, size=100)
    found = [
        Candidate("A", {}, np.zeros(100), Sample(common + off), {"N": n})
        for n, off in ((1, 0.5), (2, 0.0), (3, 0.9))
    ]
    standing = ranking_of(found, "rmse", ranks_settings=True)
    assert (standing.best, [c for c, _ in standing.worse]) == (found[1], [found[0], found[2]])
    assert not standing.chosen
    assert ranking_of(found, "rmse").chosen


@pytest.mark.parametrize(("correlated", "tolerance"), [(True, 0.05), (False, 0.5)])
def test_an_equality_of_five_runs_holds_as_rarely_as_its_level_at_the_tolerance(
    correlated, tolerance
):
    """Both filters vary, and the ratio of their means is exactly at the tolerance: 0.135 % hold.

    The difference over its plain standard error held in 1.7 % of such samples of five runs, and more
    often still where the error of the right side counts.
    """
    rng, trials, runs = np.random.default_rng(8), 1500, 5
    claim = claimed("mean(rmse)", relation="~", right="B", tolerance=tolerance)
    holds = 0
    for _ in range(trials):
        b = 10.0 + rng.standard_normal(runs)
        a = (1.0 + tolerance) * (b if correlated else 10.0 + rng.standard_normal(runs))
        values = {("A", "rmse"): a + 0.1 * rng.standard_normal(runs), ("B", "rmse"): b}
        holds += judge(claim, measured(values)).verdict.word == "holds"
    # Two events expected; more than nine have a probability of 5e-5.
    assert holds <= 9


def test_an_equality_has_the_least_z_of_its_two_ends(rng):
    b = 2.0 + 0.1 * rng.standard_normal(RUNS)
    a = b + 0.02 + 0.03 * rng.standard_normal(RUNS)
    found = judge(
        claimed("mean(rmse)", relation="~", right="B", tolerance=0.05),
        measured({("A", "rmse"): a, ("B", "rmse"): b}),
    )
    low, high = a - 0.95 * b, a - 1.05 * b
    zs = studentized(low.mean(), low - low.mean()), -studentized(high.mean(), high - high.mean())
    assert found.verdict.z == pytest.approx(min(zs), rel=1e-9)
    # Of negative numbers the larger multiple is the lower end.
    found = judge(
        claimed("mean(bias_x)", relation="~", right="B", tolerance=0.05),
        measured({("A", "bias_x"): -a, ("B", "bias_x"): -b}),
    )
    assert found.verdict.z == pytest.approx(min(zs), rel=1e-9)


def test_an_equality_with_a_number_is_studentized(rng):
    a = 1.0 + 0.05 * rng.standard_normal(5)
    found = judge(
        claimed("mean(rmse)", relation="~", factor=1.0, tolerance=0.2), measured({("A", "rmse"): a})
    )
    off = a - a.mean()
    zs = studentized(a.mean() - 0.8, off), -studentized(a.mean() - 1.2, off)
    assert found.verdict.z == pytest.approx(min(zs))
    plain = (0.2 - abs(a.mean() - 1.0)) / (a.std(ddof=1) / np.sqrt(5))
    assert found.verdict.z < 0.7 * plain


def test_an_equality_allows_a_share_of_the_right_side(rng):
    """5 % off, of some hundred: within a tenth, beyond a hundredth."""
    common = 100.0 + rng.standard_normal(RUNS)
    values = {("A", "rmse"): 1.05 * common, ("B", "rmse"): common}
    for tolerance, word in ((0.1, "holds"), (0.01, "fails")):
        claim = claimed("mean(rmse)", relation="~", right="B", tolerance=tolerance)
        assert judge(claim, measured(values)).verdict.word == word


def test_a_higher_score_with_more_lost_runs_is_no_better(rng):
    """As a smaller error is: of a score, more is better."""
    values = {}
    for label, level, lost in (("A", 3.0, 20), ("B", 2.0, 0)):
        values[label, "lost"] = codes(lost)
        scores = level + 0.1 * rng.standard_normal(RUNS)
        values[label, "log_score"] = np.where(codes(lost) > 0, np.nan, scores)
    for relation, losing in ((">", True), ("<", False)):
        found = judge(claimed("mean(log_score)", relation=relation, right="B"), measured(values))
        assert ("A loses 20 runs, B 0" in found.note) == losing
        assert found.verdict.word == ("inconclusive" if losing else "fails")


@pytest.mark.parametrize(
    ("printed", "note"), [(10.0, "at least "), (50.0, ""), (90.0, "at most "), (None, "")]
)
def test_a_printed_size_outside_the_interval_is_noted(printed, note, rng):
    """A's error is half of B's, a gain of 50 %, within a percent or so."""
    common = rng.standard_normal(RUNS)
    values = {("A", "rmse"): 1.0 + 0.01 * common, ("B", "rmse"): 2.0 + 0.03 * common}
    found = judge(claimed("mean(rmse)", right="B", printed=printed), measured(values))
    assert found.verdict.word == "holds"
    said = [part for part in found.note.split("; ") if "printed" in part]
    if note:
        (text,) = said
        assert text.startswith(note)
        assert text.endswith(f"% (95 %), printed {printed:g}")
        assert float(text.split()[2]) == pytest.approx(50.0, abs=2.0)
    else:
        assert said == []
