"""Problems of the contract, on which a filter is checked.

Truth and measurements are draws from the model that the filter gets. So a filter with this model has
errors of the size that its covariance states, and a filter of the package is as good as it can be.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution
from trackbench.core.random_streams import RunStreams, Streams
from trackbench.models.augmented_priors import augment_prior
from trackbench.models.base import Model, Motion, extra_std
from trackbench.models.model_for_programs import description_of, with_description
from trackbench.models.motions.kinematic import ConstantVelocity, WhiteAcceleration
from trackbench.models.motions.merwe_sine_gamma import SineGamma
from trackbench.models.motions.unequal_intervals import Irregular
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.platform import Platform
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.scenarios.base import Scenario, Simulation, simulate_markov
from trackbench.scenarios.starts.gaussian import GaussianStart
from trackbench.scenarios.starts.known import Known
from trackbench.scenarios.targets.driven import Driven
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.tracking import Tracking

_MOST_STEPS = 30  # after the first scored one
_INTERVALS = (1.0, 0.5, 1.5, 0.25, 1.0, 2.0, 0.5, 1.25)  # in units of T, again and again


@dataclass(frozen=True, kw_only=True)
class ModelDraws(Scenario):
    """First steps of a scenario, with the truth drawn from the prior and the model of the filters.

    A filter is checked on these draws when a config is given: a correct filter is consistent on them,
    whatever the truth of the config is.
    """

    base: Scenario
    unequal: bool = False
    """whether the intervals differ from step to step; default: the scenario's intervals"""

    @cached_property
    def model(self) -> Model:
        """Model that filters get."""
        if not self.unequal:
            return self.base.model
        # `at_unequal_intervals` varies the intervals of a `Tracking` with a motion only.
        base = cast(Tracking, self.base)
        drive = cast(Motion, base.assume.motion or base.target.own_motion)
        first = int(self.steps[1])
        irregular = Irregular(drive, base.target.axes, first, np.diff(self.times))
        model = Model(irregular, base.model.sensor)
        # An external filter program is sent the description of the config's motion and sensors.
        return with_description(model, description_of(base.model))

    @property
    def _length(self) -> int:
        """Number of first steps, with that of the prior.

        The last one is `_MOST_STEPS` steps after the first one that the config scores.
        """
        first_scored = int(np.argmax(self.base.windows[""]))
        return first_scored + _MOST_STEPS + 1

    @property
    def steps(self) -> Index:
        """First steps."""
        return self.base.steps[: self._length]

    @property
    def times(self) -> Array:
        """Times of the first steps, s."""
        if self.unequal:
            intervals = cast(Tracking, self.base).T * np.resize(_INTERVALS, len(self.steps) - 1)
            return np.concatenate([[0.0], np.cumsum(intervals)])
        return self.base.times[: self._length]

    @property
    def windows(self) -> dict[str, Mask]:
        """One window of the steps that the config scores."""
        return {"": self.base.windows[""][: self._length]}

    @property
    def prior_type(self) -> type:
        """Class of the scenario's prior."""
        return self.base.prior_type

    @property
    def angles(self) -> tuple[str, ...]:
        """Components that are angles."""
        return self.base.angles

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Return the scenario's error vectors."""
        return self.base.errors(mean, truth)

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Draw the first state from the prior, then truth and measurements from the model."""
        # A recording has few runs: each gives its prior and its missing measurements to several draws.
        recorded_runs = self.base.recorded_runs
        base_rng = rng
        if recorded_runs is not None:
            assert isinstance(rng, RunStreams)
            base_rng = RunStreams(rng.seed, [run % recorded_runs for run in rng.runs])
        data = self.base.simulate(base_rng, runs)
        # The prior that filters assume, or the simulated one; it may lack components of their motion.
        prior = self.base.assumed_prior(runs) or data.prior
        if len(self.components) > len(prior.mean):
            prior = augment_prior(prior, extra_std(self.model.motion))
        return self.draw_from(prior, np.isnan(data.measurements), rng)

    def draw_from(self, prior: Distribution, missing: Mask, rng: Streams) -> Simulation:
        """Draw first states from the prior, then truth and measurements from the model.

        ``missing`` (n_z, T, M) marks the measurements that become NaN. Its T steps may be more than
        those of this problem, as those of the base scenario are.
        """
        truth, z = simulate_markov(self.model, prior.sample(rng), self.steps, rng)
        z[missing[:, : z.shape[1]]] = np.nan
        return Simulation(truth, z, prior)


def _tracking(sensor: SensorBase, launch: Launch, q: float, T: float) -> Tracking:
    """Make a problem with a target so fast that a late estimate is far away."""
    target = Driven(motion=WhiteAcceleration(q=q), launch=launch)
    start = GaussianStart(sigma=(20.0, 10.0, 30.0, 15.0))  # m and m/s: x, vx, y, vy
    return Tracking(target=target, sensor=sensor, start=start, T=T, last=8)


def planar(q: float = 25.0, sigma: float = 20.0, T: float = 2.0) -> Tracking:
    """Make a linear problem: a position sensor with the standard deviation sigma, and steps of T."""
    launch = Launch(x=1500.0, vx=150.0, y=-700.0, vy=-90.0)
    return _tracking(PositionSensor(sigma=sigma), launch, q, T)


def radar(
    q: float = 25.0,
    sigma: float = 40.0,
    T: float = 2.0,
    x: float = -5000.0,
    y: float = 20.0,
    at: tuple[float, ...] = (),
    platform: Platform | None = None,
) -> Tracking:
    """Make a radar's problem; by default the target is about where the azimuth jumps by 2 pi.

    ``q`` is the intensity of the target's random acceleration. ``sigma`` is the standard deviation of
    the range in m, and of the azimuth in mrad. The target starts at ``x`` and ``y``, m. The radar stands
    ``at`` a place, m, by default at the origin, or moves on a ``platform``.
    """
    sensor = RangeAzimuth(sigma_range=sigma, sigma_azimuth_mrad=sigma, at=at, platform=platform)
    return _tracking(sensor, Launch(x=x, vx=150.0, y=y, vy=-10.0), q, T)


def with_white_sequence(problem: Tracking) -> Tracking:
    """Replace the motion by one with a noise that is constant within a step, and the same key `q`."""
    target = cast(Driven, problem.target)
    motion = ConstantVelocity(q=cast(WhiteAcceleration, target.motion).q)
    return replace(problem, target=replace(target, motion=motion))


PLANAR = planar()
RADAR = radar()
PRECISE = radar(sigma=5.0, x=4000.0, y=3000.0)
SCALAR = Tracking(
    target=Driven(motion=SineGamma(), launch=Launch(x=1.0)),
    sensor=SquareThenLine(R=0.1),
    start=Known(),
    first=1,
    last=8,
)
"""Van der Merwe's scalar model, for filters that need one."""
UNEQUAL = ModelDraws(base=PLANAR, unequal=True)
PLACED = radar(x=4000.0, y=3000.0, at=(-1500.0, 2000.0))
"""Problem of a radar that does not stand at the origin."""
ONE_MOTION = {
    "planar": planar(q=1.0, T=6.0),
    "radar": radar(q=1.0, T=6.0, x=4000.0, y=3000.0),
}
"""Problems whose motion is of the kind that all problems of the contract have."""
OTHER_MOTION = {name: with_white_sequence(problem) for name, problem in ONE_MOTION.items()}
"""These problems with a motion of another kind.

Its key `q` has another meaning: in steps of 6 s the variance of the velocity is 6 times as large.
"""
_POSITION_EQUATIONS = FunctionSensor(h={"x": "px", "y": "py"}, R={"x": 20.0**2, "y": 20.0**2})
_RADAR_EQUATIONS = FunctionSensor(
    h={"range": "sqrt(px**2 + py**2)", "azimuth": "atan2(py, px)"},
    R={"range": 40.0**2, "azimuth": 0.04**2},
)
OF_EQUATIONS = (
    (PLANAR, replace(PLANAR, sensor=_POSITION_EQUATIONS)),
    (RADAR, replace(RADAR, sensor=_RADAR_EQUATIONS)),
)
"""Pairs of a problem of the contract and the same one with its sensor written as equations."""
MOVING = radar(
    x=4000.0, y=3000.0, platform=Platform(steps=(0, 8), x=(-1500.0, 900.0), y=(2000.0, 400.0))
)
"""Problem of a radar that moves from this place on."""


