"""NEES: normalized errors squared, which need a filter's covariance.

They are those of the whole state and of its marginals. Where a covariance of n components has rank r, as
where a velocity is known exactly, the NEES is n / r times the distance in its range, so that its mean is
n at every step. ``unused_nees`` counts the n - r components without spread.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array, Mask, as_slice
from trackbench.core.covariances_of_steps import stack_covariances
from trackbench.core.indefinite_covariance import is_indefinite
from trackbench.core.singular_nees import component_size, distance_in_range
from trackbench.scenarios.base import Scenario

_AT_ONCE = 4096
"""Runs times steps that one call scores: enough to pay for the call, and they stay in the cache."""


class ConsistencySeries:
    """Normalized errors squared of the whole state and of its marginals, many steps at a time."""

    def __init__(self, scenario: Scenario, mean: Array, truth: Array) -> None:
        """Begin before the first step.

        Parameters
        ----------
        scenario
            scenario, which names the marginals and the angles of the state
        mean
            estimates (n, T + 1, M). The caller writes a step's estimate to it before it adds the step's
            covariance
        truth
            true states (n, T + 1, M)
        """
        self._mean = mean
        self._truth = truth
        self._angles = scenario.angle_rows
        # Rows of the state that each series is computed from.
        self._rows: dict[str, slice | Sequence[int]] = {"nees": slice(None)}
        for name, rows in scenario.marginals.items():
            self._rows[f"nees_{name}"] = as_slice(rows)
        self._steps_per_call = max(1, _AT_ONCE // mean.shape[-1])
        """number of steps whose NEES one call computes"""
        self._waiting_covs: list[Array] = []
        """covariances of the steps that wait for a call"""
        self._scored = 0
        """number of steps scored so far"""
        self._series = {name: np.empty(mean.shape[1:]) for name in self._rows}
        self._unused: dict[str, Array] = {}
        """number (T + 1, M) of components without spread, by series such as ``unused_nees``"""
        self.indefinite: Mask | None = None
        """covariances (T + 1, M) that are not positive definite; None if there is none so far"""
        self.unknown: Mask | None = None
        """covariances (T + 1, M) that are NaN beside a finite mean; None if there is none so far"""

    def add(self, cov: Array) -> None:
        """Add the covariance of the next step.

        The NEES of several steps is computed in one call, for which their covariances wait.

        Parameters
        ----------
        cov
            covariance (n, n) or (n, n, M), which is copied
        """
        self._waiting_covs.append(np.array(cov, dtype=np.float64))
        if len(self._waiting_covs) == self._steps_per_call:
            self._score_waiting()

    def add_steps(self, cov: Array) -> None:
        """Add the covariances of the next steps.

        Parameters
        ----------
        cov
            covariances (n, n, S, M) of S steps, or (n, n, S, 1) shared by the runs
        """
        self._score_waiting()  # those of the steps before come first
        for first in range(0, cov.shape[2], self._steps_per_call):
            some_steps = cov[:, :, first : first + self._steps_per_call]
            self._score(some_steps.astype(np.float64, order="C"))

    def series(self) -> dict[str, Array]:
        """Return values (T + 1, M) by the name of their series, after the last step.

        ``unused_nees`` is the number of components without spread. Such a series exists only if some
        covariance has a component without spread.
        """
        self._score_waiting()  # the last steps, whose covariances wait for others
        series = dict(self._series)
        for name, number in self._unused.items():
            # Without a NEES, as at a step without a truth, the number is NaN, too.
            nees = self._series[name.removeprefix("unused_")]
            series[name] = np.where(np.isnan(nees), np.nan, number)
        return series

    def _score_waiting(self) -> None:
        """Compute the NEES of the steps whose covariances were added one by one and wait."""
        if self._waiting_covs:
            self._score(stack_covariances(self._waiting_covs))
            self._waiting_covs.clear()

    def _score(self, cov: Array) -> None:
        """Compute each NEES of the next S steps, with covariances (n, n, S, M), in one call."""
        steps = slice(self._scored, self._scored + cov.shape[2])
        # Angles of the truth are moved by whole turns next to the estimates.
        truth = near(self._truth[:, steps], self._mean[:, steps], self._angles)
        error = self._mean[:, steps] - truth
        size = component_size(truth, self._mean[:, steps])
        # Marginals: some rows of the error, the same rows and columns of the covariance.
        for name, rows in self._rows.items():
            n = len(error[rows])
            # e' P^+ e, and the number of directions of P with spread. The rank is None if all
            # covariances are positive definite.
            squared, rank = distance_in_range(error[rows], cov[rows][:, rows], size[rows])
            if name == "nees" and np.isnan(squared).any():
                self._mark_unknown(cov, steps)
            # If there is a rank, some covariances are singular or indefinite. The marks of the
            # indefinite ones are those of the whole state: its marginals have none of their own.
            if name == "nees" and rank is not None:
                self._mark_indefinite(cov, steps)
            if rank is not None and not (rank == n).all():
                # A NEES of rank r is stored times n / r, so that its mean is n.
                unused = self._unused.setdefault(f"unused_{name}", np.zeros(self._mean.shape[1:]))
                unused[steps] = n - rank
                squared = np.where(rank == 0, np.nan, squared * (n / np.maximum(rank, 1)))
            self._series[name][steps] = squared
        self._scored = steps.stop

    def _mark_unknown(self, cov: Array, steps: slice) -> None:
        """Mark the covariances (n, n, S, M) with a variance that is NaN, of a component with a mean.

        ``steps`` are their indices. The marks are made in `unknown`.
        """
        marks = np.isnan(linalg.diagonal(cov)) & np.isfinite(self._mean[:, steps])
        if not marks.any():
            return
        if self.unknown is None:
            self.unknown = np.zeros(self._mean.shape[1:], dtype=np.bool_)
        self.unknown[steps] = marks.any(axis=0)

    def _mark_indefinite(self, cov: Array, steps: slice) -> None:
        """Mark the covariances (n, n, S, M) that are not positive definite; ``steps`` are their indices.

        The marks are made in `indefinite`.
        """
        marks = is_indefinite(cov)
        if not marks.any():
            return
        if self.indefinite is None:
            self.indefinite = np.zeros(self._mean.shape[1:], dtype=np.bool_)
        self.indefinite[steps] = marks


def sizes(scenario: Scenario) -> dict[str, int]:
    """Count the components of each NEES by its marginal's name, which is empty for the whole state."""
    counts = {"": len(scenario.components)}
    for name, rows in scenario.marginals.items():
        counts[name] = len(rows)
    return counts


