"""The Kalman filter, and the bases of the filters with one Gaussian as their state."""

from dataclasses import dataclass
from functools import cache
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, Index, Mask, fixed
from trackbench.core.conversions import Conversion
from trackbench.core.distributions import (
    Distribution,
    Factored,
    Gaussian,
    from_root,
    per_run_moments,
    root_of,
)
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.smoothing import Transition, smooth
from trackbench.field_types import NonNegative, OpenShare, Positive
from trackbench.filters.base import FixedLag, InnovationFilter, SmoothingFilter, Steps
from trackbench.filters.robust import AnyRobust, Reweighted, blocks
from trackbench.models.base import Model, Scene, Sensor, has_density
from trackbench.models.gaussian_steps import (
    MODEL_NOISE,
    AssumedNoise,
    extended_step,
    extended_transition,
    idle_noise_mean,
)
from trackbench.models.motions.kinematic import Linear
from trackbench.models.priors import Convertible
from trackbench.models.sensors.base import ScaledNoise, Sensors, sensors_of
from trackbench.models.sensors.position import LinearSensor
from trackbench.registry import register

MAX_ORDER = 32
"""Largest order of a Gauss-Hermite rule."""
MERWE_DEMO: dict[str, object] = {"Q": 0.75, "R": 1e-5, "P0": 0.75, "noise_mean": False}
"""Noise that van der Merwe's public demo gives its Kalman filters."""


class Tracked(NamedTuple):
    """Posterior, NIS (M,) and innovation of the last measurement, and what a gate refused of it."""

    posterior: Gaussian
    nis: Array
    innovation: Innovation | None = None
    refused: Mask | None = None
    """components (n_z, M) that the gates refused"""
    gated: Array | None = None
    """number of measurements (M,), one of each sensor, that the gates refused"""
    weight: Array | None = None
    """mean weight of the measured components (M,) in a robust update"""

    @property
    def prediction(self) -> Gaussian | None:
        """Estimate of the step without its measurement, bit for bit; None if it is not stored."""
        return None if self.innovation is None else self.innovation.predicted


