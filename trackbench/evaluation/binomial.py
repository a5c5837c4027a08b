"""Exact tests and intervals of the probability of an event that some of so many runs have had."""


def interval(events: int, runs: int, level: float = 0.95) -> tuple[float, float]:
    """Confidence interval (Clopper and Pearson 1934, Biometrika 26, 404)."""
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - level)
    low = betaincinv(events, runs - events + 1, tail) if events else 0.0
    high = betaincinv(events + 1, runs - events, 1.0 - tail) if events < runs else 1.0
    return float(low), float(high)


def stderr(events: int, runs: int) -> float:
    """Standard error of which a normal interval is as wide as `interval`: of no event, too, not zero."""
    from scipy.special import ndtri

    low, high = interval(events, runs)
    return (high - low) / (2.0 * float(ndtri(0.975)))


def z(events: int, runs: int, probability: float) -> float:
    """Normal deviate of the exact tail of so many events or more, or less; zero if there is no evidence.

    It is beyond the normal quantile of a level where `interval` excludes the probability. Infinite for
    an impossible outcome: an event in all runs is refuted by one without it.
    """
    from scipy.special import bdtr, bdtrc, ndtri

    if not 0.0 <= probability <= 1.0:
        return float("inf") if probability < 0.0 else -float("inf")
    if events > runs * probability:
        return max(0.0, -float(ndtri(bdtrc(events - 1, runs, probability) if events else 1.0)))
    return min(0.0, float(ndtri(bdtr(events, runs, probability))))
