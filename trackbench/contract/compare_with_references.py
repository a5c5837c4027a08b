"""Comparison of a filter's errors with those of reference filters: scores, and their limits."""

from dataclasses import fields, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from trackbench.contract.estimates import Estimates, has_constant_covariance, run_filter, simulate
from trackbench.contract.findings import ContractError, LeftOutError
from trackbench.contract.likely_cause import PLACE_IGNORED, SIGMA_FOR_VARIANCE, guess_cause
from trackbench.contract.missing_measurements_check import with_gaps
from trackbench.contract.other_sensors import (
    with_sensors_at_origin,
    with_sigma_as_variance,
)
from trackbench.contract.problems import PLANAR, PRECISE, RADAR, UNEQUAL, ModelDraws
from trackbench.contract.tracks_check import mistaken_track
from trackbench.contract.unwrapped_innovations import name_of_unwrapped
from trackbench.contract.why_not_running import runs_on, why_not
from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array
from trackbench.core.linalg import distance
from trackbench.filters.base import AnyFilter
from trackbench.filters.bootstrap_pf import PF
from trackbench.filters.ekf import EKF
from trackbench.filters.external import External
from trackbench.filters.float32_digits import PRINT_ALL_DIGITS, digits_of, float32_advice
from trackbench.filters.ukf import UKF
from trackbench.models.likelihood import has_own_density
from trackbench.scenarios.base import Scenario, Simulation

_CAP = 10.0  # larger squared errors count as this, in units of their expectation
_CAP_OF_DISTANCE = 2.0  # likewise, of squared distances from the reference, which should be near 0
_MAX_DEVIATION = 6.0  # standard errors of a paired difference
# Limits of the scores of a right filter, relative to a reference's. They leave room for the
# approximations by which right filters differ. A filter is accused if it is beyond the limits of every
# reference by `_MAX_DEVIATION` standard errors.
#
# A simulation has no false accusation in 880 checks, so that their rate is below 0.4 % (95 %). It takes
# the EKF of second order, CKF, IEKF and IPLF on the seven problems of the contract (200 runs), and
# GaussianPF, RPF, APF and EnKF with 1000 particles on four of them (80 runs), each with 20 seeds. KF,
# EKF, UKF and PF are references or equal to one; in 460 checks none was accused.
#
# Beside each limit stands the extreme mean over the runs of a seed. The scalar model stands apart: its
# noise is skewed, so that right filters differ most. Some are beyond a limit there, and only the
# standard errors keep them from being accused.
_DISTANCE_FACTOR = 3.0
"""Times the squared distance of another reference: up to 2.6 times, by the IPLF with a precise radar."""
_DISTANCE_OFFSET = 0.05
"""Squared distance where the references are equal: up to 0.054 by the sampling of 1000 particles."""
_LEAST_SPREAD = 0.9
"""Share of a reference's covariance: at least 0.96; on the scalar model 0.83, by the second order."""
_SCORE_MARGIN = 0.3
"""Largest change of covariance and ANEES, as a share, of a filter that draws; half of it of others.

With 1000 particles the covariance was up to 11 % larger, and the ANEES up to 17 % different; on the
scalar model up to 30 % and 17 %. Of filters that do not draw they differed by less than 1 %; on the
scalar model by up to 17 % and 37 %.
"""
_LIKELIHOOD_MARGIN = 0.1
"""Largest change of the mean log-likelihood, nats, of a filter that draws; half of it of others.

It was up to 0.041 by 1000 particles, and up to 0.007 without random numbers. On the scalar model
particles differ by up to 1.7, by single measurements that are far off.
"""


class Misfit(NamedTuple):
    """Differences of a filter's scores from those of reference filters."""

    text: str
    """the differences, and the likely cause"""
    ignores_place: bool = False
    """True if the cause is that the filter ignores the place of the sensor"""


class Scores(NamedTuple):
    """Means over the scored steps, per run (M,); squares are per component, in units of a covariance."""

    squared_distance: Array
    """squared distance from the reference's mean, in the reference's covariance"""
    spread: Array
    """covariance in units of the reference's"""
    anees: Array
    """squared error in the filter's own covariance"""
    anis: Array | None
    """squared innovation in its covariance, if the filter reports it"""
    log_likelihood: Array | None
    """log-likelihood of the measurements, if the filter reports it"""
    squared_error: Array
    """squared error in the reference's covariance"""


