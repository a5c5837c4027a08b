"""Tests of claims in words against the results."""

from dataclasses import replace
from math import inf, isnan, nan
from typing import NamedTuple

from trackbench.config.published_numbers_and_claims import Claim, PublishedNumber, picks
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics import claim_rules, verdict_rules
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.influential_runs import with_few_runs_changed, without_each_batch
from trackbench.statistics.ratios import gain, quotient
from trackbench.statistics.verdict_rules import (
    NOT_MEASURED,
    TOO_FEW_RUNS,
    UNDECIDED,
    Verdict,
    noted,
)


class ClaimVerdict(NamedTuple):
    """A claim, with the verdict by the z of its weakest comparison (positive: in its favor)."""

    claim: Claim
    verdict: Verdict
    paired: bool
    """whether the weakest comparison is of common runs"""
    note: str
    """reasons for the verdict"""
    is_measured: bool = True
    """False if the results lack a number that the claim needs"""


def judge(claim: Claim, evidence: Evaluator | None) -> ClaimVerdict:
    """Judge a claim: it holds if it does against every filter that it names.

    Parameters
    ----------
    claim : published claim
    evidence : measures at the point of the grid that the claim is about; None if there are no results

    Returns
    -------
    Verdict, with the values that decide as a note.
    """
    # A claim without a filter or an expression on its left side names nothing that can be measured.
    if evidence is None or not claim.left or not claim.expression:
        return _unjudged(claim, no_results(claim, evidence))
    # Step 1: one test for each step and each filter on the right side; of a number there is no filter.
    claims_at_steps = _at_each_step(claim, evidence)
    steps = len(claims_at_steps)
    tests = []
    for claim_at_step in claims_at_steps:
        for right_label in claim.rights or [""]:
            tests.append(_test(evidence, claim_at_step, right_label))
    if not tests:
        return _unjudged(claim, f"nothing is known of {claim.left}'s {claim.expression}")
    # Step 2: z in favor of the claim by its weakest test: over all runs, without each batch of runs
    # (``parts``), and with few runs changed (``stressed``). A test without a z is the weakest.
    # `claim_rules.weakest` corrects a negative z for the number of tests.
    zs = [test.z for test in tests]
    strengths = [-inf if isnan(z) else z for z in zs]
    weakest = tests[strengths.index(min(strengths))]
    z = claim_rules.weakest(zs)
    batches = evidence.results.batches
    parts = _weakest_by_run_set([test.z_of_parts(batches) for test in tests])
    stressed = _weakest_by_run_set([test.z_under_stress() for test in tests])
    verdict = claim_rules.claim_verdict(
        z,
        parts,
        stressed,
        equal=claim.relation == "~",
        exact=weakest.term.is_exact,  # then so are the terms of all tests
    )
    # Step 3: a filter that loses more runs is no better, whatever its error.
    losing = [_loses_more(evidence, claim, right) for right in claim.rights]
    if verdict.word == "holds" and any(losing):
        verdict = verdict._replace(word=UNDECIDED, fragile=False)
    # Step 4: no verdict without a number, and none of fewer runs than the experiment has. The number of
    # the experiment's runs is set only if an option such as --quick took fewer; else it is None.
    missing_labels = _missing_labels(evidence, weakest)
    if missing_labels:
        return _unjudged(
            claim, f"no number of {phrases.joined(map(phrases.named, missing_labels))}"
        )
    if evidence.results.experiment_runs is not None:
        verdict = verdict._replace(word=TOO_FEW_RUNS, fragile=False)
    # Step 5: the reasons.
    note = noted(
        *losing,
        _values_note(evidence, weakest),
        _printed_size_note(evidence, weakest),
        _significance_note(verdict),
        _steps_note(weakest, zs) if steps > 1 else "",
        claim.note,
    )
    return ClaimVerdict(
        claim=claim,
        verdict=verdict,
        # The sides are paired by runs, or by recorded steps, if their difference has the influence of
        # each.
        paired=weakest.term.has_influences,
        note=note,
        is_measured=not isnan(weakest.term.value),
    )


def _unjudged(claim: Claim, why: str) -> ClaimVerdict:
    """Return the verdict on a claim that nothing measures, with the reason if there is one."""
    return ClaimVerdict(
        claim=claim,
        verdict=Verdict(NOT_MEASURED, nan),
        paired=False,
        note=noted(why, claim.note),
        is_measured=False,
    )


def _at_each_step(claim: Claim, evaluator: Evaluator) -> list[Claim]:
    """Split a claim about several steps into one claim for each step.

    The list is empty if the results have none of the steps.
    """
    # The expressions of the left and of the right side at each step; None for a side that is a number.
    sides: list[list[Measure | None]] = []
    for side in (claim.expression, claim.right_expression):
        if side is None:
            sides.append([None])
        else:
            # Only the steps are wanted, so any filter does: `Claim.sides` sets the filter later.
            sides.append([*evaluator.at_each_step(side.of(claim.left))])
    left_expressions, right_expressions = sides
    # A right side without steps is repeated at every step of the left side.
    if len(right_expressions) != len(left_expressions):
        right_expressions = right_expressions * len(left_expressions)
    claims = []
    for expression, right_expression in zip(left_expressions, right_expressions, strict=True):
        claims.append(replace(claim, expression=expression, right_expression=right_expression))
    return claims


