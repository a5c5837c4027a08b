"""Diagnosis of a filter: comparison of its errors with reference filters, and the likely cause."""

from typing import NamedTuple, cast

import numpy as np

from trackbench.contract.problems import Estimates, run_filter, simulate, why_not, with_gaps
from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.linalg import distance
from trackbench.filters.base import AnyFilter
from trackbench.filters.ekf import EKF
from trackbench.filters.particle_filters import PF
from trackbench.filters.ukf import UKF
from trackbench.models.base import LocatingSensor, has_density
from trackbench.scenarios.base import Scenario, Simulation
from trackbench.scenarios.tracking import Tracking

_CAP = 10.0  # on a squared error in units of its expectation: a lost run counts as much, no more
_LOST = 1.9  # of an RMSE above the reference's 1: most squared errors are beyond the cap
_CAP_OF_DISTANCE = 2.0
_MAX_DEVIATION = 6.0  # standard errors of a paired difference


class Scores(NamedTuple):
    """Means over the steps, per run (M,); squares are per component, in units of a covariance."""

    rmse: Array
    """squared distance from the reference's mean"""
    spread: Array
    """covariance in units of the reference's"""
    anees: Array
    anis: Array | None
    log_likelihood: Array | None
    error: Array
    """squared error"""


def score(of: Estimates, reference: Estimates, data: Simulation) -> Scores:
    """Score estimates; distance and error are in the reference's covariance."""
    n, n_z, P = len(data.truth), len(data.measurements), reference.cov[:, :, 1:]
    inverse = linalg.inverse(P)

    def mean_square(e: Array, cov: Array, cap: float = _CAP) -> Array:
        squared = np.nan_to_num(distance(e[:, 1:], cov) / n, nan=cap, posinf=cap)
        return np.minimum(squared, cap).mean(axis=0)

    # Innovations only where something is measured.
    missing = np.isnan(data.measurements).all(axis=0)
    series = {name: np.where(missing, np.nan, rows / n_z) for name, rows in of.series.items()}
    error = of.mean - data.truth
    return Scores(
        mean_square(of.mean - reference.mean, P, _CAP_OF_DISTANCE),
        np.minimum(np.einsum("ij...,ji...->...", inverse, of.cov[:, :, 1:]) / n, _CAP).mean(axis=0),
        mean_square(error, of.cov[:, :, 1:]),
        np.nanmean(np.minimum(series["nis"], _CAP), axis=0) if "nis" in series else None,
        np.nanmean(series["log_likelihood"], axis=0) if "log_likelihood" in series else None,
        mean_square(error, P),
    )


def misfit(tracker: AnyFilter, scenario: Scenario, runs: int, seed: int = 1) -> str:
    """Describe how a filter differs from the package's on a problem drawn from its model."""
    data = with_gaps(simulate(scenario, runs, seed=seed))
    tested, sensor = run_filter(tracker, scenario, data), scenario.model.sensor
    # Step 1: references, with a particle filter of as many particles for a filter that draws.
    gaussian = not (has_density(sensor) and sensor.why_no_moments())
    filters: list[AnyFilter] = [UKF(), EKF()] if gaussian else []
    if tested.random or not gaussian:
        filters.append(PF(N=tracker.particle_count if tracker.particle_count > 1 else 50))
    filters = [f for f in filters if not why_not(f, scenario)]
    others = [run_filter(f, scenario, data) for f in filters]
    if not others:
        return ""
    # Step 2: scores about the reference with the least error.
    center = min(others, key=lambda other: score(other, others[0], data).error.mean())
    of, *bands = (score(one, center, data)._asdict() for one in (tested, *others))
    wide = 1.0 if tested.random else 0.5
    texts, sizes = [], {}
    for name in ("rmse", "spread", "anees", "anis", "log_likelihood"):
        theirs = [band[name] for band in bands if band[name] is not None]
        if of[name] is None or not theirs:
            continue
        # Step 3: a difference counts beyond a margin of every reference.
        limits = [_limits(name, x, wide) for x in theirs]
        over = all(_exceeds(of[name] - high) for _, high in limits)
        under = all(_exceeds(low - of[name]) for low, _ in limits)
        mine, other = float(of[name].mean()), float(theirs[0].mean())
        if name == "rmse":
            mine, other = np.sqrt(of["error"].mean()), np.sqrt(bands[0]["error"].mean())
        if over or under:
            sizes[name] = mine - other
            texts.append(f"{name.upper().replace('_', ' ')} {mine:.3g} (a reference: {other:.3g})")
    return ", ".join(texts) + (_cause(tested, center.mean, sizes) if texts else "")


