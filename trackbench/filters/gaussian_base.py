"""Bases of the filters with one Gaussian: their state, their step, and the noise that they assume.

`GaussianFilter.step` calls `update`, which each filter defines: `kf.py`, `ekf.py`, `ukf.py`, `cmkf.py`.
Gates are in `gate.py`, weights of the sensors in `robust.py`, smoothing in `core/smoothing.py`.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core import kalman, linalg
from trackbench.core.arrays import Array, Index, Mask, with_axes_of
from trackbench.core.compiled_steps import filter_steps
from trackbench.core.distributions import (
    Distribution,
    Gaussian,
    from_root,
    per_run_moments,
    root_of,
)
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.polar_conversions import Conversion
from trackbench.core.sigma_points import Unscented
from trackbench.core.smoothing import Transition, smooth
from trackbench.field_types import NonNegative, OpenShare, Positive
from trackbench.filters.base import WHOLE_FILTER, FixedLag, InnovationFilter, SmoothingFilter, Steps
from trackbench.filters.gate import (
    GateScope,
    count_refused,
    gate_cautions,
    idle_gate_keys,
    refused_components,
)
from trackbench.filters.robust import AnyRobust, robust_update
from trackbench.models.base import (
    DifferentiableMotion,
    DifferentiableSensor,
    Model,
    NormalMotion,
    Scene,
    Sensor,
    angle_rows,
)
from trackbench.models.derivatives import jacobian_at
from trackbench.models.likelihood import has_own_density
from trackbench.models.motions.irregular import matrices_of_steps
from trackbench.models.sensors.many_steps import measured_by_kernel
from trackbench.models.two_point_differencing import Convertible

MERWE_DEMO: dict[str, object] = {"Q": 0.75, "R": 1e-5, "P0": 0.75, "noise_mean": False}
"""Noise that van der Merwe's public demo gives its Kalman filters."""


class Tracked(NamedTuple):
    """State of a filter with one Gaussian after a step."""

    posterior: Gaussian
    """mean (n_x, M), covariance (n_x, n_x[, M])"""
    nis: Array
    """normalized innovation squared (M,) of the measurements that are used"""
    innovation: Innovation | None = None
    """innovation of the last measurement, the refused components included"""
    refused: Mask | None = None
    """components (n_z, M) that the gates refused"""
    gated: Array | None = None
    """number of measurements (M,), one of each sensor, that the gates refused"""
    weight: Array | None = None
    """mean weight of the measured components (M,) in a robust update"""

    @property
    def prediction(self) -> Gaussian | None:
        """Estimate that the step gives bit for bit without its measurement; None if it is not stored."""
        return None if self.innovation is None else self.innovation.predicted


