"""Tests of claims in words against the results."""

from dataclasses import replace
from itertools import product
from math import inf, isnan, nan
from typing import NamedTuple

from trackbench.config.published import Claim, PublishedNumber, picks
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.expressions import Evaluator
from trackbench.report.results import Results
from trackbench.results.point_facts import GridPoint
from trackbench.statistics import rules
from trackbench.statistics.estimates import RunEstimate, gain, quotient
from trackbench.statistics.rules import UNDECIDED, Verdict

NOT_MEASURED = "not measured"


class ClaimVerdict(NamedTuple):
    """A claim, the verdict by the z of its weakest comparison (positive: in its favor), and why."""

    claim: Claim
    verdict: Verdict
    paired: bool
    note: str
    is_measured: bool = True


def judge(claim: Claim, evidence: Evaluator | None) -> ClaimVerdict:
    """Judge a claim: it holds if it does against every filter that it names."""
    if evidence is None or not claim.left or not claim.expression:
        return _unjudged(claim, no_results(claim, evidence))
    # Step 1: one test for each step and each filter on the right side.
    single, batches = _at_each_step(claim, evidence), evidence.results.batches
    tests = [_test(evidence, one, right) for one, right in product(single, claim.rights or [""])]
    if not tests:
        return _unjudged(claim, f"nothing is known of {claim.left}'s {claim.expression}")
    # Step 2: z of the weakest test, of all runs, of the parts and under stress.
    zs = [test.z for test in tests]
    weakest = tests[min(range(len(zs)), key=lambda i: -inf if isnan(zs[i]) else zs[i])]
    z = rules.weakest(zs, len(single))
    parts = _weakest([test.of_parts(batches) for test in tests], len(single))
    stressed = _weakest([test.stressed() for test in tests], len(single))
    exact = weakest.term.is_exact  # and so are all that are measured
    verdict = rules.claim_verdict(z, parts, stressed, claim.relation == "~", exact)
    # Step 3: a filter that loses more runs is no better, whatever its error.
    losing = [_loses_more(evidence, claim, right) for right in claim.rights]
    if verdict.word == "holds" and any(losing):
        verdict = verdict._replace(word=UNDECIDED, fragile=False)
    steps = _of_steps(weakest, zs) if len(single) > 1 else ""
    measured = not isnan(weakest.term.value)
    why = "" if measured else NOT_MEASURED
    reasons = _size(evidence, weakest), _significance(verdict)
    note = noted(*losing, why, _why(evidence, weakest), *reasons, steps, claim.note)
    return ClaimVerdict(claim, verdict, weakest.term.splits, note, measured)


def _unjudged(claim: Claim, why: str) -> ClaimVerdict:
    note = noted(why or NOT_MEASURED, claim.note)
    return ClaimVerdict(claim, Verdict(UNDECIDED, nan), False, note, is_measured=False)


def _at_each_step(claim: Claim, whole: Evaluator) -> list[Claim]:
    """Repeat the claim at each of its steps."""
    sides = []
    for m in (claim.expression, claim.right_expression):
        sides.append(whole.at_each_step(m.of(claim.left)) if m else [None])
    # A right side without steps is repeated at every step of the left side.
    left, right = sides
    pairs = zip(left, right if len(right) == len(left) else right * len(left), strict=True)
    return [replace(claim, expression=a, right_expression=b) for a, b in pairs]


class _Bound(NamedTuple):
    """A one-sided test: the term lies above an edge, or below it."""

    term: RunEstimate
    edge: float
    is_above: bool

    def in_favor(self, term: RunEstimate) -> float:
        """Return z by the term of all runs, or of some of them; positive in favor of the bound."""
        z = term.z(self.edge)
        return z if self.is_above else -z


class _Test(NamedTuple):
    """A claim against one filter of its right side, or against its factor if there is none."""

    claim: Claim
    right: str
    term: RunEstimate
    """the left side, less the right one times the factor"""
    bounds: tuple[_Bound, ...]
    """one-sided tests that must all be shown: one of an inequality, two of an equality"""

    @property
    def z(self) -> float:
        """Return z in favor of the claim by all runs."""
        return _least([bound.in_favor(bound.term) for bound in self.bounds])

    def of_parts(self, batches: int) -> list[float]:
        """Return z in favor of the claim without each batch of runs in turn."""
        return self._of_others([bound.term.parts(batches) for bound in self.bounds])

    def stressed(self) -> list[float]:
        """Return z in favor of the claim by runs that could well have been drawn."""
        return self._of_others([bound.term.stressed() for bound in self.bounds])

    def _of_others(self, terms: list[list[RunEstimate]]) -> list[float]:
        zs = []
        for of_bounds in zip(*terms, strict=True):
            pairs = zip(self.bounds, of_bounds, strict=True)
            zs.append(_least([bound.in_favor(term) for bound, term in pairs]))
        return zs


def _least(zs: list[float]) -> float:
    """Return the least z of tests that must all be shown, NaN if one is unknown."""
    return nan if any(map(isnan, zs)) else min(zs)