@dataclass(frozen=True, kw_only=True)
class GaussianFilter(SmoothingFilter[Tracked], InnovationFilter[Tracked]):
    """Base of the filters with one Gaussian: each defines `update`, which an IMM calls as well."""

    gate: OpenShare | None = None
    """refuse a measurement whose NIS is beyond this quantile of its chi-square law, such as 0.999"""

    gate_by: Literal["measurement", "sensor"] = "measurement"
    """one gate for the measurement of all sensors at a step, or one for each sensor's measurement"""

    robust: AnyRobust | None = None
    """weights of the sensors, less for an outlier: {kind: huber, k: 1.5}, {kind: student-t, df: 4}"""

    smooth: bool | FixedLag = False
    """estimate each step from all measurements of the run, or from so many later ones: {lag: 5}"""

    fading: Annotated[float, Ge(1), Interval(lt=float("inf"))] = 1.0
    """factor of a fading memory, ``a^2 F P F' + Q`` (Anderson & Moore 1979; Simon 2006, section 7.4)"""

    form: Literal["covariance", "square-root"] = "covariance"
    """recursion of covariances, or of their triangular factors, which has twice the digits"""

    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"gated"})
    deterministic: ClassVar[bool] = True

    def initialize(self, model: Model, prior: Distribution) -> Gaussian:
        """Start from the prior's moments."""
        return Gaussian(prior.mean, prior.cov)

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict to step k and update with z (n_z, M)."""
        raise NotImplementedError

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a redundant component of the measurement, and weights on noise that is not normal."""
        if name := _redundant_component(scenario):
            what = f"`{name}` is a combination of other measured components, its noise included"
            return {"": f"the innovation covariance is singular: {what}; leave it out"}
        if self.robust is None or not has_density(scenario.model.sensor):
            return {}
        what = "weighs normal noise of covariance R, and this sensor's noise is not normal"
        return {"robust": f"{what}; give the filter a normal sensor by `assume: {{sensor: ...}}`"}

    def robust_update(
        self, model: Model, state: Gaussian, z: Array, k: int
    ) -> tuple[Gaussian, Innovation, Array | None]:
        """Predict and update; a robust update does so again with each new weights of the sensors.

        Returns the posterior, the innovation by weights of 1, and the mean weight (M,) or None.
        """
        if self.robust is None:
            return (*self.update(model, state, z, k), None)
        if not isinstance(state, Factored):
            state = per_run_moments(state)  # as the noise is
        posterior, innovation = self.update(model, state, z, k)
        weighted = None
        for _ in range(self.robust.iterations):
            weighted = Reweighted(model.sensor, self.robust.weights(model.sensor, posterior, z, k))
            posterior, _ = self.update(model._replace(sensor=weighted), state, z, k)
        assert weighted is not None
        return posterior, innovation, weighted.mean_weight(z)

    def log_ratio(self, innovation: Innovation, nis: Array) -> Array:
        """Evaluate the log-density (M,) of an innovation, less that of N(0, S): 0 unless robust."""
        if self.robust is None:
            return np.zeros(nis.shape)
        return self.robust.log_ratio(nis, (~np.isnan(innovation.nu)).sum(axis=0))

    def log_density(self, innovation: Innovation) -> Array:
        """Evaluate the log-density (M,) of an innovation: N(0, S), or a robust law of scale S."""
        value = innovation.log_likelihood
        if self.robust is None:
            return value
        return value + self.log_ratio(innovation, innovation.nis)

    def log_likelihood(self, state: Tracked) -> Array:
        """Evaluate log p(z_k | z_1..k-1) (M,) of the last measurement by `log_density`."""
        if state.innovation is None:
            return np.full(state.nis.shape, np.nan)
        return self.log_density(state.innovation)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Tracked:
        """Start without an innovation."""
        return Tracked(self.initialize(model, prior), np.full(prior.mean.shape[1], np.nan))

    def step(self, model: Model, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict and update; predict only where the gate refuses the measurement."""
        before = self.prepared(state.posterior)
        posterior, innovation, weight = self.robust_update(model, before, z, k)
        nis = innovation.nis
        if self.smooths:
            innovation = innovation._replace(predicted=None)  # all states stay in memory
        if self.gate is None:
            return Tracked(posterior, nis, innovation, weight=weight)
        refused = self.refused_components(model.sensor, z, innovation, nis)
        # Update again with the refused measurements as missing: without any other, predict only.
        if refused.any():
            used = np.where(refused, np.nan, z)
            posterior, accepted, weight = self.robust_update(model, before, used, k)
            # The NIS is that of the measurements that are used.
            nis = np.where(refused.any(axis=0), accepted.nis, nis)
        return Tracked(
            posterior=posterior,
            nis=nis,
            innovation=innovation,
            refused=refused,
            gated=self.number_of_refused(model.sensor, refused),
            weight=weight,
        )

    def refused(self, state: Tracked) -> Mask | None:
        """Return the components (n_z, M) that the gates refused."""
        return state.refused

    def refused_components(
        self, sensor: Sensor, z: Array, innovation: Innovation, nis: Array
    ) -> Mask:
        """Return the components of z (n_z, M) beyond their gates, by the innovation and its NIS (M,).

        The gate of one sensor judges the NIS of its own innovation, ``nu_s' S_ss^-1 nu_s``. The limit
        depends on the number of measured components.
        """
        assert self.gate is not None
        nu = innovation.nu
        S = innovation.S
        limits = gate_limits(self.gate, len(z))
        measured, sensors = ~np.isnan(nu), blocks(sensor)
        if self.gate_by == "measurement" or len(sensors) == 1:
            beyond = nis > limits[measured.sum(axis=0)]
            return np.asarray(beyond & ~np.isnan(z))
        refused = np.zeros(z.shape, dtype=np.bool_)
        for rows in sensors:
            nis_of_sensor = Innovation(nu[rows], S[rows, rows]).nis
            refused[rows] = nis_of_sensor > limits[measured[rows].sum(axis=0)]
        return refused & ~np.isnan(z)

    def number_of_refused(self, sensor: Sensor, refused: Mask) -> Array:
        """Count the measurements (M,) whose components (n_z, M) are refused, as `gate_by` takes them."""
        if self.gate_by == "measurement":
            return np.asarray(refused.any(axis=0), dtype=float)
        count = np.zeros(refused.shape[1])
        for rows in blocks(sensor):
            count += refused[rows].any(axis=0)
        return count

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report ``gate_by`` as idle without a gate, and with one sensor."""
        if self.gate is None:
            return {"gate_by": "without `gate`"}
        return {} if len(blocks(scenario.model.sensor)) > 1 else {"gate_by": "with one sensor"}

    def cautions(self, scenario: Scene) -> list[str]:
        """Note that one gate judges the measurements of several sensors at a step together."""
        if self.gate is None or self.gate_by == "sensor" or not _measure_together(scenario):
            return []
        what = "one gate judges all sensors of a step, so that a bad one costs the others"
        return [f"{what}; `gate_by: sensor` gives each sensor a gate of its own"]

    def prepared(self, state: Gaussian) -> Gaussian:
        """Prepare a posterior for the next prediction: N(m, a^2 P), with its factor if needed."""
        if self.form == "square-root":
            return from_root(state.mean, self.fading * root_of(state))
        if self.fading == 1.0:
            return state
        return Gaussian(state.mean, self.fading * self.fading * state.cov)

    def estimate(self, state: Tracked) -> Gaussian:
        """Return the posterior."""
        return state.posterior

    def smoothed(
        self, model: Model, states: list[Tracked], k: int, rng: Generator
    ) -> list[Tracked]:
        """Smooth the posteriors of every step by the Rauch-Tung-Striebel recursion."""
        posteriors = [per_run_moments(state.posterior) for state in states]
        transitions = [
            self.faded_transition(model, x, k + 1 + i) for i, x in enumerate(posteriors[:-1])
        ]
        smoothed = smooth(posteriors, transitions, self.lag)
        return [s._replace(posterior=x) for s, x in zip(states, smoothed, strict=True)]

    def faded_transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k as `step` does, with the covariance with the posterior."""
        # cov(x', f(x')) of the faded x' ~ N(m, a^2 P) is a^2 cov(x, f(x')).
        step = self.transition(model, self.prepared(state), k)
        return Transition(step.predicted, step.cross / (self.fading * self.fading))

    def transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k from a posterior, with the covariance with it."""
        return extended_transition(model, state, k, MODEL_NOISE)

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of `diagnostics`."""
        keys = {"gated": self.gate, "measurement_weight": self.robust}
        return frozenset({"nis", *(name for name, key in keys.items() if key is not None)})

    def diagnostics(self, state: Tracked) -> dict[str, Array]:
        """Report ``nis`` of what is used; ``gated``: number of refused measurements; mean weight."""
        return {"nis": state.nis} | of_refusals(self, state.nis, state.gated, state.weight)


def _measure_together(scenario: Scene) -> bool:
    """Test whether two of the scenario's sensors measure at one step, by their periods."""
    sensor = scenario.model.sensor
    while isinstance(sensor, ScaledNoise):
        sensor = sensor.sensor
    due = np.zeros(len(scenario.steps) - 1)
    for one in sensors_of(cast(Sensors, sensor)):
        due += (scenario.steps[1:] - one.offset) % one.period == 0
    return bool((due > 1).any())


def _redundant_component(scenario: Scene) -> str | None:
    """Name a measured component that follows from others in a linear model with constant noise."""
    motion, sensor = scenario.model
    if not hasattr(sensor, "H") or len(sensor.components) < 2:
        return None
    x, k = np.ones((len(motion.components), 1)), int(scenario.steps[-1])
    H, R = sensor.H(len(x)), sensor.measurement(x, k).cov
    if R.ndim > 2:
        return None
    # A combination d has neither state nor noise: d' [H R] = 0, whatever the units of the columns.
    B = np.hstack([H, R])
    for axis in (1, 0):
        largest = np.abs(B).max(axis=axis, keepdims=True)
        B = B / np.where(largest > 0.0, largest, 1.0)
    pivots = np.diagonal(linalg.root_in_range(linalg.matmul(B, B.T)))
    return next((sensor.components[i] for i in np.flatnonzero(pivots == 0.0)), None)


def of_refusals(
    tracker: GaussianFilter, nis: Array, gated: Array | None, weight: Array | None
) -> dict[str, Array]:
    """Name refused measurements and their mean weights (M,), if the filter has a gate or weights."""
    out = {}
    if tracker.gate is not None:
        out["gated"] = np.zeros(len(nis)) if gated is None else gated
    if tracker.robust is not None:
        out["measurement_weight"] = nis if weight is None else weight
    return out


@cache
def gate_limits(gate: float, n_z: int) -> Array:
    """Return the chi-square quantiles (n_z + 1,) by the number of measured components."""
    from scipy.special import chdtri

    # No measured component: the limit is infinite, so nothing is gated.
    return fixed(np.array([np.inf, *(chdtri(n, 1.0 - gate) for n in range(1, n_z + 1))]))


@dataclass(frozen=True, kw_only=True)
class NonlinearFilter(GaussianFilter):
    """Base of the filters that linearize a nonlinear model or take sigma points of it."""

    Q: Positive | None = None
    """process noise variance assumed of a scalar state; default: the model's"""
    R: Positive | None = None
    """measurement noise variance assumed of a scalar measurement; default: the model's"""
    P0: NonNegative | None = None
    """initial variance assumed of a scalar state; default: the prior's"""
    noise_mean: bool = True
    """whether the prediction adds the mean of the process noise"""
    start: Conversion | None = None
    """conversion of the two scans that initialize a radar's filter; default: the prior's moments"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a conversion without two scans of a radar, and variances of several components."""
        out, (motion, sensor) = super().conflicts(scenario), scenario.model
        if self.robust is not None and self.R is not None:
            out["R"] = (
                "has no effect beside `robust`, which weighs the sensor's R: set it by `assume`"
            )
        if self.start is not None and not issubclass(scenario.prior_type, Convertible):
            out["start"] = "needs a start from two scans, such as `start: two-scan`"
        # One variance serves a scalar state or measurement only.
        for key, components in (("Q", motion), ("P0", motion), ("R", sensor)):
            if getattr(self, key) is not None and len(components.components) > 1:
                out[key] = "is one variance for several components; set the noise by `assume`"
        return out

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report also ``noise_mean`` as idle if the process noise is normal."""
        return super().idle_keys(scenario) | idle_noise_mean(scenario)

    def initialize(self, model: Model, prior: Distribution) -> Gaussian:
        """Start from the prior's moments, or from those of two-point differencing."""
        # The converted scans replace the prior; P0 replaces its covariance.
        if self.start is not None and isinstance(prior, Convertible):
            prior = prior.gaussian(self.start)
        if self.P0 is not None:
            prior = Gaussian(prior.mean, self.P0 * np.eye(len(prior.mean)))
        return per_run_moments(prior)

    @property
    def assumed(self) -> AssumedNoise:
        """Keys Q, R and noise_mean, which replace the model's noise."""
        return AssumedNoise(self.Q, self.R, self.noise_mean)

    def transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k by the motion's Jacobian, with the covariance with x_{k-1}."""
        return extended_transition(model, state, k, self.assumed)


@register("filters", "kf")
@dataclass(frozen=True, kw_only=True)
class KF(GaussianFilter):
    """Kalman filter for a linear motion and a linear sensor (adaptive-kf paper, eqs. 8-12).

    The covariance does not depend on the data: it and the gain are computed once for all runs.
    """

    requires: ClassVar[tuple[str, ...]] = ("motion.F|linear", "sensor.H|linear")
    is_linear: ClassVar[bool] = True

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update: for a linear model the extended step is the Kalman filter's."""
        return extended_step(model, state, z, k, MODEL_NOISE)

    def all_steps(self, model: Model, state: Tracked, z: Array, k: int) -> Steps | None:
        """Filter all measurements of a constant linear model in one call."""
        plain = type(self) is KF and self == KF(smooth=self.smooth)
        return constant_steps(model, state, z) if plain else None


def constant_steps(model: Model, state: Tracked, z: Array) -> Steps | None:
    """Return the Kalman filter's steps; None unless the model is linear, constant and small."""
    motion, sensor = model
    if not (isinstance(motion, Linear) and isinstance(sensor, LinearSensor)):
        return None
    H = sensor.H(len(motion.F))
    tracked = kalman.track(state.posterior, motion.F, motion.Q, H, sensor.R, z)
    if tracked is None:
        return None
    x, nu, nis = tracked

    def at(i: int) -> Tracked:
        posterior = Gaussian(x.mean[:, i], x.cov[:, :, i, 0])
        return Tracked(posterior, nis[i], Innovation(nu.nu[:, i], nu.S[:, :, i, 0]))

    def moments_before() -> Gaussian:
        mean = np.concatenate([state.posterior.mean[:, None], x.mean[:, :-1]], axis=1)
        first = state.posterior.cov[..., None, None]
        return Gaussian(mean, np.concatenate([first, x.cov[:, :, :-1]], axis=2))

    def together() -> Tracked:
        predicted = kalman.predict(moments_before(), motion.F, motion.Q)
        return Tracked(x, nis, nu._replace(predicted=predicted))

    def before(steps: Index) -> Tracked:
        mean, cov = moments_before().mean[:, steps], moments_before().cov[:, :, steps]
        cov = np.broadcast_to(cov, (*cov.shape[:2], *mean.shape[1:]))
        each = Gaussian(mean.reshape(len(mean), -1), cov.reshape(*cov.shape[:2], -1))
        return Tracked(each, np.full(each.mean.shape[1], np.nan))

    return Steps(x, {"nis": nis}, at, together, before)
