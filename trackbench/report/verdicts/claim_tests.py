"""Tests of a published claim: one for each step and each filter on its right side."""

from dataclasses import replace
from math import isnan, nan
from typing import NamedTuple

from trackbench.config.published_numbers_and_claims import Claim
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.expressions import Evaluator
from trackbench.statistics import claim_rules
from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.influential_runs import with_few_runs_changed, without_each_batch


def split_into_steps(claim: Claim, evaluator: Evaluator) -> list[Claim]:
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


class Bound(NamedTuple):
    """A one-sided test: the term lies above an edge, or below it if not ``is_above``."""

    term: RunEstimate
    edge: float
    is_above: bool

    def z_in_favor(self, term: RunEstimate) -> float:
        """Return z by the term of all runs, or of some of them; positive in favor of the bound."""
        z = term.z(self.edge)
        return z if self.is_above else -z


class ClaimTest(NamedTuple):
    """A claim against one filter of its right side, or against its factor if there is none."""

    claim: Claim
    right_label: str
    """the filter; empty if there is none"""
    term: RunEstimate
    """the left side, less the right one times the factor"""
    bounds: tuple[Bound, ...]
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


def test_against(evaluator: Evaluator, claim: Claim, right_label: str) -> ClaimTest:
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
            bounds.append(Bound(term=term, edge=edge, is_above=is_above))
        return ClaimTest(claim=claim, right_label=right_label, term=term, bounds=tuple(bounds))
    # The right side is measured, too: each end is a factor, and a test of left - factor * right against
    # zero, which has the errors of both sides.
    other = sides[1]
    bounds = []
    for factor, is_above in _ends(evaluator, claim, other):
        difference = evaluator.difference(left, other, factor)
        bounds.append(Bound(term=difference, edge=0.0, is_above=is_above))
    term = evaluator.difference(left, other, claim.factor)
    return ClaimTest(claim=claim, right_label=right_label, term=term, bounds=tuple(bounds))


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


def weakest_by_run_set(zs_of_tests: list[list[float]]) -> list[float]:
    """Return z of the weakest test for each of several sets of the runs.

    ``zs_of_tests`` has a list for each test: its z by each set of runs. The result is empty if any of
    these lists is empty. `claim_rules.weakest` corrects a negative z for the number of tests.
    """
    if not all(zs_of_tests):
        return []
    return [claim_rules.weakest(zs) for zs in zip(*zs_of_tests, strict=True)]
