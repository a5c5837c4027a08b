"""Tests of claims in words against the results."""

from dataclasses import replace
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
    """Return the verdict on a claim: it holds if it does against every filter that it names."""
    if evidence is None or not claim.left or not claim.expression:
        return _unjudged(claim, no_results(claim, evidence))
    # Step 1: one comparison for each step and each filter on the right side.
    single = _at_each_step(claim, evidence)
    found = [_score(evidence, one, right) for one in single for right in claim.rights or [""]]
    if not found:
        return _unjudged(claim, f"nothing is known of {claim.left}'s {claim.expression}")
    # Step 2: z of the weakest comparison, of all runs, of the parts and under stress.
    weakest = min(found, key=lambda score: -inf if isnan(score.z) else score.z)
    z = rules.weakest([score.z for score in found], len(single))
    parts, stressed = (
        [rules.weakest(zs, len(single)) for zs in zip(*every, strict=True)] if all(every) else []
        for every in ([score.parts for score in found], [score.stressed for score in found])
    )
    exact = weakest.off.term.is_exact  # and so are all that are measured
    verdict = rules.claim_verdict(z, parts, stressed, claim.relation == "~", exact)
    # Step 3: a filter that loses more runs is no better, whatever its error.
    losing = [_loses_more(evidence, claim, right) for right in claim.rights]
    if verdict.word == "holds" and any(losing):
        verdict = verdict._replace(word=UNDECIDED, fragile=False)
    steps = _of_steps(weakest, found) if len(single) > 1 else ""
    measured = not isnan(weakest.off.term.value)
    why = "" if measured else NOT_MEASURED
    reasons = _size(evidence, weakest), _significance(verdict)
    note = noted(*losing, why, _why(evidence, weakest), *reasons, steps, claim.note)
    return ClaimVerdict(claim, verdict, weakest.off.term.splits, note, measured)


def _unjudged(claim: Claim, why: str) -> ClaimVerdict:
    note = noted(why or NOT_MEASURED, claim.note)
    return ClaimVerdict(claim, Verdict(UNDECIDED, nan), False, note, is_measured=False)


def _at_each_step(claim: Claim, whole: Evaluator) -> list[Claim]:
    """Return the claim at each of its steps, or itself without steps."""
    left, right = (
        whole.at_each_step(m.of(claim.left)) if m else [None]
        for m in (claim.expression, claim.right_expression)
    )
    # A right side without steps is repeated at every step of the left side.
    return [
        replace(claim, expression=a, right_expression=b)
        for a, b in zip(left, right if len(right) == len(left) else right * len(left), strict=True)
    ]


class _Margin(NamedTuple):
    """Margin of a claim: the left side's estimate, its value at the claim's edge, and its target."""

    term: RunEstimate
    edge: float
    target: float

    def margin(self, claim: Claim) -> float:
        """Return the number's distance to the claim's edge, positive on the claim's side."""
        off = self.term.value - self.edge
        # left ~ right: tolerance |target| - |difference|
        if claim.relation == "~":
            return claim.tolerance * abs(self.target) - abs(off)
        return -off if claim.relation == "<" else off

    def in_favor(self, claim: Claim) -> float:
        """Return z of the claim."""
        if claim.relation == "~" and isinstance(self.term, OfSteps):
            return self.term.z(self.term.value - self.margin(claim))
        if claim.relation == "~":
            return z_score(Estimate(self.margin(claim), self.term.stderr))
        z = self.term.z(self.edge)
        return -z if claim.relation == "<" else z


class _Score(NamedTuple):
    """The claim against one filter: z in its favor, of the parts and under stress too; how far off."""

    claim: Claim
    right: str
    z: float
    parts: list[float]
    stressed: list[float]
    off: _Margin


def _score(evidence: Evaluator, claim: Claim, right: str) -> _Score:
    """Return the claim against one filter of its right side, or against its factor if there is none."""
    off = _margin(evidence, claim, right)
    parts, stressed = (
        [off._replace(term=term).in_favor(claim) for term in terms]
        for terms in (off.term.parts(evidence.results.batches), off.term.stressed())
    )
    return _Score(claim, right, off.in_favor(claim), parts, stressed, off)


def _margin(expressions: Evaluator, claim: Claim, right: str) -> _Margin:
    left, *others = claim.sides(right)
    if not others:
        term = expressions.of_steps(left) or expressions.term(left)
        return _Margin(term, claim.factor, claim.factor)
    target = claim.factor * expressions.term(others[0]).value
    return _Margin(expressions.difference(left, others[0], claim.factor), 0.0, target)


def _why(whole: Evaluator, score: _Score) -> str:
    """Return both sides of a comparison, in words."""
    claim, right = score.claim, score.right
    why = [_in_words(side.filter, whole.term(side)) for side in claim.sides(right)]
    why += [] if right else [f"{score.off.target:g}"]
    return noted(", ".join(why), score.off.term.why)


def _significance(verdict: Verdict) -> str:
    """Return that an inconclusive claim is significant by the rule for filters, if it is."""
    z = verdict.z
    if verdict.word != UNDECIDED or not (rules.is_significant(z) and verdict.is_short):
        return ""
    way, level = "" if z > 0.0 else "against it ", f"{100 * rules.LEVEL:g} %"
    return f"{way}significant at {level}, z {z:+.1f}; a verdict takes {verdict.needed:g}"


def _size(evidence: Evaluator, score: _Score) -> str:
    """Return that the printed size of a difference lies outside its 95 % interval, if it does."""
    claim = score.claim
    if claim.printed is None or not score.right or claim.expression is None:
        return ""
    ratio = quotient(*(evidence.term(side) for side in claim.sides(score.right)))
    low, high = gain(ratio).interval()
    if low <= claim.printed <= high or isnan(low + high):
        return ""
    limit = f"at most {high:.2g}" if claim.printed > high else f"at least {low:.2g}"
    return f"{limit} % (95 %), printed {claim.printed:g}"


def _of_steps(weakest: _Score, found: list[_Score]) -> str:
    """Return the weakest of comparisons at many steps, and how many are significant."""
    steps = weakest.claim.expression and weakest.claim.expression.steps
    surely = sum(rules.decided(score.z) > 0 for score in found)
    where = f"at step {steps.first}; " if steps else ""
    return f"{where}{surely} of {len(found)} comparisons hold by themselves"


def _in_words(label: str, term: RunEstimate) -> str:
    return f"{label} {term.value:.4g}" + (f" ({term.losses})" if term.lost else "")


def _loses_more(expressions: Evaluator, claim: Claim, right: str) -> str:
    """Return why a filter with a smaller error is no better: it loses more of the same runs."""
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
    """Return the point that ``path=value; path=value`` picks; the first with results if it is empty."""
    return next((point for point in results.points() if picks(text, point)), None)