_WHOLE_RUNS = 20  # of a config's experiment
_MOST_WHOLE_STEPS = 10_000  # of all of these runs together, and of a run


@dataclass(frozen=True, kw_only=True)
class WholeExperiment(ModelDraws):
    """Runs of a config's experiment itself, over its whole length or the first `_MOST_WHOLE_STEPS`."""

    @property
    def _length(self) -> int:
        """Number of steps, with that of the prior."""
        return min(len(self.base.steps), _MOST_WHOLE_STEPS + 1)

    @property
    def runs(self) -> int:
        """Number of runs that are tried: fewer if they are long."""
        return max(1, min(_WHOLE_RUNS, _MOST_WHOLE_STEPS // self._length))

    @property
    def recorded_runs(self) -> int | None:
        """Number of recorded runs; None for a simulated experiment."""
        return self.base.recorded_runs

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Simulate the experiment's truth and measurements, as far as `steps` go."""
        data = self.base.simulate(rng, runs)
        # The prior that filters assume, or the simulated one; it may lack components of their motion.
        prior = self.base.assumed_prior(runs) or data.prior
        if len(self.components) > len(prior.mean):
            prior = augment_prior(prior, extra_std(self.model.motion))
        z = self.base.assumed_measurements(data.measurements)
        truth = data.truth[:, : self._length]
        return Simulation(truth, z[:, : self._length - 1], prior)
