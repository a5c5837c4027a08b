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
``rank_<of>_<b>``     share of ``pit_<of>``'s place that is in the b-th tenth: the rank histogram's bars
``crps_<component>``  continuous ranked probability score
``likelihood_ratio``          likelihood of the measurements so far over the reference's
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Literal

import numpy as np

from trackbench.core.angles import near
from trackbench.core.arrays import Array, as_slice, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import exp, log
from trackbench.core.posterior_scores import (
    NormalPosterior,
    Posterior,
    by_rank,
    distance_in_range,
)
from trackbench.evaluation.validate_output import checked_numbers
from trackbench.filters.base import Filter, State, has_expectations
from trackbench.scenarios.base import Scenario

_ENOUGH = 4096  # runs times steps: a call on so many is worth its price, and they stay in the cache


class ConsistencySeries:
    """Normalized errors squared of the whole state and of its marginals, many steps at a time.

    Estimates and truth are ``mean`` and ``truth`` (n, T, M); a step's mean must be there when its
    covariance is added.
    """

    def __init__(self, scenario: Scenario, mean: Array, truth: Array) -> None:
        self._mean, self._truth, self._angles = mean, truth, scenario.angle_rows
        self._parts = {f"nees_{name}": as_slice(p) for name, p in scenario.marginals.items()}
        self._at_a_time = max(1, _ENOUGH // mean.shape[-1])
        self._waiting: list[Array] = []
        self._scored = 0
        self._series = {name: np.empty(mean.shape[1:]) for name in ("nees", *self._parts)}
        self._unused: dict[str, Array] = {}

    def add(self, cov: Array) -> None:
        """Add the covariance (n, n) or (n, n, M) of the next step, which is copied."""
        self._waiting.append(np.array(cov, dtype=np.float64))
        if len(self._waiting) == self._at_a_time:
            self._reduce_waiting()

    def add_steps(self, cov: Array) -> None:
        """Add the covariances of the next S steps: (n, n, S, M), or (n, n, S, 1) shared by the runs."""
        self._reduce_waiting()
        for first in range(0, cov.shape[2], self._at_a_time):
            self._reduce(cov[:, :, first : first + self._at_a_time].astype(np.float64, order="C"))

    def series(self) -> dict[str, Array]:
        """Return values (T, M) by the name of their series, after the last step."""
        self._reduce_waiting()
        unused = {
            name: np.where(np.isnan(self._series[name.removeprefix("unused_")]), np.nan, number)
            for name, number in self._unused.items()
        }
        return self._series | unused

    def _reduce_waiting(self) -> None:
        if self._waiting:
            self._reduce(side_by_side(self._waiting))
            self._waiting.clear()

    def _reduce(self, cov: Array) -> None:
        # Score S steps in one call: errors (n, S, M).
        part = slice(self._scored, self._scored + cov.shape[2])
        truth = near(self._truth[:, part], self._mean[:, part], self._angles)
        error = self._mean[:, part] - truth
        # Marginals: the part's rows of the error, its rows and columns of the covariance.
        for name, rows in {"nees": slice(None), **self._parts}.items():
            squared, rank = distance_in_range(error[rows], cov[rows][:, rows], truth[rows])
            if rank is not None and not (rank == len(error[rows])).all():
                n = len(error[rows])
                unused = self._unused.setdefault(f"unused_{name}", np.zeros(self._mean.shape[1:]))
                unused[part] = n - rank
                squared = np.where(rank == 0, np.nan, squared * (n / np.maximum(rank, 1)))
            self._series[name][part] = squared
        self._scored = part.stop


def side_by_side(covs: Sequence[Array]) -> Array:
    """Stack the covariances (n, n, S, M) of S steps; (n, n, S, 1) if the runs share all of them."""
    if all(cov.ndim == 2 for cov in covs):
        return np.stack(covs, axis=2)[..., None]
    if any(cov.shape != covs[0].shape for cov in covs):
        covs = [with_trailing(cov, 1, leading=2) for cov in covs]
        # A covariance that the runs of a step share is repeated if another step has one per run.
        widest = max((cov.shape for cov in covs), key=lambda shape: shape[-1])
        covs = [np.broadcast_to(cov, widest) for cov in covs]
    return np.stack(covs, axis=2)


def observed(
    scenario: Scenario, tracker: Filter[State], state: State, truth: Array
) -> dict[str, Array]:
    """Return errors (M,) of the observables at one step by series; truth is (n_x, M)."""
    out: dict[str, Array] = {}
    exact = scenario.observables(truth) if has_expectations(tracker) else {}
    if not exact:
        return out
    expectations = tracker.expectation(state, scenario.observables)
    for name, value in checked_numbers("expectation", expectations, truth.shape[1]).items():
        error = value - exact[name]
        out[f"squared_{name}"], out[f"error_{name}"] = np.square(error), error
    return out


def sizes(scenario: Scenario) -> dict[str, int]:
    """Count the components of each NEES series, by its name; the whole state has no name."""
    parts = {name: len(part) for name, part in scenario.marginals.items()}
    return {"": len(scenario.components)} | parts


Kind = Literal["calibration", "ranks", "crps", "likelihood_ratio"]
"""What is wanted: pit, coverage and nci; with these the tenths; the others by their names."""
LEVELS = (50, 90, 99)
"""Percent of the regions."""
TENTHS = 10
_NEES, _SCORE = "nees", "log_likelihood"
_ROUNDING = 1e-9  # of a sum of weights
_EULER = 0.5772156649015329


def calibration_series(components: Sequence[str], exact: bool) -> list[str]:
    """Name all series on request; ``exact``: with the likelihood of a reference."""
    quantities = (*components, _NEES)
    out = [f"pit_{q}" for q in quantities] + [f"coverage_{p}" for p in LEVELS] + ["nci"]
    out += [f"crps_{c}" for c in components]
    out += chain.from_iterable(map(bars, quantities))
    return out + (["likelihood_ratio"] if exact else [])


def bars(quantity: str) -> list[str]:
    """Name metrics of the share of steps at which a quantity's rank is in each tenth."""
    return [f"rank_{quantity}_{b}" for b in range(1, TENTHS + 1)]


class Calibration:
    """The series of one filter over one block, step by step."""

    def __init__(self, components: Sequence[str], wanted: Sequence[str]) -> None:
        self._components = components
        self._wanted = {"calibration", "ranks", "crps"}.intersection(wanted)
        self.disabled = not self._wanted
        self._rows: dict[str, list[Array]] = {}
        self._places: list[int] = []
        self._excess: list[Array | None] = []

    def add(self, posterior: Posterior | None, estimate: Gaussian, truth: Array) -> None:
        """Add a step's posterior, estimate of the truth's components, and truth (n_x, M)."""
        if self.disabled:
            return
        # A filter without a posterior of its own is judged by the Gaussian of its estimate.
        posterior = posterior or NormalPosterior(estimate)
        if "calibration" in self._wanted:
            # PIT of each component and of the whole state, coverage, log excess for the NCI.
            within = posterior.within(truth)
            self._places.append(posterior.places)
            self._excess.append(posterior.log_excess(truth))
            self._note("pit", self._components, posterior.uniform(posterior.below(truth)))
            self._note("pit", [_NEES], posterior.uniform(within)[None])
            self._note("coverage", map(str, LEVELS), [_covered(within, p / 100.0) for p in LEVELS])
        if "crps" in self._wanted:
            self._note("crps", self._components, posterior.crps(truth))

    def series(self, consistency: Mapping[str, Array]) -> dict[str, Array]:
        """Return values (T + 1, M) by the name of their series, from those of `ConsistencySeries`."""
        rows = {name: np.stack(values) for name, values in self._rows.items()}
        pits = [(name, row) for name, row in rows.items() if name.startswith("pit_")]
        if "calibration" in self._wanted:
            # NCI by the posterior's own log excess, or by the NEES of a Gaussian.
            n = len(self._components)
            rank = rank_of("nees", consistency, n)
            gaussian = noncredibility(consistency["nees"], n, rank)
            steps = zip(self._excess, gaussian, strict=True)
            nci = [row if excess is None else _decibels(excess) for excess, row in steps]
            rows["nci"] = np.stack(nci)
        for name, row in pits if "ranks" in self._wanted else ():
            # Shares (T + 1, TENTHS, M) of each transform in the tenths: a series per bar.
            shares = np.stack([in_tenths(*each) for each in zip(row, self._places, strict=True)])
            rows |= zip(bars(name.removeprefix("pit_")), shares.swapaxes(0, 1), strict=True)
        return rows

    def _note(self, head: str, quantities: Iterable[str], values: Iterable[Array]) -> None:
        for quantity, row in zip(quantities, values, strict=True):
            self._rows.setdefault(f"{head}_{quantity}", []).append(row)


def likelihood_ratio(scores: Mapping[str, Array], exact: Mapping[str, Array]) -> dict[str, Array]:
    """Compare both filters' likelihoods of all measurements so far: their ratio (T + 1, M).

    A particle filter's estimate of the likelihood is unbiased, so that its mean is one (Del Moral 2004,
    section 7.4.2); what weighs or moves particles otherwise is not. Nothing if either has no likelihood.
    """
    if _SCORE not in scores or _SCORE not in exact:
        return {}
    a, b = scores[_SCORE], exact[_SCORE]
    # prod p_a(z_k) / p_b(z_k); a step at which neither has a likelihood counts as 1.
    ratio = exp(np.add.accumulate(np.where(np.isnan(a) & np.isnan(b), 0.0, a - b), axis=0))
    ratio[0] = np.nan
    return {"likelihood_ratio": ratio}


def noncredibility(nees: Array, n: int, rank: Array | None = None) -> Array:
    """Return ``10 log10 NEES`` minus its Gaussian mean; positive means overconfident."""

    def of_rank(squared: Array, r: int) -> Array:
        # psi(r / 2) by psi(1) = -gamma, psi(1 / 2) = -gamma - 2 log 2, psi(x + 1) = psi(x) + 1 / x
        digamma = -_EULER - (2.0 * float(log(2.0)) if r % 2 else 0.0)
        for i in range(r % 2 or 2, r, 2):
            digamma += 2.0 / i
        # E log NEES = log 2 + psi(r / 2) for chi-square of r degrees of freedom
        return _decibels(log(squared * (r / n)) - float(log(2.0)) - digamma)

    return by_rank(of_rank, nees, n, rank)


def rank_of(nees: str, series: Mapping[str, Array], n: int) -> Array | None:
    """Return the degrees of freedom (T, M) of a NEES of n components; None if it has n everywhere."""
    unused = series.get(f"unused_{nees}")
    return None if unused is None else n - unused


def _decibels(log_ratio: Array) -> Array:
    return 10.0 / float(log(10.0)) * log_ratio


def _covered(within: Array, level: float) -> Array:
    return np.where(np.isnan(within), np.nan, within <= level + _ROUNDING)


def in_tenths(pit: Array, places: int = 0) -> Array:
    """Share (TENTHS, M) of each transform (M,) in each tenth; NaN of NaN.

    A rank among so many places has a place ``1 / places`` wide. So each tenth has a tenth of the ranks
    in the mean where their number is no multiple of ten.
    """
    if places:
        # A rank fills its place: its share in a tenth is the part of the place between both edges.
        edges = np.arange(TENTHS + 1)[:, None] * (places / TENTHS)
        below = np.clip(edges - (pit * places - 0.5), 0.0, 1.0)
        return np.round(below[1:] - below[:-1], 9)
    which = np.clip(np.floor(pit * TENTHS), 0, TENTHS - 1)
    return np.where(np.isnan(pit), np.nan, which == np.arange(TENTHS)[:, None])
