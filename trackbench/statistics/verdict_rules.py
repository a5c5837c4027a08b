"""Limits and words that all verdicts on what papers print have: on numbers, on a bias, on claims.

A printed number differs, or a claim holds or fails (`decided`), if all runs show it beyond `DECIDED`
standard errors, and the runs without any one batch beyond `SURE`. An agreement is an equivalence: all
runs show it beyond `SURE`, and no part contradicts it. docs/statistics.md has error rates and power.
"""

from collections.abc import Sequence
from math import copysign, sqrt
from typing import NamedTuple

from trackbench.statistics.estimates import RunEstimate
from trackbench.statistics.influential_runs import without_each_batch

DECIDED = 5.0
"""Standard errors of all runs from which a difference is decided."""
SURE = 3.0
"""Standard errors from which the runs without a batch show it, and all runs an agreement."""
ANOTHER_SEED = 1.6449 * sqrt(2.0)
"""Standard errors within which nine in ten numbers of another seed lie."""
NO_SIGN = 0.5
"""Standard errors below which a measured difference says nothing about its size."""
UNDECIDED = "inconclusive"
TOO_FEW_RUNS = "too few runs"
NOT_MEASURED = "not measured"


class Verdict(NamedTuple):
    """A verdict on a number or claim, with the z that it is from."""

    word: str
    """a key of `verdict_meanings.MEANINGS`"""
    z: float
    """over all runs"""
    parts: tuple[float, ...] = ()
    """z without each batch of runs in turn"""
    fragile: bool = False
    """whether another seed, one run less or three more runs could well change the word"""
    needed: float = DECIDED
    """standard errors of all runs that decide; NaN of a bias, which is compared with a margin"""

    @property
    def is_short(self) -> bool:
        """True if z over all runs is below what a decision needs."""
        return abs(self.z) < self.needed

    @property
    def has_sign(self) -> bool:
        """True if z is large enough that the size of the measured difference means anything."""
        return abs(self.z) >= NO_SIGN

    @property
    def weak_part(self) -> float | None:
        """Least z without a batch of runs, if it does not confirm the z of all runs; None if it does.

        It does not if its size is below `SURE` or it has the other sign. If there are no batches, it is
        the z of all runs.
        """
        least = min(self.parts, key=abs, default=self.z)
        if abs(least) < SURE or least * self.z < 0.0:
            return least
        return None


def decided(z: float, parts: Sequence[float] = (), exact: bool = False) -> int:
    """Return the sign of a difference if it is significant, else 0.

    Parameters
    ----------
    z
        z of all runs, which must exceed `DECIDED`, 5 standard errors
    parts
        z without each batch of runs, which must all exceed `SURE`, 3 standard errors
    exact
        True for the test of a share of runs or of one recording: skewed errors of runs, for which
        `DECIDED` leaves room, do not spoil it. Its z must exceed only `SURE`, and no part may contradict
        it beyond `SURE`

    Returns
    -------
    int
        1, -1 or 0
    """
    sign = int(copysign(1.0, z))
    if exact:
        shown = abs(z) >= SURE and not any(sign * part <= -SURE for part in parts)
    else:
        shown = abs(z) >= DECIDED and all(sign * part >= SURE for part in parts)
    if not shown:
        return 0
    return sign


def difference_sign(term: RunEstimate, batches: int) -> int:
    """Return the sign of a measured difference if it is significant, else 0."""
    return decided(
        term.z(), [part.z() for part in without_each_batch(term, batches)], term.is_exact
    )


def noted(*notes: str) -> str:
    """Join the nonempty notes on a verdict."""
    return "; ".join(filter(None, notes))
