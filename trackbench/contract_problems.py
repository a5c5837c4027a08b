"""Problems of the contract, and comparison of a filter with reference filters on them.

Truth and measurements are draws from the model that the filter gets. So a filter with this model has
errors of the size that its covariance states, and a filter of the package is as good as it can be.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.random import SFC64, Generator

from trackbench.config.checks import has
from trackbench.core import linalg
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Gaussian, per_run_moments
from trackbench.core.linalg import distance
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.filters.base import AnyFilter
from trackbench.filters.ekf import EKF
from trackbench.filters.particle_filters import PF
from trackbench.filters.ukf import UKF
from trackbench.models.base import LocatingSensor, Model, Motion, extra_std, has_density
from trackbench.models.motions.irregular import Irregular
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.models.priors import augment_prior
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.plugins.checks import filter_conflicts
from trackbench.plugins.errors import guarded
from trackbench.scenarios.base import Scenario, Simulation, simulate_markov
from trackbench.scenarios.starts.without_scans import GaussianStart
from trackbench.scenarios.targets.base import Launch
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.tracking import Tracking

_MOST_STEPS = 30
_CAP = 10.0  # on a squared error in units of its expectation: a lost run counts as much, no more
_CAP_OF_DISTANCE = 2.0
_MAX_DEVIATION = 6.0  # standard errors of a paired difference
_INTERVALS = (1.0, 0.5, 1.5, 0.25, 1.0, 2.0, 0.5, 1.25)  # in units of T, again and again


@dataclass(frozen=True, kw_only=True)
class ModelDraws(Scenario):
    """First steps of a scenario, with the truth drawn from the prior and the model of the filters."""

    base: Scenario
    unequal: bool = False
    """whether the intervals differ from step to step; default: the scenario's intervals"""

    @cached_property
    def model(self) -> Model:
        """Return the model that filters get."""
        motion, sensor = self.base.model
        if not self.unequal:
            return Model(motion, sensor)
        base = cast(Tracking, self.base)
        drive = cast(Motion, base.assume.motion or base.target.own_motion)
        first = int(self.steps[1])
        return Model(Irregular(drive, base.target.axes, first, np.diff(self.times)), sensor)

    @property
    def steps(self) -> Index:
        """Return the first steps."""
        return self.base.steps[: _MOST_STEPS + 1]

    @property
    def times(self) -> Array:
        """Return the times of the first steps, s."""
        if self.unequal:
            intervals = cast(Tracking, self.base).T * np.resize(_INTERVALS, len(self.steps) - 1)
            return np.concatenate([[0.0], np.cumsum(intervals)])
        return self.base.times[: _MOST_STEPS + 1]

    @property
    def windows(self) -> dict[str, Mask]:
        """Return one window of all steps."""
        return {"": np.ones(len(self.steps), dtype=bool)}

    @property
    def prior_type(self) -> type:
        """Return the class of the scenario's prior."""
        return self.base.prior_type

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Return the scenario's error vectors."""
        return self.base.errors(mean, truth)

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Draw the first state from the prior, then truth and measurements from the model."""
        data = self.base.simulate(rng, runs)
        prior = self.base.assumed_prior(runs) or data.prior
        if len(self.components) > len(prior.mean):
            prior = augment_prior(prior, extra_std(self.model.motion))
        truth, z = simulate_markov(self.model, prior.sample(rng), self.steps, rng)
        # Measurements are missing where the scenario's are.
        z[np.isnan(data.measurements[:, : z.shape[1]])] = np.nan
        return Simulation(truth, z, prior)


def _tracking(sensor: SensorBase, launch: Launch, q: float, T: float) -> Tracking:
    """Return a problem with a target so fast that a late estimate is far away."""
    target = Driven(motion=WhiteAcceleration(q=q), launch=launch)
    start = GaussianStart(sigma=(20.0, 10.0, 30.0, 15.0))
    return Tracking(target=target, sensor=sensor, start=start, T=T, last=8)


def planar(q: float = 25.0, sigma: float = 20.0, T: float = 2.0) -> Tracking:
    """Return a linear problem."""
    launch = Launch(x=1500.0, vx=150.0, y=-700.0, vy=-90.0)
    return _tracking(PositionSensor(sigma=sigma), launch, q, T)


def radar(
    q: float = 25.0, sigma: float = 40.0, T: float = 2.0, at: tuple[float, float] = (-5000.0, 20.0)
) -> Tracking:
    """Return a radar's problem; by default the target is about where the azimuth jumps by 2 pi."""
    sensor = RangeAzimuth(sigma_range=sigma, sigma_azimuth_mrad=sigma)
    return _tracking(sensor, Launch(x=at[0], vx=150.0, y=at[1], vy=-10.0), q, T)


PLANAR, RADAR = planar(), radar()
PRECISE = radar(sigma=5.0, at=(4000.0, 3000.0))
UNEQUAL = ModelDraws(base=PLANAR, unequal=True)


def at_unequal_intervals(problem: Scenario) -> ModelDraws | None:
    """Return a config's problem with intervals that differ from step to step; None if it has none."""
    base = problem.base if isinstance(problem, ModelDraws) else None
    if not isinstance(base, Tracking) or len(base.steps) < 3:
        return None
    motion = base.assume.motion or base.target.own_motion
    equal = np.ptp(np.diff(base.times)) < 1e-9 * base.T
    possible = equal and motion is not None and not motion.uses_time
    return ModelDraws(base=base, unequal=True) if possible else None


