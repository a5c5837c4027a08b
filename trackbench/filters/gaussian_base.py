"""Bases of the filters with one Gaussian: their state, their step, their keys.

`GaussianFilter.step` calls `update`, which each filter defines: `kf.py`, `ekf.py`, `ukf.py`, `cmkf.py`.
Gates are in `gate.py`, weights of the sensors in `robust.py`, smoothing in `core/rts_smoother.py`, and
the noise that a filter assumes in `assumed_noise.py`.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Interval
from numpy.random import Generator

from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import (
    Distribution,
    Gaussian,
    from_root,
    per_run_moments,
    root_of,
)
from trackbench.core.kalman import Innovation, Updated
from trackbench.core.polar_conversions import Conversion
from trackbench.core.rts_smoother import Transition, smooth
from trackbench.field_types import NonNegative, OpenShare, Positive
from trackbench.filters.assumed_noise import MODEL_NOISE, AssumedNoise, idle_noise_mean
from trackbench.filters.base import InnovationFilter
from trackbench.filters.ekf_linearization import extended_transition
from trackbench.filters.gate import (
    GateScope,
    count_refused,
    gate_cautions,
    idle_gate_keys,
    refused_components,
)
from trackbench.filters.robust import AnyRobust, robust_update
from trackbench.filters.singular_innovation import innovation_conflicts
from trackbench.filters.smoother_keys import FixedLag, SmoothingFilter
from trackbench.models.base import Model, Scene, Sensor
from trackbench.models.likelihood import has_own_density
from trackbench.models.two_scan_prior import Convertible


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
    """mean weight of the measured components (M,) in a robust update; None without the key `robust`"""

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
        # Step 2: predict to step k and update with z. `robust_weight` (M,) is the mean weight of the
        # measured components in a robust update, None without the key `robust`.
        posterior, innovation, robust_weight = self.predict_and_update(model, before, z, k)
        nis = innovation.nis
        if self.smooths:
            # The smoother keeps the states of all steps in memory: leave out their predictions.
            innovation = innovation._replace(predicted=None)
        updated = Tracked(posterior=posterior, nis=nis, innovation=innovation, weight=robust_weight)
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

        Parameters
        ----------
        state : Gaussian
            Posterior of step k - 1: mean (n_x, M), covariance (n_x, n_x[, M]).

        Returns
        -------
        Gaussian
            Mean (n_x, M), covariance (n_x, n_x[, M]). With ``form: square-root`` it is a `Factored`,
            with the triangular factor of its covariance.
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
            Posterior of step k - 1: mean (n_x, M), covariance (n_x, n_x[, M]). It is a `Factored`, with
            the triangular factor of its covariance, if ``form`` is square-root.
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

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : Gaussian
            Posterior of step k - 1 from `prepared`: mean (n_x, M), covariance (n_x, n_x[, M]).
        z : array (n_z, M)
            Measurements of step k; NaN where one is missing.
        k : int
            Number of the step.

        Returns
        -------
        posterior : Gaussian
            Posterior by the last weights: mean (n_x, M), covariance (n_x, n_x[, M]).
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
        With the key ``robust`` both updates weigh the measurements by their residuals.
        """
        assert updated.innovation is not None
        refused = self.refused_components(model.sensor, z, updated.innovation, updated.nis)
        posterior = updated.posterior
        nis = updated.nis
        robust_weight = updated.weight
        if refused.any():
            # Refused components count as missing: a run without any other component predicts only.
            used = np.where(refused, np.nan, z)
            posterior, accepted, robust_weight = self.predict_and_update(model, before, used, k)
            # The NIS is that of the measurements that are used.
            nis = np.where(refused.any(axis=0), accepted.nis, nis)
        return Tracked(
            posterior=posterior,
            nis=nis,
            innovation=updated.innovation,  # that of all measurements, for the likelihood
            refused=refused,
            gated=self.count_refused(model.sensor, refused),
            weight=robust_weight,
        )

    def refused_components(
        self, sensor: Sensor, z: Array, innovation: Innovation, nis: Array
    ) -> Mask:
        """Return the measured components that are beyond the gates of the keys ``gate`` and ``gate_by``.

        The filter must have the key ``gate``.

        Parameters
        ----------
        sensor : Sensor
            Sensor of the filter model, which may stand for several.
        z : array (n_z, M)
            Measurements of the step; NaN where one is missing.
        innovation : Innovation
            Innovation of the update with all measurements.
        nis : array (M,)
            NIS of that innovation.

        Returns
        -------
        array (n_z, M)
            True where a measured component is refused.
        """
        assert self.gate is not None
        return refused_components(self.gate, self.gate_by, sensor, z, innovation, nis)

    def count_refused(self, sensor: Sensor, refused: Mask) -> Array:
        """Count the measurements that have a refused component.

        As the key ``gate_by`` says, a measurement is that of all sensors at a step, or that of each
        sensor.

        Parameters
        ----------
        sensor : Sensor
            Sensor of the filter model, which may stand for several.
        refused : array (n_z, M)
            True where a component is refused, from `refused_components`.

        Returns
        -------
        array (M,)
            Number of refused measurements of each run.
        """
        return count_refused(self.gate_by, sensor, refused)

    # Smoothing.

    def smoothed(
        self, model: Model, states: list[Tracked], k: int, rng: Generator
    ) -> list[Tracked]:
        """Smooth the posterior of every step by the Rauch-Tung-Striebel recursion.

        It uses all later measurements, or those of the next `lag` steps if the key ``smooth`` has a lag.
        ``k`` is the step of the first state. No random numbers are drawn.
        """
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
        """Predict to step k as `step` does, with the covariance of both states.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : Gaussian
            Posterior of step k - 1 before fading: mean (n_x, M), covariance (n_x, n_x, M).
        k : int
            Number of the step.

        Returns
        -------
        Transition
            Prediction of x_k from the faded posterior, and cov(x, x_k) (n_x, n_x, M) of the state x
            before fading.
        """
        # The prediction starts from the faded x' ~ N(m, a^2 P). cov(x', f(x')) is a^2 cov(x, f(x')).
        transition = self.transition(model, self.prepared(state), k)
        return Transition(transition.predicted, transition.cross / (self.fading * self.fading))

    def transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k from a posterior, with the covariance of both states.

        Here the motion is linearized by its Jacobian, with the model's process noise. Filters that
        predict in another way override this method.

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
        """Return the log-density of an innovation minus that of N(0, S).

        Parameters
        ----------
        innovation : Innovation
            Innovation ``nu`` (n_z, M), NaN where a component is missing.
        nis : array (M,)
            NIS of the innovation.

        Returns
        -------
        array (M,)
            Difference of the log-densities by the law of the key ``robust``; 0 without this key.
        """
        if self.robust is None:
            return np.zeros(nis.shape)
        return self.robust.log_ratio(nis, (~np.isnan(innovation.nu)).sum(axis=0))

    def log_density(self, innovation: Innovation) -> Array:
        """Evaluate the log-density of an innovation: that of N(0, S), or of a robust law of scale S.

        Parameters
        ----------
        innovation : Innovation
            Innovation ``nu`` (n_z, M), NaN where a component is missing, and its covariance S.

        Returns
        -------
        array (M,)
            Log-density of the measured components; NaN if all are missing.
        """
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
        """Return the diagnostics of the keys ``gate`` and ``robust``.

        Parameters
        ----------
        nis : array (M,)
            Normalized innovation squared, NaN before the first measurement.
        gated : array (M,) or None
            Number of refused measurements; None before the first measurement counts as 0.
        weight : array (M,) or None
            Mean weight of the measured components; None before the first measurement gives NaN.

        Returns
        -------
        dict of array (M,)
            ``gated`` if the filter has a gate, and ``measurement_weight`` if it weighs its measurements.
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
        conflicts = innovation_conflicts(scenario)
        if conflicts:
            return conflicts
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
        """Reject a conversion of two scans that are not there, and misplaced variances.

        The key ``start`` is that conversion. A variance Q, P0 or R serves a single component, and R
        replaces nothing beside ``robust``.
        """
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
