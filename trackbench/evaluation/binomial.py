"""Clopper-Pearson limits of shares of runs."""

from typing import NamedTuple


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
        from scipy.special import ndtr

        return _limits(self.events, self.runs, float(ndtr(-z)))


def interval(events: int, runs: int, level: float = 0.95) -> tuple[float, float]:
    """Return the confidence interval (Clopper and Pearson 1934, Biometrika 26, 404)."""
    return _limits(events, runs, 0.5 * (1.0 - level))


def _limits(events: int, runs: int, tail: float) -> tuple[float, float]:
    """Return the probabilities at which the tails of so many events have this probability."""
    from scipy.special import betaincinv

    low = betaincinv(events, runs - events + 1, tail) if events else 0.0
    high = 1.0 - betaincinv(runs - events, events + 1, tail) if events < runs else 1.0
    return float(low), float(high)


def stderr(events: int, runs: int) -> float:
    """Return the standard error with which a normal interval is as wide as `interval`."""
    return stderr_of(*interval(events, runs))


def stderr_of(low: float, high: float) -> float:
    """Return the standard error of which a normal 95 % interval is as wide."""
    from scipy.special import ndtri

    return (high - low) / (2.0 * float(ndtri(0.975)))


def z(events: int, runs: int, probability: float) -> float:
    """Return the normal deviate of the exact tail of so many events; zero without evidence.

    It is beyond the normal quantile of a level where `interval` excludes the probability. Infinite for
    an impossible outcome: an event in all runs is refuted by one without it.
    """
    from scipy.special import bdtr, bdtrc, ndtri

    if not 0.0 <= probability <= 1.0:
        return float("inf") if probability < 0.0 else -float("inf")
    if events > runs * probability:
        return max(0.0, -float(ndtri(bdtrc(events - 1, runs, probability) if events else 1.0)))
    return min(0.0, float(ndtri(bdtr(events, runs, probability))))
