"""Reasons for inconclusive verdicts: what decides, what was measured, how many runs would do."""

from collections.abc import Iterator
from math import isfinite

from trackbench.report.findings.phrases import run_count
from trackbench.report.verdicts.claims import ClaimVerdict
from trackbench.report.verdicts.numbers import Compared, Comparison
from trackbench.report.verdicts.rules import DECIDED, SURE, UNDECIDED, runs_needed

_MOST = 5
"""Longer lists are cut; comparison.md has all verdicts."""


def reasons(comparison: Comparison, runs: int) -> list[str]:
    """Return why numbers and claims are inconclusive, a line each; ``runs`` of each filter."""
    lines = [
        f"inconclusive: {_name(row)}: {_reason(row, runs)}"
        for row in _rows(comparison)
        if row.verdict.word == UNDECIDED
    ]
    more = len(lines) - _MOST
    return [*lines[:_MOST], f"inconclusive: {more} more: comparison.md"] if more > 1 else lines


def _rows(comparison: Comparison) -> Iterator[Compared | ClaimVerdict]:
    yield from (number.best for number in comparison.numbers)
    yield from comparison.claims


def _name(row: Compared | ClaimVerdict) -> str:
    if isinstance(row, ClaimVerdict):
        return row.claim.claim
    return ", ".join(filter(None, (row.published.filter, row.published.metric, row.published.row)))


def _reason(row: Compared | ClaimVerdict, runs: int) -> str:
    verdict = row.verdict
    z, needed = abs(verdict.z), _needed(row, verdict.z)
    if not isfinite(z) or (isinstance(row, Compared) and row.published.chosen):
        return row.note or "no standard error"
    if needed is None:
        return f"neither within its margin nor beyond it by {DECIDED:g} standard errors"
    if z < needed:
        text = f"{z:.2f} standard errors, and {needed:g} decide"
        if z < _NOTHING:
            return f"{text}; no sign of a difference"
        most = runs_needed(runs, z, exact=needed == SURE)
        what = (
            f"{run_count(most)} runs"
            if runs > 1
            else f"a recording {run_count(most)} times as long"
        )
        return f"{text}; a difference as large as measured needs about {what}"
    least = min(verdict.parts, key=abs, default=verdict.z)
    if abs(least) < SURE or least * verdict.z < 0.0:
        return (
            f"{z:.1f} standard errors over all runs, but {abs(least):.1f} without one batch of them"
        )
    return row.note


_NOTHING = 0.5
"""Standard errors below which a measured difference says nothing about its size."""


def _needed(row: Compared | ClaimVerdict, z: float) -> float | None:
    """Return the standard errors that decide; None of a bias, which is compared with a margin."""
    if isinstance(row, Compared):
        return None if isinstance(row.published.value, str) else DECIDED
    return SURE if row.is_exact or (z > 0.0 and row.claim.relation == "~") else DECIDED