class Estimates(NamedTuple):
    """Mean (n_x, T + 1, M) and cov (n_x, n_x, T + 1, M) of every step; whether numbers were drawn."""

    mean: Array
    cov: Array
    random: bool
    series: dict[str, Array]
    """NIS, weight of further models and log-likelihood (T, M), of filters that have them"""


def new_rng() -> Generator:
    """Return the same random numbers every time."""
    return Generator(SFC64(20260101))


def simulate(scenario: Scenario, runs: int, step: int = 1, seed: int = 1) -> Simulation:
    """Simulate the first runs of the scenario, in their order or the last one first (step -1)."""
    runs = min(runs, scenario.recorded_runs or runs)
    return scenario.simulate(RunStreams(seed, range(runs)[::step]), runs)


def run_filter(tracker: AnyFilter, scenario: Scenario, data: Simulation) -> Estimates:
    """Return the filter's estimates, by `init` and one `step` after another."""
    rng = new_rng()
    state = tracker.init(scenario.model, data.prior, rng)
    estimates, rows = [tracker.estimate(state)], []
    for i, k in enumerate(scenario.steps[1:]):
        state = tracker.step(scenario.model, state, data.measurements[:, i], int(k), rng)
        estimates.append(tracker.estimate(state))
        rows.append({n: x for n, x in tracker.diagnostics(state).items() if n in ("nis", "mode")})
        if (log_likelihood := tracker.log_likelihood(state)) is not None:
            rows[-1]["log_likelihood"] = log_likelihood
    covs = np.stack([per_run_moments(g).cov for g in estimates], axis=2)
    means = np.stack([g.mean for g in estimates], axis=1)
    series = {name: np.array([row[name] for row in rows]) for name in rows[-1]}
    return Estimates(means, covs, _words(rng) != _words(new_rng()), series)


def _words(rng: Generator) -> list[int]:
    return rng.bit_generator.state["state"]["state"].tolist()


def runs_on(tracker: AnyFilter, scenario: Scenario) -> bool:
    """Return whether a filter runs on a scenario, also one that it does not refuse beforehand."""
    try:
        with guarded(), np.errstate(all="ignore"):
            return not why_not(tracker, scenario) and bool(
                run_filter(tracker, scenario, simulate(scenario, 2))
            )
    except Exception:
        return False


def why_not(tracker: AnyFilter, scenario: Scenario) -> str:
    """Return the reason why a filter cannot run on a scenario, or nothing."""
    lacking = [n for n in tracker.all_requirements if not has(scenario, n)]
    mistakes = [] if lacking else list(filter_conflicts(tracker, scenario).values())
    return f"needs {lacking[0]}" if lacking else (mistakes or [""])[0]


def with_gaps(data: Simulation) -> Simulation:
    """Return the data without some measurements, in two runs of three."""
    z = data.measurements.copy()
    z[:, 2::4, ::3] = z[:, 3::5, 1::3] = np.nan
    return data._replace(measurements=z)


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
    """Return the scores of estimates; distance and error are in the reference's covariance."""
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


def misfit(tracker: AnyFilter, scenario: Scenario, runs: int, seed: int) -> str:
    """Return how a filter differs from the package's on a problem drawn from its model, or nothing."""
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
    """Return the least and the largest score that an honest filter may have, per run (M,)."""
    if name == "rmse":
        return np.full_like(reference, -1.0), 3.0 * reference + 0.05
    if name == "spread":
        return 0.9 * reference, (1.0 + 0.3 * wide) * reference
    if name == "log_likelihood":
        return reference - 0.1 * wide, reference + 0.1 * wide
    return (1.0 - 0.3 * wide) * reference, (1.0 + 0.3 * wide) * reference


def _exceeds(excess: Array) -> bool:
    """Return whether numbers per run (M,) are positive in the mean, by six standard errors."""
    return bool(excess.mean() > _MAX_DEVIATION * excess.std(ddof=1) / np.sqrt(len(excess)))


def _cause(of: Estimates, path: Array, sizes: dict[str, float]) -> str:
    """Return the likely cause of a difference from the path (n, T + 1, M) and of other scores."""
    mean = of.mean[: len(path)]

    def off(other: Array) -> float:
        # The median over the runs: a lost run does not count.
        return float(np.median(np.square(mean - other)[:, 3:].mean(axis=(0, 1))))

    if off(np.roll(path, 1, axis=1)) < 0.1 * off(path):
        return "; estimates fit the truth one step earlier: returned before the update?"
    if len(path) == 4 and off(path[[2, 3, 0, 1]]) < 0.1 * off(path):
        return "; estimates fit the truth with x and y exchanged"
    too_large = sizes.get("spread", -sizes.get("anees", 0.0))
    if sizes.get("rmse", 0.0) > 3.0:
        return "; an axis, a unit (degrees), a sign, dt or a gap is taken wrongly?"
    if too_large > 0.0:
        return "; the covariance is too large: does the update reduce it by the gain, is R sigma^2?"
    if too_large < 0.0:
        return "; the covariance is too small: sigma for sigma^2, or a noise or dt forgotten?"
    return "; are the innovation and S those before the update?" if "rmse" not in sizes else ""


def mistaken_track(tracker: AnyFilter, problem: Tracking) -> str:
    """Return how estimates miss the path of a fast target, or nothing; no model is needed for it."""
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
