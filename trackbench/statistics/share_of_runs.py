"""Shares of runs with an event: their exact intervals, and ``3 of 800 runs lost (0.077 to 1.1 %)``."""

from math import comb, inf
from typing import NamedTuple

from trackbench.statistics.student_t import stderr_of


class Events(NamedTuple):
    """Limits of the share of runs with an event, times a nonnegative factor."""

    events: int
    runs: int
    factor: float = 1.0

    def below(self, z: float) -> float:
        """Return the distance from the share down to its limit at z standard deviations."""
        return self.factor * (self.events / self.runs - self._limits(z)[0])

    def above(self, z: float) -> float:
        """Return the distance from the share up to its limit at z standard deviations."""
        return self.factor * (self._limits(z)[1] - self.events / self.runs)

    def _limits(self, z: float) -> tuple[float, float]:
        """Return both limits of the share at z standard deviations."""
        from scipy.special import ndtr

        return _limits(self.events, self.runs, float(ndtr(-z)))


def share_interval(events: int, runs: int, level: float = 0.95) -> tuple[float, float]:
    """Return the interval of a share of runs (Clopper and Pearson 1934, Biometrika 26, 404)."""
    return _limits(events, runs, 0.5 * (1.0 - level))


def _limits(events: int, runs: int, tail: float) -> tuple[float, float]:
    """Return the least and largest probability of an event that ``events`` of ``runs`` do not exclude.

    ``tail`` is the probability of at least, or at most, so many events at these two limits.
    """
    from scipy.special import betaincinv

    # P(X >= events) = tail at the low end, P(X <= events) = tail at the high end
    low = 0.0
    high = 1.0
    if events > 0:
        low = float(betaincinv(events, runs - events + 1, tail))
    if events < runs:
        high = float(1.0 - betaincinv(runs - events, events + 1, tail))
    return low, high


def share_stderr(events: int, runs: int) -> float:
    """Return the standard error of which a normal 95 % interval is as wide as `share_interval`."""
    return stderr_of(*share_interval(events, runs))


def share_z(events: int, runs: int, probability: float) -> float:
    """Return z of the hypothesis that an event has a probability, from its exact tail probability.

    z exceeds the normal quantile of a level exactly if the `share_interval` of that level excludes the
    probability.

    Parameters
    ----------
    events
        number of runs with the event
    runs
        number of runs
    probability
        hypothetical probability of the event

    Returns
    -------
    float
        z, positive for more events than expected. It is infinite for an impossible outcome: one run
        without the event refutes the probability 1. It is zero if the tail has a probability of more
        than a half
    """
    from scipy.special import bdtr, bdtrc, ndtri

    # No outcome agrees with a probability below 0 or above 1.
    if probability < 0.0:
        return inf
    if not probability <= 1.0:
        return -inf
    # Upper tail P(X >= events) of more events than expected, lower tail P(X <= events) of fewer.
    if events > runs * probability:
        return max(0.0, -float(ndtri(bdtrc(events - 1, runs, probability))))
    return min(0.0, float(ndtri(bdtr(events, runs, probability))))


def share_in_words(events: int, runs: int, noun: str = " runs lost") -> str:
    """Return ``3 of 800 runs lost (0.077 to 1.1 %)``, the number of runs with an event.

    In parentheses stands the 95 % interval of the event's probability.

    Parameters
    ----------
    events
        number of runs with the event
    runs
        number of runs
    noun
        words for what the runs had, which begin with a space; empty for none

    Returns
    -------
    str
        counts and interval
    """
    ends = []
    for end in share_interval(events, runs):
        digits = 3 if end > 0.995 else 2  # 100 %, not 1e+02 %
        ends.append(f"{100 * end:.{digits}g}")
    return f"{events} of {runs}{noun} ({ends[0]} to {ends[1]} %)"


def fisher_exact_p(here: int, runs_here: int, there: int, runs_there: int) -> float:
    """Return the probability of Fisher's exact test that wrong runs are this often here by chance.

    It is the probability that at least ``here`` of all wrong runs are among ``runs_here``.

    Parameters
    ----------
    here, there
        numbers of wrong runs here and elsewhere
    runs_here, runs_there
        numbers of runs here and elsewhere

    Returns
    -------
    float
        one-sided p-value
    """
    wrong = here + there
    ways = [
        comb(runs_here, i) * comb(runs_there, wrong - i)
        for i in range(here, min(wrong, runs_here) + 1)
    ]
    return sum(ways) / comb(runs_here + runs_there, wrong)