_SCORE_TEXTS = {
    "squared_distance": ("distance from the reference", " of its standard deviations"),
    "spread": ("covariance", " times that of the reference"),
    "anees": ("ANEES", ""),
    "anis": ("ANIS", ""),
    "log_likelihood": ("log likelihood", ""),
}
"""Scores that are tested, as a report names them, and their units."""


def score(
    estimates: Estimates, reference: Estimates, data: Simulation, scenario: Scenario
) -> Scores:
    """Score the estimates of a filter on simulated data, also in comparison with a reference filter.

    ``estimates`` and ``reference`` are those of the two filters from the same ``data``. The steps are
    those that ``scenario`` scores, without the prior.

    Each square, covariance and NIS counts up to a cap, so that a lost run or an estimate that is NaN
    does not outweigh all others. All scores are per component: of the state, or of the measurement for
    NIS and log-likelihood.
    """
    n = len(data.truth)
    n_z = len(data.measurements)
    angle_rows = scenario.angle_rows
    # The window "" has the scored steps. Index 0 of the steps is the prior. If the scenario scores no
    # step after it, all are taken.
    after_prior = scenario.windows[""][1:]
    if not after_prior.any():
        after_prior = np.ones_like(after_prior)
    scored = 1 + np.flatnonzero(after_prior)
    cov = estimates.cov[:, :, scored]
    reference_cov = reference.cov[:, :, scored]

    def mean_square(difference: Array, P: Array, cap: float = _CAP) -> Array:
        """Return the mean over the steps of e' P^-1 e / n, each of at most ``cap``."""
        squared = np.nan_to_num(distance(difference[:, scored], P) / n, nan=cap, posinf=cap)
        return np.minimum(squared, cap).mean(axis=0)

    # Step 1: errors, and distances from the reference.
    error = near(estimates.mean, data.truth, angle_rows) - data.truth
    from_reference = near(estimates.mean, reference.mean, angle_rows) - reference.mean
    # Step 2: covariances, tr(P_reference^-1 P) / n.
    inverse = linalg.inverse(reference_cov)
    spread = np.einsum("ij...,ji...->...", inverse, cov) / n
    # Step 3: NIS and log-likelihood, each divided by the measurement's number of components, only where
    # something is measured.
    is_missing = np.isnan(data.measurements[:, scored - 1]).all(axis=0)
    series = {}
    for name, rows in estimates.series.items():
        series[name] = np.where(is_missing, np.nan, rows[scored - 1] / n_z)
    anis = None
    if "nis" in series:
        anis = np.nanmean(np.minimum(series["nis"], _CAP), axis=0)
    log_likelihood = None
    if "log_likelihood" in series:
        log_likelihood = np.nanmean(series["log_likelihood"], axis=0)
    return Scores(
        squared_distance=mean_square(from_reference, reference_cov, _CAP_OF_DISTANCE),
        spread=np.minimum(spread, _CAP).mean(axis=0),
        anees=mean_square(error, cov),
        anis=anis,
        log_likelihood=log_likelihood,
        squared_error=mean_square(error, reference_cov),
    )