def _limits(name: str, reference: Array, wide: float) -> tuple[Array, Array]:
    """Bound the scores that an honest filter may have, per run (M,)."""
    if name == "rmse":
        return np.full_like(reference, -1.0), 3.0 * reference + 0.05
    if name == "spread":
        return 0.9 * reference, (1.0 + 0.3 * wide) * reference
    if name == "log_likelihood":
        return reference - 0.1 * wide, reference + 0.1 * wide
    return (1.0 - 0.3 * wide) * reference, (1.0 + 0.3 * wide) * reference


def _exceeds(excess: Array) -> bool:
    """Test whether numbers per run (M,) are positive in the mean, by six standard errors."""
    return bool(excess.mean() > _MAX_DEVIATION * excess.std(ddof=1) / np.sqrt(len(excess)))


def _cause(of: Estimates, path: Array, sizes: dict[str, float]) -> str:
    """Guess the cause of a difference from the path (n, T + 1, M) and of other scores."""
    mean = of.mean[: len(path)]

    def off(other: Array) -> float:
        # The median over the runs: a lost run does not count.
        return float(np.median(np.square(mean - other)[:, 3:].mean(axis=(0, 1))))

    if off(np.roll(path, 1, axis=1)) < 0.1 * off(path):
        return "; estimates fit the truth one step earlier: returned before the update?"
    if len(path) == 4 and off(path[[2, 3, 0, 1]]) < 0.1 * off(path):
        return "; estimates fit the truth with x and y exchanged"
    too_large = sizes.get("spread", -sizes.get("anees", 0.0))
    if sizes.get("rmse", 0.0) > _LOST:
        return "; an axis, a unit (degrees), a sign, dt or a gap is taken wrongly?"
    if too_large > 0.0:
        return "; the covariance is too large: does the update reduce it by the gain, is R sigma^2?"
    if too_large < 0.0:
        return "; the covariance is too small: sigma for sigma^2, or a noise or dt forgotten?"
    return "; are the innovation and S those before the update?" if "rmse" not in sizes else ""


def mistaken_track(tracker: AnyFilter, problem: Tracking) -> str:
    """Describe how estimates miss the path of a fast target; no model is needed for it."""
    data = simulate(problem, 40)
    of, truth, z = run_filter(tracker, problem, data), data.truth, data.measurements
    moved = data._replace(prior=Gaussian(data.prior.mean + 100.0, data.prior.cov))
    if np.array_equal(of.mean[:, 1], run_filter(tracker, problem, moved).mean[:, 1]):
        return "the estimates do not depend on the mean of the prior: is it ignored?"

    def off(x: Array, true: Array = truth) -> float:
        return float(np.sqrt(np.median(np.square(x - true[::2])[:, 3:].mean(axis=(0, 1)))))

    # An honest filter lies between the prediction of the start and the measured positions.
    nothing = data._replace(measurements=np.full_like(z, np.nan))
    predicted = run_filter(EKF(), problem, nothing).mean[::2]
    sensor = cast(LocatingSensor, problem.model.sensor)
    located = [sensor.located(z[:, i], i + 1).mean for i in range(z.shape[1])]
    measured = np.stack([truth[::2, 0], *located], axis=1)
    mean = of.mean[:4:2]
    late = off(mean, np.roll(truth, 1, axis=1)) < 0.3 * off(mean)
    if off(mean) < 1.5 * max(off(predicted), off(measured)) and not late:
        return ""
    text = f"positions are off by {off(mean):.3g} m, those measured by {off(measured):.3g} m"
    return text + _cause(of, truth, {"rmse": np.inf})