def rank_of(nees: str, series: Mapping[str, Array], n: int) -> Array | None:
    """Return the degrees of freedom of a NEES of n components.

    Parameters
    ----------
    nees
        name of its series
    series
        series (T + 1, M) by name. A series ``unused_nees`` counts the components without spread
    n
        number of components

    Returns
    -------
    array (T + 1, M) or None
        degrees of freedom; None if they are n everywhere
    """
    name = f"unused_{nees}"
    if name not in series:
        return None
    return n - series[name]


def leave_out_unknown(series: Mapping[str, Array], mean: Array, unknown: Mask) -> None:
    """Leave out estimates whose covariance is NaN.

    A run without a covariance at any step but the first, which is that of the prior, is one of a filter
    that estimates the mean alone: its ``series`` get NaN at the first step, too. In another run the
    covariance left the numbers, and so does the ``mean``.

    Parameters
    ----------
    series
        series (T + 1, M) of consistency and calibration by name; they are changed
    mean
        estimates (n, T + 1, M); they are changed
    unknown
        mask (T + 1, M) of the covariances that are NaN beside a finite mean
    """
    estimates_mean_alone = unknown[1:].all(axis=0)
    for rows in series.values():
        rows[0, estimates_mean_alone] = np.nan
    mean[:, unknown & ~estimates_mean_alone] = np.nan


def leave_out_known_start(series: Mapping[str, Array], prior_cov: Array) -> None:
    """Set the first step of each series (T + 1, M) to NaN if the first state is known exactly.

    Its error then has no distribution. ``prior_cov`` is the covariance of the prior.
    """
    if prior_cov.any():
        return
    for rows in series.values():
        rows[0] = np.nan