def _test(expressions: Evaluator, claim: Claim, right: str) -> _Test:
    left, *others = claim.sides(right)
    ends = _ends(expressions, claim, others)
    if not others:
        term = expressions.of_steps(left) or expressions.term(left)
        bounds = [_Bound(term, edge, is_above) for edge, is_above in ends]
        return _Test(claim, right, term, tuple(bounds))
    # The right side is measured, too: its error belongs to the test of an end.
    bounds = []
    for factor, is_above in ends:
        bounds.append(_Bound(expressions.difference(left, others[0], factor), 0.0, is_above))
    return _Test(claim, right, expressions.difference(left, others[0], claim.factor), tuple(bounds))


def _ends(expressions: Evaluator, claim: Claim, others: list[Measure]) -> list[tuple[float, bool]]:
    """Return multiples of the right side, and whether the left side must lie above each.

    An equality is two one-sided tests (Schuirmann 1987, J. Pharmacokinet. Biopharm. 15, 657): the left
    side is above the lower end of the tolerance and below the upper one.
    """
    if claim.relation != "~":
        return [(claim.factor, claim.relation == ">")]
    room = claim.tolerance * abs(claim.factor)
    if others and expressions.term(others[0]).value < 0.0:
        room = -room  # of a negative right side the larger multiple is the lower end
    return [(claim.factor - room, True), (claim.factor + room, False)]


def _weakest(zs_of_tests: list[list[float]], steps: int) -> list[float]:
    """Find z of the weakest test by each part of the runs; none unless every test has parts."""
    parts = zip(*zs_of_tests, strict=True) if all(zs_of_tests) else ()
    return [rules.weakest(zs, steps) for zs in parts]


def _why(whole: Evaluator, test: _Test) -> str:
    claim, right = test.claim, test.right
    why = []
    for side in claim.sides(right):
        term = whole.term(side)
        losses = f" ({term.losses})" if term.lost else ""
        why.append(f"{side.filter} {term.value:.4g}{losses}")
    why += [] if right else [f"{claim.factor:g}"]
    return noted(", ".join(why), test.term.why)


def _significance(verdict: Verdict) -> str:
    """Note that an inconclusive claim is significant by the rule for filters, if it is."""
    z = verdict.z
    if verdict.word != UNDECIDED or not (rules.is_significant(z) and verdict.is_short):
        return ""
    way, level = "" if z > 0.0 else "against it ", f"{100 * rules.LEVEL:g} %"
    return f"{way}significant at {level}, z {z:+.1f}; a verdict takes {verdict.needed:g}"


def _size(evidence: Evaluator, test: _Test) -> str:
    """Note that the printed size of a difference lies outside its 95 % interval, if it does."""
    claim = test.claim
    if claim.printed is None or not test.right or claim.expression is None:
        return ""
    ratio = quotient(*(evidence.term(side) for side in claim.sides(test.right)))
    low, high = gain(ratio).interval()
    if low <= claim.printed <= high or isnan(low + high):
        return ""
    limit = f"at most {high:.2g}" if claim.printed > high else f"at least {low:.2g}"
    return f"{limit} % (95 %), printed {claim.printed:g}"


def _of_steps(weakest: _Test, zs: list[float]) -> str:
    """Describe the weakest of tests at many steps, and how many are significant."""
    steps = weakest.claim.expression and weakest.claim.expression.steps
    surely = sum(rules.decided(z) > 0 for z in zs)
    where = f"at step {steps.first}; " if steps else ""
    return f"{where}{surely} of {len(zs)} comparisons hold by themselves"


def _loses_more(expressions: Evaluator, claim: Claim, right: str) -> str:
    """Explain why a filter with a smaller error is no better: it loses more of the same runs."""
    a, b = (expressions.runs.get((label, "lost")) for label in (claim.left, right))
    # Only a claim that the left side is better is affected.
    better = ">" if claim.expression and claim.expression.family[0].more_is_better else "<"
    filters = sum(metric == "lost" for _, metric in expressions.runs)
    if claim.relation != better or a is None or b is None:
        return ""
    if not rules.loses_more(a, b, filters):
        return ""
    mine = counted(int((a > 0).sum()), "run")
    return f"{claim.left} loses {mine}, {right} {int((b > 0).sum())}"


def no_results(row: PublishedNumber | Claim, evidence: Evaluator | None) -> str:
    """Return a note if the grid lacks the point that a row names."""
    return "" if evidence is not None else f"no results at {row.point}"


def noted(*notes: str) -> str:
    """Join the nonempty notes."""
    return "; ".join(filter(None, notes))


def evidence_at(results: Results, text: str) -> Evaluator | None:
    """Return the measures at the point that a published row names, None if it has no results."""
    point = point_of(results, text)
    return None if point is None else Evaluator(results, point)


def point_of(results: Results, text: str) -> GridPoint | None:
    """Find the point that ``path=value; path=value`` picks; the first with results if it is empty."""
    return next((point for point in results.points() if picks(text, point)), None)
