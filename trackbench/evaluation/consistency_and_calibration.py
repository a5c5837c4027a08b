"""Consistency and calibration: series that need a filter's covariance or its whole posterior.

Consistency is the NEES of the whole state and of its marginals. Where a covariance of n components has
rank r, as where a velocity is known exactly, the NEES is n / r times the distance in its range, so that
its mean is n at every step. ``unused_nees`` counts the n - r components without spread.

Calibration says where the truth is in the posterior: series (T + 1, M), for the filters that a config
requests them of (`core.posterior_scores` defines them for a Gaussian, for particles and for a density):

``pit_<component>``   probability below the truth, uniform on (0, 1) if calibrated; of particles the rank
``pit_nees``          probability of states nearer to the mean than the truth, in Mahalanobis distance:
                      for a Gaussian the chi-square distribution function of the NEES
``coverage_<p>``      1 if the truth is within that region of p percent, else 0
``nci``               log NEES less its mean if calibrated, dB (Li, Zhao & Jilkov 2002, eqs. 4, 6)
``rank_<q>_<b>``      share of ``pit_<q>``'s place that is in the b-th tenth: the rank histogram's bars
``crps_<component>``  continuous ranked probability score
``likelihood_ratio``          likelihood of the measurements so far over the reference's
"""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from trackbench.core import indefinite_covariance
from trackbench.core.angles import near
from trackbench.core.arrays import Array, Mask, as_slice, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import exp, log
from trackbench.core.nees import by_rank, distance_in_range
from trackbench.core.posterior_scores import NormalPosterior, Posterior
from trackbench.evaluation.lost_runs import NOT_LOST
from trackbench.evaluation.validate_output import checked_numbers
from trackbench.filters.base import Filter, State, has_expectations
from trackbench.metrics import FIRST_INDEFINITE
from trackbench.scenarios.base import Scenario

_AT_ONCE = 4096
"""Runs times steps that one call scores: enough to pay for the call, and they stay in the cache."""