@dataclass(frozen=True, kw_only=True)
class GaussianFilter(SmoothingFilter[Tracked], InnovationFilter[Tracked]):
    """Base of the filters with one Gaussian: each defines `update`, which an IMM calls as well."""

    gate: OpenShare | None = None
    """refuse a measurement whose NIS is beyond this quantile of its chi-square law, such as 0.999"""

    gate_by: GateScope = "measurement"
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

    # The algorithm: init, step, estimate.

    def initialize(self, model: Model, prior: Distribution) -> Gaussian:
        """Start from the prior's moments.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        prior : Distribution
            Prior of the first state.

        Returns
        -------
        Gaussian
            Mean (n_x, M), covariance (n_x, n_x) or (n_x, n_x, M).
        """
        return Gaussian(prior.mean, prior.cov)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Tracked:
        """Return the state before the first measurement, which has no innovation."""
        unknown = np.full(prior.mean.shape[1], np.nan)
        return Tracked(posterior=self.initialize(model, prior), nis=unknown)

    def step(self, model: Model, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict and update; predict only where the gate refuses the measurement."""
        # Step 1: the posterior N(m, P), with a fading memory and as a square root if the keys ask so.
        before = self.prepared(state.posterior)
        # Step 2: predict to step k and update with z.
        posterior, innovation, weight = self.predict_and_update(model, before, z, k)
        nis = innovation.nis
        if self.smooths:
            # The smoother keeps the states of all steps in memory: leave out their predictions.
            innovation = innovation._replace(predicted=None)
        updated = Tracked(posterior=posterior, nis=nis, innovation=innovation, weight=weight)
        # Step 3: leave out what the gate refuses.
        if self.gate is None:
            return updated
        return self._gate(model, before, updated, z, k)

    def estimate(self, state: Tracked) -> Gaussian:
        """Return the posterior."""
        return state.posterior

    # Steps of the algorithm.

    def prepared(self, state: Gaussian) -> Gaussian:
        """Return the posterior as the prediction needs it: N(m, a^2 P) with the fading factor a.

        With `form: square-root` it has the factor of its covariance.
        """
        if self.form == "square-root":
            return from_root(state.mean, self.fading * root_of(state))
        if self.fading == 1.0:
            return state
        return Gaussian(state.mean, self.fading * self.fading * state.cov)

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict to step k and update with z.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : Gaussian
            Posterior of step k - 1: mean (n_x, M), covariance (n_x, n_x[, M]), or a `Factored`.
        z : array (n_z, M)
            Measurements of step k; NaN where one is missing.
        k : int
            Number of the step.

        Returns
        -------
        posterior : Gaussian
            Mean (n_x, M), covariance (n_x, n_x[, M]).
        innovation : Innovation
            ``nu`` (n_z, M), NaN where a component is missing, and its covariance S.
        """
        raise NotImplementedError

    def predict_and_update(
        self, model: Model, state: Gaussian, z: Array, k: int
    ) -> tuple[Gaussian, Innovation, Array | None]:
        """Call `update`; with the key ``robust`` again for each new set of weights of the sensors.

        Parameters are those of `update`.

        Returns
        -------
        posterior : Gaussian
            Posterior by the last weights.
        innovation : Innovation
            Innovation by weights of 1.
        weight : array (M,) or None
            Mean weight of the measured components; None without the key ``robust``.
        """
        if self.robust is not None:
            return robust_update(self.robust, self.update, model, state, z, k)
        posterior, innovation = self.update(model, state, z, k)
        return posterior, innovation, None

    def _gate(self, model: Model, before: Gaussian, updated: Tracked, z: Array, k: int) -> Tracked:
        """Update ``before`` again without the measurements whose NIS in ``updated`` is too large.

        ``before`` is the posterior of step k - 1, and ``updated`` the state after all measurements z.
        """
        assert updated.innovation is not None
        refused = self.refused_components(model.sensor, z, updated.innovation, updated.nis)
        posterior = updated.posterior
        nis = updated.nis
        weight = updated.weight
        if refused.any():
            # Refused measurements count as missing: without any other the filter predicts only.
            used = np.where(refused, np.nan, z)
            posterior, accepted, weight = self.predict_and_update(model, before, used, k)
            # The NIS is that of the measurements that are used.
            nis = np.where(refused.any(axis=0), accepted.nis, nis)
        return Tracked(
            posterior=posterior,
            nis=nis,
            innovation=updated.innovation,
            refused=refused,
            gated=self.count_refused(model.sensor, refused),
            weight=weight,
        )

    def refused_components(
        self, sensor: Sensor, z: Array, innovation: Innovation, nis: Array
    ) -> Mask:
        """Return the components of z (n_z, M) that gates refuse, by an innovation and its NIS (M,)."""
        assert self.gate is not None
        return refused_components(self.gate, self.gate_by, sensor, z, innovation, nis)

    def count_refused(self, sensor: Sensor, refused: Mask) -> Array:
        """Count the measurements (M,) with a refused component (n_z, M).

        As `gate_by` says, a measurement is that of all sensors at a step, or that of each sensor.
        """
        return count_refused(self.gate_by, sensor, refused)

    # Smoothing.

    def smoothed(
        self, model: Model, states: list[Tracked], k: int, rng: Generator
    ) -> list[Tracked]:
        """Smooth the posteriors of every step by the Rauch-Tung-Striebel recursion."""
        posteriors = [per_run_moments(state.posterior) for state in states]
        # State i is that of step k + i.
        transitions = [
            self.faded_transition(model, posterior, k + 1 + i)
            for i, posterior in enumerate(posteriors[:-1])
        ]
        smoothed = smooth(posteriors, transitions, self.lag)
        pairs = zip(states, smoothed, strict=True)
        return [state._replace(posterior=posterior) for state, posterior in pairs]

    def faded_transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k as `step` does; ``cross`` is cov(x, x_k), x the posterior before fading."""
        # The prediction starts from the faded x' ~ N(m, a^2 P). cov(x', f(x')) is a^2 cov(x, f(x')).
        transition = self.transition(model, self.prepared(state), k)
        return Transition(transition.predicted, transition.cross / (self.fading * self.fading))

    def transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k from a posterior, with the covariance of both states.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : Gaussian
            Posterior of step k - 1: mean (n_x, M), covariance (n_x, n_x, M).
        k : int
            Number of the step.

        Returns
        -------
        Transition
            Prediction of x_k, and cov(x_{k-1}, x_k) (n_x, n_x, M).
        """
        return extended_transition(model, state, k, MODEL_NOISE)

    # Likelihood and diagnostics.

    def log_ratio(self, innovation: Innovation, nis: Array) -> Array:
        """Return the log-density (M,) of an innovation minus that of N(0, S); 0 unless robust."""
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
        """Evaluate log p(z_k | z_1..k-1) (M,) by `log_density`; NaN before the first measurement."""
        if state.innovation is None:
            return np.full(state.nis.shape, np.nan)
        return self.log_density(state.innovation)

    def refused(self, state: Tracked) -> Mask | None:
        """Return the components (n_z, M) that the gates refused."""
        return state.refused

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of `diagnostics`."""
        names = {"nis"}
        if self.gate is not None:
            names.add("gated")
        if self.robust is not None:
            names.add("measurement_weight")
        return frozenset(names)

    def diagnostics(self, state: Tracked) -> dict[str, Array]:
        """Report ``nis`` of what is used; ``gated``: number of refused measurements; mean weight."""
        values = {"nis": state.nis}
        return values | self.gate_and_weight_diagnostics(state.nis, state.gated, state.weight)

    def gate_and_weight_diagnostics(
        self, nis: Array, gated: Array | None, weight: Array | None
    ) -> dict[str, Array]:
        """Return refused measurements and mean weights (M,), if the filter has a gate or weights.

        ``gated`` and ``weight`` are None before the first measurement. No measurement is refused then,
        and the weight is NaN, as ``nis`` (M,) is.
        """
        values = {}
        if self.gate is not None:
            values["gated"] = np.zeros(len(nis)) if gated is None else gated
        if self.robust is not None:
            values["measurement_weight"] = nis if weight is None else weight
        return values

    # Checks before a run.

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a redundant component of the measurement, and weights on noise that is not normal."""
        if name := _redundant_component(scenario):
            message = f"`{name}` is a combination of other measured components, its noise included"
            return {WHOLE_FILTER: f"the innovation covariance is singular: {message}; leave it out"}
        if self.robust is None or not has_own_density(scenario.model.sensor):
            return {}
        message = "weighs normal noise of covariance R, and this sensor's noise is not normal"
        return {
            "robust": f"{message}; give the filter a normal sensor by `assume: {{sensor: ...}}`"
        }

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report ``gate_by`` as idle without a gate, and with one sensor."""
        return idle_gate_keys(self.gate, scenario)

    def cautions(self, scenario: Scene) -> list[str]:
        """Note that one gate judges the measurements of several sensors at a step together."""
        return gate_cautions(self.gate, self.gate_by, scenario)


def _redundant_component(scenario: Scene) -> str | None:
    """Name the first measured component that follows from the components before it.

    None if there is none, or if the sensor is not linear with constant noise.
    """
    motion, sensor = scenario.model
    if not hasattr(sensor, "H") or len(sensor.components) < 2:
        return None
    any_state = np.ones((len(motion.components), 1))
    H = sensor.H(len(any_state))
    # Faults may scale R at some steps, which leaves a redundant component redundant: any step with a
    # measurement will do, such as the last.
    measured_step = int(scenario.steps[-1])
    R = sensor.measurement(any_state, measured_step).cov
    if R.ndim > 2:  # the noise depends on the state
        return None
    # A component is redundant if a combination d of components has neither state nor noise:
    # d' [H R] = 0. Rows and columns are scaled, so that units do not matter.
    B = np.hstack([H, R])
    for axis in (1, 0):
        largest = np.abs(B).max(axis=axis, keepdims=True)
        B = B / np.where(largest > 0.0, largest, 1.0)
    # A row of B that follows from the rows before it has a zero pivot in the factor of B B'.
    pivots = np.diagonal(linalg.root_in_range(linalg.matmul(B, B.T)))
    redundant = np.flatnonzero(pivots == 0.0)
    if len(redundant) == 0:
        return None
    return sensor.components[redundant[0]]


class AssumedNoise(NamedTuple):
    """Noise that a Gaussian filter assumes: variances Q and R of every component, None for the model's.

    ``noise_mean`` adds the mean of the process noise to the prediction. Without it the prediction of the
    gamma-driven model is 1.5 too low, an interpretation of a paper.
    """

    Q: float | None = None
    R: float | None = None
    noise_mean: bool = True

    def transition(self, model: Model, x: Array, k: int) -> Gaussian:
        """Return the mean and covariance of x_k given x_{k-1} = x.

        Without ``noise_mean`` the mean is f(x) alone. The covariance is the model's if Q is None.
        """
        exact = model.motion.transition(x, k)
        if self.Q is None and self.noise_mean and isinstance(exact, Gaussian):
            return exact
        # `loc` is f(x), without the mean of the noise.
        mean = exact.mean if self.noise_mean else exact.loc
        return Gaussian(mean, _assumed_cov(self.Q, exact.cov))

    def measurement(self, model: Model, x: Array, k: int) -> Gaussian:
        """Return the mean and covariance of z_k given x_k = x."""
        exact = model.sensor.measurement(x, k)
        if self.R is None:
            return exact
        return Gaussian(exact.mean, _assumed_cov(self.R, exact.cov))


def _assumed_cov(variance: float | None, cov: Array) -> Array:
    """Return ``variance`` times the unit matrix, or the model's ``cov`` if it is None."""
    return cov if variance is None else variance * np.eye(cov.shape[0])


MODEL_NOISE = AssumedNoise()
"""The noise of the model."""


def idle_noise_mean(scene: Scene) -> dict[str, str]:
    """Return a reason by key if ``noise_mean`` has no effect: the process noise has mean zero."""
    if isinstance(scene.model.motion, NormalMotion):
        return {"noise_mean": "as the process noise has mean zero"}
    return {}


def extended_prediction(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, order: int = 1
) -> Gaussian:
    """Predict x_k, with the motion f expanded at the mean.

    ``m^- = f(m)``, ``P^- = F P F' + Q`` with the Jacobian F of f at m; order 2 adds `with_curvature`.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Gaussian
        Posterior of step k - 1: m (n_x, *batch), P (n_x, n_x[, *batch]). The batch is the runs (M,), or
        runs and particles (M, N).
    k : int
        Number of the step.
    assumed : AssumedNoise
        Noise that the filter assumes.
    order : {1, 2}
        Order of the expansion.

    Returns
    -------
    Gaussian
        Prediction: m^- (n_x, *batch), P^- (n_x, n_x[, *batch]).
    """
    # A cast, because isinstance of a Protocol at every step takes as long as the step.
    motion = cast(DifferentiableMotion, model.motion)
    # N(f(m), Q)
    transition = assumed.transition(model, state.mean, k)
    if order == 2:
        transition = with_curvature(transition, motion, state, k)
    F = jacobian_at(motion, state, k)
    return kalman.predict(state, F, transition.cov, transition.mean)


def extended_transition(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, order: int = 1
) -> Transition:
    """Return the `extended_prediction` of x_k together with cov(x_{k-1}, x_k), which is ``P F'``."""
    F = jacobian_at(cast(DifferentiableMotion, model.motion), state, k)
    cross = linalg.matmul(state.cov, linalg.transpose(F))
    predicted = extended_prediction(model, state, k, assumed, order)
    return Transition(predicted, cross)


def with_curvature(
    linear: Gaussian,
    function: DifferentiableMotion | DifferentiableSensor,
    state: Gaussian,
    k: int,
) -> Gaussian:
    """Add the second-order terms of a motion or sensor to its mean and to its noise covariance.

    They are ``tr(H_i P) / 2`` and ``tr(H_i P H_j P) / 2`` (Bar-Shalom, Li & Kirubarajan 2001, section
    10.3.2), with the Hessian H_i of component i.

    Parameters
    ----------
    linear : Gaussian
        Value of the function at the state's mean, and covariance of its noise.
    function : DifferentiableMotion or DifferentiableSensor
        Function whose Hessians are taken.
    state : Gaussian
        State N(m, P) about whose mean the function is expanded.
    k : int
        Number of the step.

    Returns
    -------
    Gaussian
        Mean and noise covariance with the second-order terms.
    """
    hessians = jacobian_at(function, state, k, order=2)
    if not hessians.any():
        return linear
    HP = [linalg.matmul(H_i, state.cov) for H_i in hessians]
    bias = 0.5 * np.stack([linalg.trace(A) for A in HP])
    cov = linalg.symmetrize(0.5 * linalg.traces_of_products(np.stack(HP)))
    return Gaussian(
        linear.mean + with_axes_of(linear.mean, bias),
        with_axes_of(cov, linear.cov) + with_axes_of(linear.cov, cov),
    )


def nonlinear_steps(
    model: Model,
    state: Tracked,
    z: Array,
    k: int,
    keeps_predictions: bool,
    rule: Unscented | None = None,
) -> Steps | None:
    """Return all steps of a UKF, or of the EKF of a radar, bit for bit those of the filter's `step`.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Tracked
        State before the steps.
    z : array (n_z, T, M)
        Measurements of the steps.
    k : int
        Number of the first of these steps.
    keeps_predictions : bool
        Whether the states have the predictions. A smoother leaves them out, as it stores all states.
    rule : Unscented, optional
        Sigma points of state and noises; default: none, for the EKF.

    Returns
    -------
    Steps or None
        None unless the motion is one of `matrices_of_steps`, with several components and no angle, the
        sensor is one of `measured_by_kernel` (for the EKF a radar), and `filter_steps` can filter.
    """
    motion, sensor = model
    n = len(motion.components)
    measured = measured_by_kernel(sensor, n)
    if measured is None or (rule is None and not measured.is_radar):
        return None
    if angle_rows(motion) or n == 1:
        return None
    matrices = matrices_of_steps(motion, k, z.shape[1])
    if matrices is None:
        return None
    filtered = filter_steps(state.posterior, matrices, measured, z, rule)
    if filtered is None:
        return None
    states = filtered.states
    posteriors = select_steps(states, slice(1, None))

    def state_after(steps: int | slice) -> Tracked:
        """Return the state after the measurement of this index, or of several as one batch."""
        return Tracked(
            posterior=select_steps(posteriors, steps),
            nis=filtered.nis[steps],
            innovation=select_innovation(filtered.innovation, steps, keeps_predictions),
        )

    def state_of_all_steps() -> Tracked:
        """Return one state whose batch (T, M) is all steps, with the predictions if they are kept."""
        return state_after(slice(None))

    def state_before(steps: Index) -> Tracked:
        """Return one state before the steps of these indices, whose batch is each step's runs."""
        posterior = join_steps(states, steps)
        return Tracked(posterior=posterior, nis=np.full(posterior.mean.shape[1], np.nan))

    return Steps(
        estimate=posteriors,
        diagnostics={"nis": filtered.nis},
        state=state_after,
        together=state_of_all_steps,
        before=state_before,
    )


def select_steps(states: Gaussian, steps: int | slice) -> Gaussian:
    """Return the Gaussian of one step, or of several, from one with means (n, T, M)."""
    return Gaussian(states.mean[:, steps], states.cov[:, :, steps])


def select_innovation(
    innovations: Innovation, steps: int | slice, keeps_predictions: bool
) -> Innovation:
    """Return the innovation of one step, or of several, from one with nu (n_z, T, M).

    It has the prediction only if ``keeps_predictions`` says so.
    """
    predicted = None
    if keeps_predictions and innovations.predicted is not None:
        predicted = select_steps(innovations.predicted, steps)
    return Innovation(
        nu=innovations.nu[:, steps], S=innovations.S[:, :, steps], predicted=predicted
    )


def join_steps(states: Gaussian, steps: Index) -> Gaussian:
    """Return the Gaussians before K steps, of indices (K,), as one batch (K M,), step after step.

    ``states`` has means (n, T + 1, M), of which the first is that before the first step.
    """
    n = len(states.mean)
    mean = states.mean[:, steps].reshape(n, -1)
    return Gaussian(mean, states.cov[:, :, steps].reshape(n, n, -1))


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

    def initialize(self, model: Model, prior: Distribution) -> Gaussian:
        """Start from the prior's moments, or from those of two-point differencing."""
        # By the key `start` converted scans replace the prior; the key `P0` replaces its covariance.
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

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a conversion without two scans of a radar, and variances of several components."""
        conflicts = super().conflicts(scenario)
        motion, sensor = scenario.model
        if self.robust is not None and self.R is not None:
            conflicts["R"] = (
                "has no effect beside `robust`, which weighs the sensor's R: set it by `assume`"
            )
        if self.start is not None and not issubclass(scenario.prior_type, Convertible):
            conflicts["start"] = "needs a start from two scans, such as `start: two-scan`"
        # One variance serves a scalar state or measurement only.
        for key, part in (("Q", motion), ("P0", motion), ("R", sensor)):
            if getattr(self, key) is not None and len(part.components) > 1:
                conflicts[key] = "is one variance for several components; set the noise by `assume`"
        return conflicts

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report also ``noise_mean`` as idle if the process noise is normal."""
        return super().idle_keys(scenario) | idle_noise_mean(scenario)
