"""Series that need the filter's covariance or its whole posterior: consistency, and observables."""

from collections.abc import Sequence

import numpy as np

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.posterior_scores import distance
from trackbench.evaluation.validate_output import checked_numbers
from trackbench.filters.base import Filter, State, has_expectations
from trackbench.scenarios.base import Scenario

_ENOUGH = 1024  # columns: a call on so many is worth its price


class ConsistencySeries:
    """Normalised errors squared of the whole state and of its marginals, many steps at a time."""

    def __init__(self, scenario: Scenario, runs: int) -> None:
        self._parts = {f"nees_{name}": list(part) for name, part in scenario.marginals.items()}
        self._steps_at_a_time = max(1, _ENOUGH // runs)
        self._waiting: list[tuple[Array, Array, Array]] = []
        self._series: dict[str, list[Array]] = {name: [] for name in ("nees", *self._parts)}

    def add(self, mean: Array, cov: Array, truth: Array) -> None:
        """Add a step's estimate and truth (n_x, M); the covariance is copied."""
        self._waiting.append((mean, np.array(cov, dtype=np.float64), truth))
        if len(self._waiting) == self._steps_at_a_time:
            self._reduce()

    def series(self) -> dict[str, Array]:
        """Return values (T, M) by the name of their series, after the last step."""
        if self._waiting:
            self._reduce()
        return {name: np.concatenate(rows) for name, rows in self._series.items()}

    def _reduce(self) -> None:
        # Stack the waiting steps, (n, S, M), and score them in one call.
        means, covs, truths = zip(*self._waiting, strict=True)
        self._waiting.clear()
        found, truth = _side_by_side(means, covs), np.stack(truths, axis=1)
        self._series["nees"].append(normalised_error(found, truth))
        # Marginals: the part's rows of the mean, its rows and columns of the covariance.
        for name, part in self._parts.items():
            of_part = Gaussian(found.mean[part], found.cov[np.ix_(part, part)])
            self._series[name].append(normalised_error(of_part, truth[part]))


def _side_by_side(means: Sequence[Array], covs: Sequence[Array]) -> Gaussian:
    """Return S estimates (n, M) as one (n, S, M), with covariances (n, n, S, M).

    If all covariances are shared by the runs, the result has (n, n, S, 1), or (n, n) for S = 1.
    """
    mean = np.stack(means, axis=1)
    if all(cov.ndim == 2 for cov in covs):
        return Gaussian(mean, covs[0] if len(covs) == 1 else np.stack(covs, axis=2)[..., None])
    covs = [with_trailing(cov, 1, leading=2) for cov in covs]
    # A covariance that the runs of a step share is repeated if another step has one per run.
    widest = max((cov.shape for cov in covs), key=lambda shape: shape[-1])
    return Gaussian(mean, np.stack([np.broadcast_to(cov, widest) for cov in covs], axis=2))


def observed(
    scenario: Scenario, tracker: Filter[State], state: State, truth: Array
) -> dict[str, Array]:
    """Return errors (M,) of the observables at one step by series; truth is (n_x, M)."""
    out: dict[str, Array] = {}
    exact = scenario.observables(truth) if has_expectations(tracker) else {}
    if not exact:
        return out
    given = tracker.expectation(state, scenario.observables)
    for name, value in checked_numbers("expectation", given, truth.shape[1]).items():
        error = value - exact[name]
        out[f"squared_{name}"], out[f"error_{name}"] = np.square(error), error
    return out


def normalised_error(found: Gaussian, truth: Array) -> Array:
    """Return the normalised estimation error squared (*batch).

    Infinite where the covariance is singular, as a collapsed cloud's is up to rounding.
    """
    return distance(found.mean - truth, found.cov)


def sizes(scenario: Scenario) -> dict[str, int]:
    """Number of components by the name of each NEES series; the whole state has no name."""
    parts = {name: len(part) for name, part in scenario.marginals.items()}
    return {"": len(scenario.components)} | parts
