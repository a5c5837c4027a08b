"""Reasons why published numbers and claims are inconclusive, a line each."""

from math import isfinite, isnan

from trackbench.report.verdicts.all_verdicts import Verdicts
from trackbench.report.verdicts.claim_verdicts import ClaimVerdict
from trackbench.report.verdicts.number_verdicts import Compared
from trackbench.statistics.runs_needed import run_count, runs_that_decide
from trackbench.statistics.verdict_rules import DECIDED, UNDECIDED

_MOST_REASONS = 5
"""Lines of a list, which is cut if it is longer; comparison.md has all verdicts."""


def reasons(comparison: Verdicts, runs: int) -> list[str]:
    """Explain why numbers and claims are inconclusive, a line each.

    ``runs`` is the number of runs of each filter.
    """
    lines = []
    for number in comparison.numbers:
        # A number has a row for each reading, an interpretation of the paper: the best verdict counts.
        row = number.best
        if row.verdict.word == UNDECIDED:
            published = row.published
            words = (published.filter, published.metric, published.row)
            name = ", ".join(filter(None, words))
            lines.append(f"inconclusive: {name}: {_reason(row, runs)}")
    for claim in comparison.claims:
        if claim.verdict.word == UNDECIDED:
            lines.append(f"inconclusive: {claim.claim.claim}: {_reason(claim, runs)}")
    more = len(lines) - _MOST_REASONS
    if more < 2:  # a line on one more is as long as that line
        return lines
    return [*lines[:_MOST_REASONS], f"inconclusive: {more} more: comparison.md"]


def _reason(row: Compared | ClaimVerdict, runs: int) -> str:
    """Explain why a number or a claim is inconclusive.

    ``runs`` is the number of runs of each filter; if it is 1, the run is a recording.
    """
    verdict = row.verdict
    z = abs(verdict.z)
    # A number to which a setting was fitted confirms nothing, whatever its z.
    is_chosen = isinstance(row, Compared) and bool(row.published.chosen)
    if not isfinite(z) or is_chosen:
        return row.note or "no standard error"
    # A word on a bias is decided by a margin, not by z alone.
    if isnan(verdict.needed):
        return f"neither within its margin nor beyond it by {DECIDED:g} standard errors"
    # Case 1: z over all runs is too small.
    if verdict.is_short:
        text = f"{z:.2f} standard errors, and {verdict.needed:g} decide"
        # Below half a standard error, the size of the measured difference means nothing.
        if not verdict.has_sign:
            return f"{text}; no sign of a difference"
        more = run_count(runs_that_decide(runs, z, verdict.needed))
        more_data = f"{more} runs" if runs > 1 else f"a recording {more} times as long"
        return f"{text}; a difference as large as measured needs about {more_data}"
    # Case 2: z of all runs is large enough, but z without one batch of them is not.
    z_of_part = verdict.weak_part
    if z_of_part is None:
        return row.note
    return (
        f"{z:.1f} standard errors over all runs, but {abs(z_of_part):.1f} without one batch of them"
    )
