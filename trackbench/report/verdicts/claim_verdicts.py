"""Tests of claims in words against the results."""

from math import inf, isnan, nan
from typing import NamedTuple

from trackbench.config.published_numbers_and_claims import Claim, PublishedNumber, picks
from trackbench.errors import counted
from trackbench.report.expressions import Evaluator
from trackbench.report.findings import phrases
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.claim_tests import (
    ClaimTest,
    split_into_steps,
    test_against,
    weakest_by_run_set,
)
from trackbench.results.points_json import GridPoint
from trackbench.statistics import claim_rules, verdict_rules
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.ratios import gain, quotient
from trackbench.statistics.verdict_meanings import CLAIM_WORDS
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
    claim
        published claim
    evidence
        measures at the point of the grid that the claim is about; None if there are no results

    Returns
    -------
    ClaimVerdict
        verdict, with the values that decide as a note.
    """
    # A claim without a filter or an expression on its left side names nothing that can be measured.
    if evidence is None or not claim.left or not claim.expression:
        return _unjudged(claim, no_results(claim, evidence))
    # Step 1: one test for each step and each filter on the right side; of a number there is no filter.
    claims_at_steps = split_into_steps(claim, evidence)
    steps = len(claims_at_steps)
    tests = []
    for claim_at_step in claims_at_steps:
        for right_label in claim.rights or [""]:
            tests.append(test_against(evidence, claim_at_step, right_label))
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
    parts = weakest_by_run_set([test.z_of_parts(batches) for test in tests])
    stressed = weakest_by_run_set([test.z_under_stress() for test in tests])
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


def judge_at_points(
    claims: list[Claim], evaluators: list[Evaluator]
) -> tuple[list[Claim], list[list[str]]]:
    """Judge every claim at every point, and leave out those that no point measures.

    ``evaluators`` have the measures at the points. Returns the claims that are left, and for each of
    them the words of the verdicts at the points.
    """
    measured_claims = []
    words_of_claims = []
    for claim in claims:
        verdicts = [judge(claim, evaluator) for evaluator in evaluators]
        if any(verdict.is_measured for verdict in verdicts):
            measured_claims.append(claim)
            words = [verdict.verdict.word for verdict in verdicts]
            # A point that does not measure the claim leaves it undecided.
            words_of_claims.append([word if word in CLAIM_WORDS else UNDECIDED for word in words])
    return measured_claims, words_of_claims


def _unjudged(claim: Claim, why: str) -> ClaimVerdict:
    """Return the verdict on a claim that nothing measures, with the reason if there is one."""
    return ClaimVerdict(
        claim=claim,
        verdict=Verdict(NOT_MEASURED, nan),
        paired=False,
        note=noted(why, claim.note),
        is_measured=False,
    )


def _missing_labels(evaluator: Evaluator, test: ClaimTest) -> list[str]:
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


def _values_note(evaluator: Evaluator, test: ClaimTest) -> str:
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


def _printed_size_note(evaluator: Evaluator, test: ClaimTest) -> str:
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


def _steps_note(weakest: ClaimTest, zs: list[float]) -> str:
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
