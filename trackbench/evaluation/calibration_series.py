"""Calibration: where the truth is in a filter's posterior.

It has series (T + 1, M) for the filters that a config requests them of (`core.posterior_scores` defines
them for a Gaussian, for particles and for a density):

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

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.posterior_scores import NormalPosterior, Posterior
from trackbench.evaluation.nees import rank_of
from trackbench.evaluation.noncredibility import decibels, noncredibility

Kind = Literal["calibration", "ranks", "crps", "likelihood_ratio"]
"""Requested series: pit, coverage and nci; the tenths of each pit; others by their names."""
LEVELS = (50, 90, 99)
"""Probabilities of the regions, percent."""
TENTHS = 10
_NEES = "nees"


_ROUNDING = 1e-9  # of a sum of weights


def calibration_series(components: Sequence[str], exact: bool) -> list[str]:
    """Name all series that a config can request.

    Parameters
    ----------
    components
        components of the state
    exact
        True if there is a reference with a likelihood

    Returns
    -------
    list of str
        names such as ``pit_px``, ``coverage_90`` (one of `LEVELS`, percent), ``nci`` and ``crps_px``,
        and for each PIT the ten bars of its rank histogram, such as ``rank_px_1``
    """
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
        """Add the posterior of a step, which is compared with the truth.

        Parameters
        ----------
        posterior
            posterior of the filter; None means the Gaussian of its estimate
        estimate
            mean (n_x, M) and covariance (n_x, n_x[, M]) of the truth's components
        truth
            true states (n_x, M), with angles in rad next to those of the mean
        """
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
        """Return the series after the last step.

        The noncredibility index (NCI) of a Gaussian posterior is computed from its NEES.

        Parameters
        ----------
        consistency
            series (T + 1, M) of `ConsistencySeries`

        Returns
        -------
        dict
            requested series (T + 1, M) by name; empty if none is requested
        """
        rows = {name: np.stack(values) for name, values in self._rows.items()}
        pits = {name: row for name, row in rows.items() if name.startswith("pit_")}
        if "calibration" in self._wanted:
            # NCI by the posterior's own log excess, log NEES less the mean that it has if the truth is a
            # draw from the posterior; or by the NEES of a Gaussian, for which it is None.
            n = len(self._components)
            rank = rank_of("nees", consistency, n)
            gaussian = noncredibility(consistency["nees"], n, rank)
            nci = []
            for excess, gaussian_nci in zip(self._log_excess, gaussian, strict=True):
                if excess is None:
                    nci.append(gaussian_nci)
                else:
                    nci.append(decibels(excess))
            rows["nci"] = np.stack(nci)
        # Whoever requests "ranks" requests "calibration", too, which computes the transforms.
        if "ranks" in self._wanted:
            for name, pit in pits.items():
                # Shares (T + 1, TENTHS, M) of each transform in the tenths: a series per bar. `_places`
                # has for each step the number of ranks that a truth can have among the particles.
                pits_of_steps = zip(pit, self._places, strict=True)
                shares = np.stack([in_tenths(of_step, places) for of_step, places in pits_of_steps])
                names = bars(name.removeprefix("pit_"))
                rows |= zip(names, shares.swapaxes(0, 1), strict=True)
        return rows

    def _add_row(self, name: str, row: Array) -> None:
        self._rows.setdefault(name, []).append(row)


def _covered(within: Array, level: float) -> Array:
    """Return 1 for each run (M,) whose truth is in the region of probability ``level``, else 0.

    ``within`` (M,) is the probability of states nearer to the mean than the truth, NaN if it is unknown,
    as is the result then.
    """
    # A sum of weights that is `level` but for rounding counts as within the region.
    return np.where(np.isnan(within), np.nan, within <= level + _ROUNDING)


def in_tenths(pit: Array, places: int = 0) -> Array:
    """Return the share of each probability integral transform in each tenth of (0, 1).

    A rank among particles stands for a place of the width ``1 / places``, which may be in two tenths. So
    each tenth has a tenth of the ranks on average, even if their number is no multiple of ten.

    Parameters
    ----------
    pit
        transforms (M,), NaN where there is none
    places
        number of possible ranks of a transform among particles; 0 for a transform by a density

    Returns
    -------
    array (TENTHS, M)
        shares, which sum to 1 over the tenths; NaN for a NaN
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
