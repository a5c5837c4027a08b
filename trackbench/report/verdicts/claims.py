"""Tests of claims in words against the results."""

from dataclasses import replace
from itertools import product
from math import inf, isnan, nan
from typing import NamedTuple

from trackbench.config.published import Claim, PublishedNumber, picks
from trackbench.errors import counted
from trackbench.report.expressions import Evaluator
from trackbench.report.results import Results
from trackbench.results.point_facts import GridPoint
from trackbench.statistics import rules
from trackbench.statistics.estimates import OfSteps, RunEstimate, gain, quotient
from trackbench.statistics.over_runs import Estimate, z_score
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
    zs = [test.in_favor(test.term) for test in tests]
    weakest = tests[min(range(len(zs)), key=lambda i: -inf if isnan(zs[i]) else zs[i])]
    z = rules.weakest(zs, len(single))
    parts = _weakest(tests, [test.term.parts(batches) for test in tests], len(single))
    stressed = _weakest(tests, [test.term.stressed() for test in tests], len(single))
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


class _Test(NamedTuple):
    """A claim against one filter of its right side, or against its factor if there is none."""

    claim: Claim
    right: str
    term: RunEstimate
    """the left side, less the right one"""
    edge: float
    """value of the term from which the claim holds"""
    target: float
    """what an equality is relative to"""

    def in_favor(self, term: RunEstimate) -> float:
        """Return z of the claim by a term of all runs, or of some of them."""
        claim = self.claim
        if claim.relation != "~":
            z = term.z(self.edge)
            return -z if claim.relation == "<" else z
        # left ~ right: tolerance |target| - |difference|
        margin = claim.tolerance * abs(self.target) - abs(term.value - self.edge)
        if isinstance(term, OfSteps):
            return term.z(term.value - margin)
        return z_score(Estimate(margin, term.stderr))


def _test(expressions: Evaluator, claim: Claim, right: str) -> _Test:
    left, *others = claim.sides(right)
    if not others:
        term = expressions.of_steps(left) or expressions.term(left)
        return _Test(claim, right, term, claim.factor, claim.factor)
    target = claim.factor * expressions.term(others[0]).value
    term = expressions.difference(left, others[0], claim.factor)
    return _Test(claim, right, term, 0.0, target)


def _weakest(tests: list[_Test], terms: list[list[RunEstimate]], steps: int) -> list[float]:
    """Find z of the weakest test by each part of the runs; none unless every test has parts."""
    weakest = []
    for part in zip(*terms, strict=True) if all(terms) else ():
        zs = [test.in_favor(term) for test, term in zip(tests, part, strict=True)]
        weakest.append(rules.weakest(zs, steps))
    return weakest


def _why(whole: Evaluator, test: _Test) -> str:
    claim, right = test.claim, test.right
    why = []
    for side in claim.sides(right):
        term = whole.term(side)
        losses = f" ({term.losses})" if term.lost else ""
        why.append(f"{side.filter} {term.value:.4g}{losses}")
    why += [] if right else [f"{test.target:g}"]
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