class ConsistencySeries:
    """Normalized errors squared of the whole state and of its marginals, many steps at a time."""

    def __init__(self, scenario: Scenario, mean: Array, truth: Array) -> None:
        """Begin before the first step.

        Estimates and truth are ``mean`` and ``truth`` (n, T, M). The caller writes a step's estimate to
        ``mean`` before it adds the step's covariance.
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
        self.indefinite: Mask | None = None
        """covariances (T, M) that are not positive definite; None if there is none so far"""

    def add(self, cov: Array) -> None:
        """Add the covariance (n, n) or (n, n, M) of the next step, which is copied.

        The NEES of several steps is computed in one call, for which their covariances wait.
        """
        self._waiting_covs.append(np.array(cov, dtype=np.float64))
        if len(self._waiting_covs) == self._steps_per_call:
            self._score_waiting()

    def add_steps(self, cov: Array) -> None:
        """Add the covariances of the next S steps: (n, n, S, M), or (n, n, S, 1) shared by the runs."""
        self._score_waiting()  # those of the steps before come first
        for first in range(0, cov.shape[2], self._steps_per_call):
            some_steps = cov[:, :, first : first + self._steps_per_call]
            self._score(some_steps.astype(np.float64, order="C"))

    def series(self) -> dict[str, Array]:
        """Return values (T, M) by the name of their series, after the last step.

        ``unused_nees`` is the number of components without spread. Such a series exists only if a
        covariance has any.
        """
        self._score_waiting()
        series = dict(self._series)
        for name, number in self._unused.items():
            # Without a NEES, as at a step without a truth, the number is NaN, too.
            nees = self._series[name.removeprefix("unused_")]
            series[name] = np.where(np.isnan(nees), np.nan, number)
        return series

    def _score_waiting(self) -> None:
        """Compute the NEES of the steps whose covariances were added one by one and wait."""
        if self._waiting_covs:
            self._score(side_by_side(self._waiting_covs))
            self._waiting_covs.clear()

    def _score(self, cov: Array) -> None:
        """Compute each NEES of the next S steps, with covariances (n, n, S, M), in one call."""
        steps = slice(self._scored, self._scored + cov.shape[2])
        # Angles of the truth are moved by whole turns next to the estimates.
        truth = near(self._truth[:, steps], self._mean[:, steps], self._angles)
        error = self._mean[:, steps] - truth
        # Marginals: some rows of the error, the same rows and columns of the covariance.
        for name, rows in self._rows.items():
            n = len(error[rows])
            squared, rank = distance_in_range(error[rows], cov[rows][:, rows], truth[rows])
            if name == "nees" and rank is not None:
                self._mark_indefinite(cov, steps)
            if rank is not None and not (rank == n).all():
                # A NEES of rank r is stored times n / r, so that its mean is n.
                unused = self._unused.setdefault(f"unused_{name}", np.zeros(self._mean.shape[1:]))
                unused[steps] = n - rank
                squared = np.where(rank == 0, np.nan, squared * (n / np.maximum(rank, 1)))
            self._series[name][steps] = squared
        self._scored = steps.stop

    def _mark_indefinite(self, cov: Array, steps: slice) -> None:
        """Mark the covariances (n, n, S, M) that are not positive definite; ``steps`` are their indices.

        The marks are made in `indefinite`.
        """
        marks = indefinite_covariance.is_indefinite(cov)
        if not marks.any():
            return
        if self.indefinite is None:
            self.indefinite = np.zeros(self._mean.shape[1:], dtype=np.bool_)
        self.indefinite[steps] = marks


def side_by_side(covs: Sequence[Array]) -> Array:
    """Stack the covariances, (n, n) or (n, n, M) each, of S steps to one array (n, n, S, M).

    The array is (n, n, S, 1) if the runs of every step share one covariance.
    """
    if all(cov.ndim == 2 for cov in covs):
        return np.stack(covs, axis=2)[..., None]
    if any(cov.shape != covs[0].shape for cov in covs):
        covs = [with_trailing(cov, 1, leading=2) for cov in covs]
        # A covariance that the runs of a step share is repeated if another step has one per run.
        widest = max((cov.shape for cov in covs), key=lambda shape: shape[-1])
        covs = [np.broadcast_to(cov, widest) for cov in covs]
    return np.stack(covs, axis=2)


def observable_errors(
    scenario: Scenario, tracker: Filter[State], state: State, truth: Array
) -> dict[str, Array]:
    """Return the squared and signed errors (M,) of the scenario's observables at one step, by series.

    Observables are functions of the state that the scenario names. The filter's expectation of each,
    from its ``state``, is compared with the value at the ``truth`` (n_x, M). The result is empty if the
    filter computes no expectations, or the scenario names no observables.
    """
    if not has_expectations(tracker):
        return {}
    exact = scenario.observables(truth)
    if not exact:
        return {}
    expectations = tracker.expectation(state, scenario.observables)
    errors: dict[str, Array] = {}
    for name, value in checked_numbers("expectation", expectations, truth.shape[1]).items():
        error = value - exact[name]
        errors[f"squared_{name}"] = np.square(error)
        errors[f"error_{name}"] = error
    return errors


def sizes(scenario: Scenario) -> dict[str, int]:
    """Count the components of each NEES by its marginal's name, which is empty for the whole state."""
    counts = {"": len(scenario.components)}
    for name, rows in scenario.marginals.items():
        counts[name] = len(rows)
    return counts


Kind = Literal["calibration", "ranks", "crps", "likelihood_ratio"]
"""Requested series: pit, coverage and nci; the tenths of each pit; others by their names."""
LEVELS = (50, 90, 99)
"""Probabilities of the regions, percent."""
TENTHS = 10
_NEES = "nees"
_SCORE = "log_likelihood"
_ROUNDING = 1e-9  # of a sum of weights
_EULER = 0.5772156649015329


def calibration_series(components: Sequence[str], exact: bool) -> list[str]:
    """Name all series that a config can request; ``exact`` if there is a reference with a likelihood."""
    quantities = (*components, _NEES)
    names = [f"pit_{quantity}" for quantity in quantities]
    names += [f"coverage_{percent}" for percent in LEVELS]
    names.append("nci")
    names += [f"crps_{component}" for component in components]
    for quantity in quantities:
        names += bars(quantity)
    if exact:
        names.append("likelihood_ratio")
    return names


def bars(quantity: str) -> list[str]:
    """Name the bars of a rank histogram: shares of steps at which a quantity's PIT is in each tenth."""
    return [f"rank_{quantity}_{b}" for b in range(1, TENTHS + 1)]