class _Bound(NamedTuple):
    """A one-sided test: the term lies above an edge, or below it if not ``is_above``."""

    term: RunEstimate
    edge: float
    is_above: bool

    def z_in_favor(self, term: RunEstimate) -> float:
        """Return z by the term of all runs, or of some of them; positive in favor of the bound."""
        z = term.z(self.edge)
        return z if self.is_above else -z


class _Test(NamedTuple):
    """A claim against one filter of its right side, or against its factor if there is none."""

    claim: Claim
    right_label: str
    """the filter; empty if there is none"""
    term: RunEstimate
    """the left side, less the right one times the factor"""
    bounds: tuple[_Bound, ...]
    """one-sided tests that must all be shown: one of an inequality, two of an equality"""

    @property
    def z(self) -> float:
        """Return z in favor of the claim by all runs."""
        return _least([bound.z_in_favor(bound.term) for bound in self.bounds])

    def z_of_parts(self, batches: int) -> list[float]:
        """Return z in favor of the claim without each batch of runs in turn."""
        return self._z_of_terms([without_each_batch(bound.term, batches) for bound in self.bounds])

    def z_under_stress(self) -> list[float]:
        """Return z in favor of the claim by runs that could well have been drawn."""
        return self._z_of_terms([with_few_runs_changed(bound.term) for bound in self.bounds])

    def _z_of_terms(self, terms_of_bounds: list[list[RunEstimate]]) -> list[float]:
        """Return z in favor of the claim by each of several other sets of runs.

        Such sets are all runs without one batch, or all runs with few of them changed. They show if the
        verdict depends on few runs. ``terms_of_bounds`` has a list for each one-sided test of
        ``bounds``: the number that it tests, as each of the sets of runs gives it.
        """
        zs = []
        for terms in zip(*terms_of_bounds, strict=True):
            pairs = zip(self.bounds, terms, strict=True)
            zs.append(_least([bound.z_in_favor(term) for bound, term in pairs]))
        return zs


def _least(zs: list[float]) -> float:
    """Return the least z of tests that must all be shown, NaN if one is unknown."""
    if any(map(isnan, zs)):
        return nan
    return min(zs)


def _test(evaluator: Evaluator, claim: Claim, right_label: str) -> _Test:
    """Test a claim against one filter of its right side.

    ``right_label`` is empty if the right side is a number.
    """
    # The measures on the left and on the right side; a number is none.
    sides = claim.sides(right_label)
    left = sides[0]
    # The right side is a number: each end is a test of the left side against it. An error or score of
    # a recording has a standard error by its steps, which `difference`, below, takes by itself.
    if len(sides) == 1:
        term = evaluator.estimate_of_steps(left) or evaluator.term(left)
        bounds = []
        for edge, is_above in _ends(evaluator, claim, None):
            bounds.append(_Bound(term=term, edge=edge, is_above=is_above))
        return _Test(claim=claim, right_label=right_label, term=term, bounds=tuple(bounds))
    # The right side is measured, too: each end is a factor, and a test of left - factor * right against
    # zero, which has the errors of both sides.
    other = sides[1]
    bounds = []
    for factor, is_above in _ends(evaluator, claim, other):
        difference = evaluator.difference(left, other, factor)
        bounds.append(_Bound(term=difference, edge=0.0, is_above=is_above))
    term = evaluator.difference(left, other, claim.factor)
    return _Test(claim=claim, right_label=right_label, term=term, bounds=tuple(bounds))


def _ends(evaluator: Evaluator, claim: Claim, other: Measure | None) -> list[tuple[float, bool]]:
    """Return the ends that a claim sets, and for each whether the left side must lie above it.

    ``other`` is the measure on the right side, and an end is the factor by which it is multiplied. If
    the right side is a number, ``other`` is None and an end is that number.

    An equality is two one-sided tests (Schuirmann 1987, J. Pharmacokinet. Biopharm. 15, 657): the left
    side is above the lower end of the tolerance and below the upper one.
    """
    if claim.relation != "~":
        return [(claim.factor, claim.relation == ">")]
    margin = claim.tolerance * abs(claim.factor)
    if other is not None and evaluator.term(other).value < 0.0:
        margin = -margin  # of a negative right side the larger multiple is the lower end
    return [(claim.factor - margin, True), (claim.factor + margin, False)]


def _weakest_by_run_set(zs_of_tests: list[list[float]]) -> list[float]:
    """Return z of the weakest test for each of several sets of the runs.

    ``zs_of_tests`` has a list for each test: its z by each set of runs. The result is empty if any of
    these lists is empty. `claim_rules.weakest` corrects a negative z for the number of tests.
    """
    if not all(zs_of_tests):
        return []
    return [claim_rules.weakest(zs) for zs in zip(*zs_of_tests, strict=True)]