def misfit(
    tracker: AnyFilter,
    scenario: Scenario,
    runs: int,
    seed: int = 1,
    tested_scenario: Scenario | None = None,
) -> Misfit | None:
    """Describe how a filter's scores differ from those of the package's filters; None if they fit.

    All filter the same ``runs`` runs of ``scenario``, which is drawn from the filter's model, with some
    measurements missing. The tested filter is given the model of ``tested_scenario``; default: that of
    ``scenario``, as the others.
    """
    data = with_gaps(simulate(scenario, runs, seed=seed))
    tested = run_filter(tracker, tested_scenario or scenario, data)
    # Step 1: references. UKF and EKF need the moments of a measurement, which some sensors lack. A
    # filter that draws is also compared with a particle filter of as many particles, or of 50.
    sensor = scenario.model.sensor
    has_moments = not (has_own_density(sensor) and sensor.why_no_moments())
    reference_filters: list[AnyFilter] = [UKF(), EKF()] if has_moments else []
    if tested.random or not has_moments:
        particles = tracker.particle_count if tracker.particle_count > 1 else 50
        reference_filters.append(PF(N=particles))
    references = []
    for reference_filter in reference_filters:
        if not why_not(reference_filter, scenario):
            references.append(run_filter(reference_filter, scenario, data))
    if not references:
        return None
    # Step 2: scores of all filters, with distances from the reference that has the least error, the
    # center. To find it, all errors are measured in one covariance, that of the first reference.
    mean_errors = []
    for reference in references:
        scores = score(reference, references[0], data, scenario)
        mean_errors.append(scores.squared_error.mean())
    center = references[int(np.argmin(mean_errors))]
    tested_scores = score(tested, center, data, scenario)
    reference_scores = [score(reference, center, data, scenario) for reference in references]
    # Step 3: differences from all references. The margins by which the scores of a correct filter may
    # differ are those of 1000 particles; half of them for a filter that does not draw random numbers.
    margin = 1.0 if tested.random else 0.5
    texts = []
    differences = {}  # mean score of the filter less that of a reference, by the name of the score
    for name, (title, unit) in _SCORE_TEXTS.items():
        tested_score = getattr(tested_scores, name)
        all_scores = [getattr(scores, name) for scores in reference_scores]
        scores_of_name = [values for values in all_scores if values is not None]
        if tested_score is None or not scores_of_name:
            continue
        # A difference counts beyond the limits of every reference.
        limits = [_limits(name, values, margin) for values in scores_of_name]
        is_above = all(_exceeds(tested_score - high) for _, high in limits)
        is_below = all(_exceeds(low - tested_score) for low, _ in limits)
        if not is_above and not is_below:
            continue
        tested_mean = float(tested_score.mean())
        reference_mean = float(scores_of_name[0].mean())
        # The widest limit of all references.
        if is_above:
            limit = max(float(high.mean()) for _, high in limits)
        else:
            limit = min(float(low.mean()) for low, _ in limits)
        if name == "squared_distance":
            # Report the farthest reference, as one of them is the center itself, at the distance 0.
            tested_mean = np.sqrt(tested_mean)
            reference_mean = np.sqrt(max(float(values.mean()) for values in scores_of_name))
            limit = np.sqrt(limit)
        differences[name] = tested_mean - reference_mean
        texts.append(
            f"{title} {tested_mean:.3g}{unit} (a reference: {reference_mean:.3g}, limit: {limit:.3g})"
        )
    if not texts:
        return None
    # Step 4: the likely cause.
    text = ", ".join(texts)
    if isinstance(tracker, External):
        mean = tested.mean[:, 1:]
        cov = tested.cov[:, :, 1:]
        digits = digits_of(mean, cov)
        if digits.too_few:
            return Misfit(f"{text}; answers have {digits.too_few}: {PRINT_ALL_DIGITS}")
        if digits.is_float32:
            components = scenario.model.motion.components
            advice = float32_advice(mean, cov, components, digits.printed)
            if advice:
                return Misfit(f"{text}; {advice}")
    if "squared_distance" in differences:
        tested_rmse = np.sqrt(tested_scores.squared_error.mean())
        reference_rmse = np.sqrt(reference_scores[0].squared_error.mean())
        # In standard deviations of the reference `center`, as `squared_error` is.
        differences["error"] = tested_rmse - reference_rmse
        if isinstance(scenario, ModelDraws):
            unwrapped_angle = name_of_unwrapped(tracker, scenario, data, tested, center)
            if unwrapped_angle:
                return Misfit(f"{text}; the innovation of {unwrapped_angle} is not wrapped")
    if tested_scenario is None and "squared_distance" in differences:
        # The filter gets the model with the place, and data of sensors at the origin.
        origin = with_sensors_at_origin(scenario)
        if origin is not None and not misfit(tracker, origin, runs, seed, scenario):
            return Misfit(f"{text}; {PLACE_IGNORED}", ignores_place=True)
    if tested_scenario is None:
        # The filter gets the model with sigma^2, and data whose noise has the variance sigma.
        other_noise = with_sigma_as_variance(scenario)
        if other_noise is not None and not misfit(tracker, other_noise, runs, seed, scenario):
            return Misfit(f"{text}; {SIGMA_FOR_VARIANCE}")
    if isinstance(scenario, ModelDraws) and has_constant_covariance(tested):
        return Misfit(
            f"{text}; the covariance is constant: is the start scored, before it holds? "
            "`score: {steps: [K, null]}` of the scenario begins at step K"
        )
    return Misfit(text + guess_cause(tested, center.mean, differences))