class Calibration:
    """Calibration series of one filter over one block, computed step by step.

    ``components`` are those of the truth, ``wanted`` the requested `Kind` of series.
    """

    def __init__(self, components: Sequence[str], wanted: Sequence[str]) -> None:
        """Begin before the first step.

        ``wanted`` are all requested kinds of a task. Those that are not computed here are left out.
        """
        self._components = components
        self._wanted = {"calibration", "ranks", "crps"}.intersection(wanted)
        self.disabled = not self._wanted
        # By series: the values (M,) of each step.
        self._rows: dict[str, list[Array]] = {}
        # By step: the number of ranks that a truth can have among the particles, 0 for a density.
        self._places: list[int] = []
        # By step: log NEES (M,) less the mean that it has if the truth is a draw from the posterior, for
        # the NCI. It is None for a Gaussian, whose NCI `series` computes from the NEES.
        self._log_excess: list[Array | None] = []

    def add(self, posterior: Posterior | None, estimate: Gaussian, truth: Array) -> None:
        """Add the posterior, the estimate of the truth's components and the truth (n_x, M) of a step."""
        if self.disabled:
            return
        # A filter without a posterior of its own is judged by the Gaussian of its estimate.
        posterior = posterior or NormalPosterior(estimate)
        if "calibration" in self._wanted:
            # Probability of states nearer to the mean than the truth.
            within = posterior.within(truth)
            # Number of ranks that a truth can have among the particles; 0 for a density.
            self._places.append(posterior.places)
            # log NEES less its mean, for the NCI; None for a Gaussian, whose NCI follows from the NEES.
            self._log_excess.append(posterior.log_excess(truth))
            # Transforms of the components and of `within`: they are uniform if the filter is calibrated.
            pits = posterior.uniform(posterior.below(truth))
            for component, pit in zip(self._components, pits, strict=True):
                self._add_row(f"pit_{component}", pit)
            self._add_row(f"pit_{_NEES}", posterior.uniform(within))
            for percent in LEVELS:
                self._add_row(f"coverage_{percent}", _covered(within, percent / 100.0))
        if "crps" in self._wanted:
            scores = posterior.crps(truth)
            for component, score in zip(self._components, scores, strict=True):
                self._add_row(f"crps_{component}", score)

    def series(self, consistency: Mapping[str, Array]) -> dict[str, Array]:
        """Return values (T + 1, M) by the name of their series.

        ``consistency`` are the series of `ConsistencySeries`. The noncredibility index (NCI) of a
        Gaussian posterior is computed from their NEES.
        """
        rows = {name: np.stack(values) for name, values in self._rows.items()}
        pits = {name: row for name, row in rows.items() if name.startswith("pit_")}
        if "calibration" in self._wanted:
            # NCI by the posterior's own log excess, or by the NEES of a Gaussian.
            n = len(self._components)
            rank = rank_of("nees", consistency, n)
            gaussian = noncredibility(consistency["nees"], n, rank)
            nci = []
            for excess, gaussian_nci in zip(self._log_excess, gaussian, strict=True):
                if excess is None:
                    nci.append(gaussian_nci)
                else:
                    nci.append(_decibels(excess))
            rows["nci"] = np.stack(nci)
        # Whoever requests "ranks" requests "calibration", too, which computes the transforms.
        if "ranks" in self._wanted:
            for name, pit in pits.items():
                # Shares (T + 1, TENTHS, M) of each transform in the tenths: a series per bar.
                pits_of_steps = zip(pit, self._places, strict=True)
                shares = np.stack([in_tenths(of_step, places) for of_step, places in pits_of_steps])
                names = bars(name.removeprefix("pit_"))
                rows |= zip(names, shares.swapaxes(0, 1), strict=True)
        return rows

    def _add_row(self, name: str, row: Array) -> None:
        self._rows.setdefault(name, []).append(row)


def likelihood_ratio(scores: Mapping[str, Array], exact: Mapping[str, Array]) -> dict[str, Array]:
    """Return the ratio (T + 1, M) of the likelihoods of all measurements so far: filter to reference.

    ``scores`` and ``exact`` are the predictive series of the filter and of the reference. A particle
    filter's estimate of the likelihood is unbiased, so that the mean of the ratio is one (Del Moral
    2004, section 7.4.2). Filters that weigh or move particles in another way are biased. The result is
    empty unless both have a likelihood.
    """
    if _SCORE not in scores or _SCORE not in exact:
        return {}
    log_p = scores[_SCORE]
    log_p_exact = exact[_SCORE]
    # prod p(z_k) / p_exact(z_k); a step at which neither has a likelihood counts as 1.
    neither = np.isnan(log_p) & np.isnan(log_p_exact)
    log_ratio = np.add.accumulate(np.where(neither, 0.0, log_p - log_p_exact), axis=0)
    ratio = exp(log_ratio)
    ratio[0] = np.nan  # the first state has no measurement
    return {"likelihood_ratio": ratio}