def _missing_labels(evaluator: Evaluator, test: _Test) -> list[str]:
    """List the filters of a test of which the results do not have the compared number.

    Their value is NaN although they have lost no run.
    """
    labels: dict[str, None] = {}
    # The measure on the left side of the claim, and the one on the right side unless that is a number.
    for side in test.claim.sides(test.right_label):
        term = evaluator.term(side)
        if isnan(term.value) and not term.lost:
            labels[side.filter] = None
    return list(labels)


def _values_note(evaluator: Evaluator, test: _Test) -> str:
    """Write the values of both sides of a test: ``HDEPF 1.2, PF 3.4``.

    A filter's lost runs stand behind its value, and the reason for a missing standard error at the end.
    A claim without a filter on the right side compares with a number, its ``factor``: ``HDEPF 1.2, 2``.
    """
    claim = test.claim
    values = []
    for side in claim.sides(test.right_label):
        term = evaluator.term(side)
        value = f"{side.filter} {term.value:.4g}"
        if term.lost:
            value += f" ({term.losses})"
        values.append(value)
    if not test.right_label:
        values.append(f"{claim.factor:g}")
    return noted(", ".join(values), test.term.why)


def _significance_note(verdict: Verdict) -> str:
    """Note that an inconclusive claim is significant at the level of the ranking; else empty.

    A verdict on a claim takes a larger z than that level.
    """
    z = verdict.z
    # `is_short` is True if z, of either sign, is smaller than a verdict takes. If it is large enough,
    # the claim is inconclusive for another reason.
    if verdict.word != UNDECIDED or not (rules.is_significant(z) and verdict.is_short):
        return ""
    direction = "" if z > 0.0 else "against it "  # z is positive in favor of the claim
    level = f"{100 * rules.LEVEL:g} %"
    return f"{direction}significant at {level}, z {z:+.1f}; a verdict takes {verdict.needed:g}"


def _printed_size_note(evaluator: Evaluator, test: _Test) -> str:
    """Note that the size of a difference that a claim prints, %, lies outside the measured interval.

    The text is empty if the size lies inside the 95 % interval, and if there is no interval. It is also
    empty if the claim prints no size or compares a filter with a number.
    """
    claim = test.claim
    if claim.printed is None or not test.right_label or claim.expression is None:
        return ""
    left, right = (evaluator.term(side) for side in claim.sides(test.right_label))
    # By how many percent the left side is below the right one.
    low, high = gain(quotient(left, right)).interval()
    if low <= claim.printed <= high or isnan(low + high):
        return ""
    limit = f"at least {low:.2g}"
    if claim.printed > high:
        limit = f"at most {high:.2g}"
    return f"{limit} % (95 %), printed {claim.printed:g}"


def _steps_note(weakest: _Test, zs: list[float]) -> str:
    """Write the step of the weakest of tests at many steps, and how many tests hold.

    ``zs`` has the z of each test over all runs, positive in favor of the claim.
    """
    expression = weakest.claim.expression
    where = ""
    if expression is not None and expression.steps:
        where = f"at step {expression.steps.first}; "
    # `decided` returns 1 for a test that holds.
    holding = sum(verdict_rules.decided(z) > 0 for z in zs)
    return f"{where}{holding} of {len(zs)} comparisons hold by themselves"


def _loses_more(evaluator: Evaluator, claim: Claim, right: str) -> str:
    """Note that the left filter loses significantly more runs than ``right``; else empty.

    A filter that loses more runs is not better than another, even if its error is smaller.
    """
    lost_left = evaluator.runs.get((claim.left, "lost"))
    lost_right = evaluator.runs.get((right, "lost"))
    # Only a claim that the left side is better is affected.
    more_is_better = claim.expression is not None and claim.expression.definition.more_is_better
    better = ">" if more_is_better else "<"
    if claim.relation != better or lost_left is None or lost_right is None:
        return ""
    # All pairs of filters are one family of tests: the test needs the number of filters.
    filters = sum(metric == "lost" for _, metric in evaluator.runs)
    if not rules.loses_more(lost_left, lost_right, filters):
        return ""
    number_left = counted(int((lost_left > 0).sum()), "run")
    number_right = int((lost_right > 0).sum())
    return f"{claim.left} loses {number_left}, {right} {number_right}"


def no_results(row: PublishedNumber | Claim, evidence: Evaluator | None) -> str:
    """Return a note that there are no results at the point of the grid that a published row names.

    ``evidence`` has the measures at this point. It is None without results; else the note is empty.
    """
    if evidence is None:
        return f"no results at {row.point}"
    return ""


def evidence_at(results: Results, picked_point: str) -> Evaluator | None:
    """Return the measures at the point that a published row names, None if it has no results.

    ``picked_point`` is written ``path=value; path=value``.
    """
    point = point_of(results, picked_point)
    if point is None:
        return None
    return Evaluator(results, point)


def point_of(results: Results, picked_point: str) -> GridPoint | None:
    """Find the point of the results that ``path=value; path=value`` picks; None if there is none.

    An empty text picks the first point.
    """
    for point in results.points():
        if picks(picked_point, point):
            return point
    return None