def _limits(name: str, reference: Array, margin: float) -> tuple[Array, Array]:
    """Return the least and the largest score of each run (M,) that a correct filter may have.

    ``name`` is that of a score, a field of `Scores`, and ``reference`` (M,) are a reference's scores.
    The limits leave room for the approximations by which correct filters differ. ``margin`` is a factor
    of the limits that depend on the sampling of particles: 1 for a filter that draws random numbers, and
    less for others.
    """
    if name == "squared_distance":
        # No distance is too small: the least is below zero. The largest does not depend on `margin`:
        # correct filters without random numbers are up to as far from the reference as particle filters.
        least = np.full_like(reference, -1.0)
        return least, _DISTANCE_FACTOR * reference + _DISTANCE_OFFSET
    if name == "spread":
        # Sampling makes a covariance larger, hardly smaller.
        return _LEAST_SPREAD * reference, (1.0 + _SCORE_MARGIN * margin) * reference
    if name == "log_likelihood":
        change = _LIKELIHOOD_MARGIN * margin
        return reference - change, reference + change
    # ANEES and ANIS.
    share = _SCORE_MARGIN * margin
    return (1.0 - share) * reference, (1.0 + share) * reference


def _exceeds(excess: Array) -> bool:
    """Test whether the mean of numbers per run (M,) is positive by more than six standard errors."""
    return bool(excess.mean() > _MAX_DEVIATION * excess.std(ddof=1) / np.sqrt(len(excess)))


_RUNS = 200  # on which a filter is compared with reference filters
_LOOPED_RUNS = 80  # of a filter that loops over its runs in Python
_LEAST_N = 1000  # particles with which a particle filter is compared with the package's


@lru_cache(maxsize=8)
def compare_with_references(tracker: AnyFilter, problem: ModelDraws) -> Misfit | None:
    """Describe how a filter's errors and covariances differ from those of reference filters.

    None if they fit. Two checks ask for the comparison on the problem of a config, so it is
    computed once. A plugin or program that was edited is another filter.
    """
    return misfit(tracker, problem, runs_for(tracker))


def runs_for(tracker: AnyFilter) -> int:
    """Return the number of runs on which a filter is compared with reference filters.

    It is smaller if the filter loops over its runs in Python, which takes longer.
    """
    if tracker.loops_over_runs:
        return _LOOPED_RUNS
    return _RUNS


def with_many_particles(tracker: AnyFilter) -> AnyFilter:
    """Return a particle filter with at least `_LEAST_N` particles: chance then hides fewer mistakes.

    Other filters are returned as they are.
    """
    if tracker.particle_count < _LEAST_N and any(f.name == "N" for f in fields(tracker)):
        return replace(tracker, N=_LEAST_N)
    return tracker


def check_consistency(tracker: AnyFilter, scenario: Scenario) -> None:
    """Check errors and covariance against reference filters, on draws from the filter's model.

    In place of the linear problem PLANAR a filter is checked on UNEQUAL, if it runs there. That is
    PLANAR with intervals that differ from step to step, so that a wrong use of dt shows, too.
    """
    if "mode" in run_filter(tracker, scenario, simulate(scenario, runs=2)).series:
        # The reference filters have one motion, that of the model.
        raise LeftOutError("has several motions: it reports the diagnostic `mode`")
    problems = [scenario]
    if scenario is PLANAR:
        problems = [UNEQUAL if runs_on(tracker, UNEQUAL) else PLANAR]
        # PRECISE is an accurate radar far from the jump of the azimuth. A filter that follows a target
        # with it works for radars, and is checked with RADAR too, where the azimuth jumps by 2 pi.
        if runs_on(tracker, PRECISE) and not mistaken_track(tracker, PRECISE):
            problems.append(RADAR)
    precise_tracker = with_many_particles(tracker)
    for problem in problems:
        drawn_problem = problem if isinstance(problem, ModelDraws) else ModelDraws(base=problem)
        difference = compare_with_references(precise_tracker, drawn_problem)
        if difference:
            raise ContractError(difference.text)