def noncredibility(nees: Array, n: int, rank: Array | None = None) -> Array:
    """Return ``10 log10 NEES`` minus its mean for a Gaussian posterior; positive means overconfident.

    ``nees`` (T, M) is of states of n components. ``rank`` (T, M) is the rank of their covariances; None
    if it is n everywhere. The result is in dB.
    """

    def noncredibility_of_rank(squared: Array, r: int) -> Array:
        """Return the noncredibility, dB, of each NEES of rank r."""
        # A NEES of rank r is stored times n / r: squared * (r / n) is chi-square of r degrees.
        # psi(r / 2) by psi(1) = -gamma, psi(1 / 2) = -gamma - 2 log 2, psi(x + 1) = psi(x) + 1 / x
        digamma = -_EULER
        first = 2
        if r % 2 == 1:
            digamma = -_EULER - 2.0 * float(log(2.0))
            first = 1
        for i in range(first, r, 2):
            digamma += 2.0 / i
        # E log NEES = log 2 + psi(r / 2) for chi-square of r degrees of freedom
        return _decibels(log(squared * (r / n)) - float(log(2.0)) - digamma)

    return by_rank(noncredibility_of_rank, nees, n, rank)


def rank_of(nees: str, series: Mapping[str, Array], n: int) -> Array | None:
    """Return the degrees of freedom (T, M) of a NEES of n components; None if it has n everywhere.

    ``nees`` is the name of its series. A series ``unused_nees`` counts the components without spread.
    """
    name = f"unused_{nees}"
    if name not in series:
        return None
    return n - series[name]


def _decibels(log_ratio: Array) -> Array:
    return 10.0 / float(log(10.0)) * log_ratio


def _covered(within: Array, level: float) -> Array:
    """Return 1 for each run (M,) whose truth is in the region of probability ``level``, else 0.

    ``within`` (M,) is the probability of states nearer to the mean than the truth, NaN if it is unknown,
    as is the result then.
    """
    # A sum of weights that is `level` but for rounding counts as within the region.
    return np.where(np.isnan(within), np.nan, within <= level + _ROUNDING)


def in_tenths(pit: Array, places: int = 0) -> Array:
    """Return the share (TENTHS, M) of each probability integral transform (M,) in each tenth of (0, 1).

    ``places`` is the number of possible ranks of a transform among particles, and 0 for a transform by
    a density. Each rank stands for a place of the width ``1 / places``, which may be in two tenths. So
    each tenth has a tenth of the ranks on average, even if their number is no multiple of ten. A NaN
    has the shares NaN.
    """
    if places:
        # A rank r has the transform (r + 0.5) / places, and fills its place from r to r + 1. Its share
        # in a tenth is the part of the place between both edges.
        edges = np.arange(TENTHS + 1)[:, None] * (places / TENTHS)
        rank = pit * places - 0.5
        below = np.clip(edges - rank, 0.0, 1.0)
        return np.round(below[1:] - below[:-1], 9)  # without rounding errors
    tenth = np.clip(np.floor(pit * TENTHS), 0, TENTHS - 1)
    return np.where(np.isnan(pit), np.nan, tenth == np.arange(TENTHS)[:, None])


def first_indefinite_steps(scenario: Scenario, indefinite: Mask, lost: Array) -> dict[str, Array]:
    """Return the number of the first step (M,) of each run whose covariance is not positive definite.

    The result is a metric per run by its name: NaN for a run without such a step, and for a lost run. It
    is empty unless a run has such a step. ``indefinite`` (T + 1, M) marks the covariances. ``lost`` (M,)
    is `NOT_LOST` or the code of the reason why a run is lost.
    """
    marked = indefinite.any(axis=0) & (lost == NOT_LOST)
    if not marked.any():
        return {}
    first = np.asarray(scenario.steps)[indefinite.argmax(axis=0)]
    return {FIRST_INDEFINITE: np.where(marked, first, np.nan)}
