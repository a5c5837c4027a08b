"""Rules of verdicts on a paper's claims."""

from collections.abc import Sequence
from math import inf, isnan, log

from trackbench.statistics.verdict_rules import (
    ANOTHER_SEED,
    DECIDED,
    SURE,
    UNDECIDED,
    Verdict,
    decided,
)


def claim_verdict(
    z: float,
    parts: Sequence[float] = (),
    stressed: Sequence[float] = (),
    equal: bool = False,
    exact: bool = False,
) -> Verdict:
    """Return the verdict on a claim from the z in its favor.

    z of all runs must exceed `DECIDED` (5), and the parts `SURE` (3). There are two exceptions, in which
    z of all runs must exceed only `SURE`, and the parts may not contradict it:

    - An ``equal`` claim, one of an equality, that holds. Its z is that of an equivalence test.
    - An ``exact`` test, as of a share of runs. Skewed errors, for which `DECIDED` leaves room, cannot
      spoil it.

    Parameters
    ----------
    z
        z of all runs; positive in favor of the claim
    parts
        z without each batch of runs
    stressed
        z with few runs changed (`with_few_runs_changed`)
    equal
        True for a claim of an equality
    exact
        True if nothing of the test is estimated

    Returns
    -------
    Verdict
        ``holds``, ``fails`` or `UNDECIDED`, and whether another seed or a few runs could change it
    """

    def is_shown_beyond_sure(z: float) -> bool:
        # An equality that fails is a difference, for which `DECIDED` is needed.
        return exact or (equal and z > 0.0)

    # Compare the sign with those that another seed, or few runs changed, could well have shown.
    sign_of_all = decided(z, (), is_shown_beyond_sure(z))
    turns = False
    for other in (z - ANOTHER_SEED, z + ANOTHER_SEED, *stressed):
        if decided(other, (), is_shown_beyond_sure(other)) != sign_of_all:
            turns = True
    sign = decided(z, parts, is_shown_beyond_sure(z))
    word = {1: "holds", -1: "fails", 0: UNDECIDED}[sign]
    return Verdict(
        word=word,
        z=z,
        parts=tuple(parts),
        fragile=turns and word != UNDECIDED,
        needed=SURE if is_shown_beyond_sure(z) else DECIDED,
    )


def weakest(zs: Sequence[float]) -> float:
    """Return the least z of comparisons that must all hold.

    A claim that holds needs no correction for their number, since each has to be shown (an
    intersection-union test; Berger 1982, Technometrics 24, 295). A claim fails if one of them fails,
    which happens by chance the more often the more there are. So a negative z has Bonferroni's
    correction.

    Parameters
    ----------
    zs
        z in favor of a claim, one for each step and filter that it is about

    Returns
    -------
    float
        least z, corrected if it is negative; NaN if one of them is NaN
    """
    from scipy.special import log_ndtr, ndtri_exp

    least = min(zs, key=lambda z: -inf if isnan(z) else z)
    if len(zs) == 1 or not least < 0.0:
        return least
    # Bonferroni: the least tail probability times the number of comparisons, 1/2 at most, back to z.
    return float(ndtri_exp(min(log_ndtr(least) + log(len(zs)), log(0.5))))
