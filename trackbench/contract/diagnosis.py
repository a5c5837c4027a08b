"""Diagnosis of a filter: comparison of its errors with reference filters, and the likely cause."""

from typing import NamedTuple, cast

import numpy as np

from trackbench.contract.angles import deviation, name_of_unwrapped
from trackbench.contract.problems import (
    Estimates,
    ModelDraws,
    run_filter,
    simulate,
    why_not,
    with_gaps,
)
from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.linalg import distance
from trackbench.filters.base import AnyFilter
from trackbench.filters.ekf import EKF
from trackbench.filters.external import PRINT_ALL_DIGITS, External, few_digits
from trackbench.filters.particle_filters import PF
from trackbench.filters.ukf import UKF
from trackbench.models.base import LocatingSensor, has_density
from trackbench.scenarios.base import Scenario, Simulation
from trackbench.scenarios.tracking import Tracking

_CAP = 10.0  # on a squared error in units of its expectation: a lost run counts as much, no more
_LOST = 1.9  # of an RMSE above the reference's 1: most squared errors are beyond the cap
_CAP_OF_DISTANCE = 2.0
_FAR = 3.0  # standard deviations from a reference: of a run that a cause has to explain
_MAX_DEVIATION = 6.0  # standard errors of a paired difference


class Scores(NamedTuple):
    """Means over the steps, per run (M,); squares are per component, in units of a covariance."""

    squared_distance: Array
    """from the reference's mean, in the reference's covariance"""
    spread: Array
    """covariance in units of the reference's"""
    anees: Array
    anis: Array | None
    log_likelihood: Array | None
    squared_error: Array
    """in the reference's covariance"""


_SCORE_TEXTS = {
    "squared_distance": "RMSE FROM THE REFERENCE",
    "spread": "SPREAD",
    "anees": "ANEES",
    "anis": "ANIS",
    "log_likelihood": "LOG LIKELIHOOD",
}
"""Scores that are tested, as a report names them."""


def score(
    of: Estimates, reference: Estimates, data: Simulation, angle_rows: tuple[int, ...] = ()
) -> Scores:
    """Score estimates; ``angle_rows`` of a state are equal after whole turns."""
    n, n_z, P = len(data.truth), len(data.measurements), reference.cov[:, :, 1:]
    inverse = linalg.inverse(P)

    def mean_square(e: Array, cov: Array, cap: float = _CAP) -> Array:
        squared = np.nan_to_num(distance(e[:, 1:], cov) / n, nan=cap, posinf=cap)
        return np.minimum(squared, cap).mean(axis=0)

    # Innovations only where something is measured.
    missing = np.isnan(data.measurements).all(axis=0)
    series = {name: np.where(missing, np.nan, rows / n_z) for name, rows in of.series.items()}
    error = near(of.mean, data.truth, angle_rows) - data.truth
    from_reference = near(of.mean, reference.mean, angle_rows) - reference.mean
    ratio = np.einsum("ij...,ji...->...", inverse, of.cov[:, :, 1:]) / n
    anis = log_likelihood = None
    if "nis" in series:
        anis = np.nanmean(np.minimum(series["nis"], _CAP), axis=0)
    if "log_likelihood" in series:
        log_likelihood = np.nanmean(series["log_likelihood"], axis=0)
    return Scores(
        squared_distance=mean_square(from_reference, P, _CAP_OF_DISTANCE),
        spread=np.minimum(ratio, _CAP).mean(axis=0),
        anees=mean_square(error, of.cov[:, :, 1:]),
        anis=anis,
        log_likelihood=log_likelihood,
        squared_error=mean_square(error, P),
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
    rows = scenario.angle_rows
    mean_errors = [score(one, others[0], data, rows).squared_error.mean() for one in others]
    center = others[int(np.argmin(mean_errors))]
    of, *bands = (score(one, center, data, rows)._asdict() for one in (tested, *others))
    wide = 1.0 if tested.random else 0.5
    texts, sizes = [], {}
    for name, title in _SCORE_TEXTS.items():
        theirs = [band[name] for band in bands if band[name] is not None]
        if of[name] is None or not theirs:
            continue
        # Step 3: a difference counts beyond a margin of every reference.
        limits = [_limits(name, x, wide) for x in theirs]
        over = all(_exceeds(of[name] - high) for _, high in limits)
        under = all(_exceeds(low - of[name]) for low, _ in limits)
        mine, other = float(of[name].mean()), float(theirs[0].mean())
        if name == "squared_distance":
            # The farthest reference: one of them is the center, at no distance.
            mine = np.sqrt(mine)
            other = np.sqrt(max(float(band.mean()) for band in theirs))
        if over or under:
            sizes[name] = mine - other
            texts.append(f"{title} {mine:.3g} (a reference: {other:.3g})")
    if not texts:
        return ""
    # Step 4: the likely cause.
    if isinstance(tracker, External):
        numbers = np.concatenate([tested.mean[:, 1:].ravel(), tested.cov[:, :, 1:].ravel()])
        if digits := few_digits(numbers):
            return f"{', '.join(texts)}; answers have {digits}: {PRINT_ALL_DIGITS}"
    if "squared_distance" in sizes:
        error, of_reference = (np.sqrt(one["squared_error"].mean()) for one in (of, bands[0]))
        sizes["error"] = error - of_reference
        if isinstance(scenario, ModelDraws):
            wrong = deviation(tested, center, rows) > _FAR
            unwrapped = name_of_unwrapped(tracker, scenario, data, center, wrong)
            if unwrapped:
                return f"{', '.join(texts)}; the innovation of {unwrapped} is not wrapped"
    return ", ".join(texts) + _cause(tested, center.mean, sizes)


def _limits(name: str, reference: Array, wide: float) -> tuple[Array, Array]:
    """Bound the scores that an honest filter may have, per run (M,)."""
    if name == "squared_distance":
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
    if sizes.get("error", 0.0) > _LOST:
        return "; an axis, a unit (degrees), a sign, dt or a gap is taken wrongly?"
    if too_large > 0.0:
        return "; the covariance is too large: does the update reduce it by the gain, is R sigma^2?"
    if too_large < 0.0:
        return "; the covariance is too small: sigma for sigma^2, or a noise or dt forgotten?"
    if "squared_distance" in sizes:
        return ""
    return "; are the innovation and S those before the update?"


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
    return text + _cause(of, truth, {"squared_distance": np.inf, "error": np.inf})
