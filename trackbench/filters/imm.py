"""Interacting multiple model filter, with any motions and any filter of one Gaussian."""

from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index, Mask, any_nan
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.fixed_lag_smoothing import backwards
from trackbench.core.imm_probabilities_and_mixing import mix_states, predict_weights, update_weights
from trackbench.core.kalman import Innovation
from trackbench.core.mixtures import combine, log_mixture
from trackbench.core.sums import total
from trackbench.field_types import InvalidKeyError, Registered
from trackbench.filters.all_steps_at_once import join_steps, select_innovation, select_steps
from trackbench.filters.base import Steps
from trackbench.filters.ekf import EKF
from trackbench.filters.gaussian_base import GaussianFilter
from trackbench.filters.imm_smoother import WeightedStates, cross_transition, smooth_one_back
from trackbench.filters.imm_steps_at_once import Interacting, interact, matrices_of_models
from trackbench.filters.jump_markov_base import JumpMarkov, position_velocity_components
from trackbench.filters.smoother_keys import FixedLag, SmoothingFilter
from trackbench.models.augmented_priors import augment_gaussian
from trackbench.models.base import Model, Scene, angle_rows, extra_std
from trackbench.models.sensors.compiled_sensors import measured_by_kernel
from trackbench.registry import register

_EKF = EKF()


class ModelBank(NamedTuple):
    """A Gaussian per model, with the models' weights."""

    states: tuple[Gaussian, ...]
    """posterior of each of the r models"""
    weights: Array
    """weights of the models (r, M)"""
    nis: Array
    """mean NIS of the models (M,)"""
    reported: int
    """number of components that the estimate has"""
    innovations: tuple[Innovation, ...] = ()
    """innovation of each model, the refused components included"""
    predicted_weights: Array | None = None
    """weights of the models before the last measurement (r, M)"""
    refused: Mask | None = None
    """components (n_z, M) of the last measurement that the gates of all models refused"""
    gated: Array | None = None
    """number of measurements (M,), one of each sensor, that they refused"""
    angles: tuple[int, ...] = ()
    """components of the estimate that are angles"""
    measurement_weight: Array | None = None
    """mean weight of the last measurement's components (M,) in a robust update"""

    @property
    def moments(self) -> Gaussian:
        """Moments of the mixture, of the components that all models have."""
        n = self.reported
        states = self.states
        if any(len(state.mean) > n for state in states):
            states = tuple(Gaussian(state.mean[:n], state.cov[:n, :n]) for state in states)
        return combine(states, self.weights, angles=self.angles)

    @property
    def prediction(self) -> Gaussian | None:
        """Estimate that the step gives bit for bit without its measurement; None if it is not stored."""
        states = [i.predicted for i in self.innovations if i.predicted is not None]
        if self.predicted_weights is None or len(states) < len(self.states):
            return None
        return self._replace(states=tuple(states), weights=self.predicted_weights).moments


class _Filtered(NamedTuple):
    """Results of one step of the filter of every model."""

    states: tuple[Gaussian, ...]
    innovations: tuple[Innovation, ...]
    robust_weights: tuple[Array | None, ...]
    """mean weight (M,) of the measured components in each model's robust update; None without one"""


class _Likelihoods(NamedTuple):
    """Likelihoods of the models' innovations, ``exp(-nis / 2) / (mantissa 2^exponent)``."""

    innovations: tuple[Innovation, ...]
    nis: Array
    """NIS (r, M)"""
    mantissa: Array
    """mantissa (r, M) of sqrt(det S)"""
    exponent: Array
    """exponent (r, M) of sqrt(det S)"""


class _Gated(NamedTuple):
    """Step of the models without the measurements that all their gates refuse."""

    refused: Mask
    """refused components (n_z, M)"""
    refused_count: Array
    """number of refused measurements (M,), one of each sensor"""
    used: Array
    """measurements (n_z, M) with NaN for the refused components"""
    filtered: _Filtered
    likelihoods: _Likelihoods


@register("filters", "imm")
@dataclass(frozen=True, kw_only=True)
class IMM(SmoothingFilter[ModelBank], JumpMarkov[ModelBank]):
    """Interacting multiple model filter (Blom & Bar-Shalom 1988).

    The first motion is the quiescent one: ``mode`` reports the weight of all others. The smoother is
    the backward pass of expectation propagation (Heskes & Zoeter 2002).
    """

    mixing: Literal["unbiased", "zero", "zero-mean"] = "unbiased"
    """components that a smaller state lacks in the mixing: moments of the larger state, or zeros, whose
    spread about the mixed mean is left out by zero-mean, as the EKF/UKF Toolbox does"""
    filter: Annotated[GaussianFilter, Registered("filters")] = _EKF
    """filter of each model: ekf, ukf, {kind: cmkf, conversion: mucm}; for a linear model ekf is the
    Kalman filter. Its `gate` refuses a measurement that is outside the gates of all models"""
    smooth: bool | FixedLag = False
    """estimate each step from all measurements of the run, or from so many later ones: {lag: 5}"""
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "has motions of its own"}
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"gated"})

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.filter, GaussianFilter):
            raise InvalidKeyError("must be a filter of one Gaussian, such as ekf or ukf", "filter")
        if self.filter.smooths:
            raise InvalidKeyError("must stand beside `filter`, not in it", "filter", "smooth")

    @property
    def all_requirements(self) -> tuple[str, ...]:
        """Also what the models' filter requires of sensor and prior; the IMM has its own motions."""
        of_filter = [name for name in self.filter.requires if not name.startswith("motion.")]
        return self.requires + tuple(of_filter)

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject motions that do not fit the target, and conflicts of the models' filter with them."""
        misfits = super().conflicts(scenario)
        if misfits:
            return misfits
        # Check the filter with each of the motions.
        conflicts: dict[str, str] = {}
        for model in self.models(scenario.model):
            conflicts |= self.filter.conflicts(_with_model(scenario, model))
        # The key of a conflict is below `filter`, or is `filter` if it concerns the whole filter.
        return {f"filter.{key}".rstrip("."): reason for key, reason in conflicts.items()}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report also the keys of the models' filter that are idle with every motion."""
        idle_by_model = [
            self.filter.idle_keys(_with_model(scenario, model))
            for model in self.models(scenario.model)
        ]
        idle = super().idle_keys(scenario)
        for key, reason in idle_by_model[0].items():
            if all(key in idle_keys for idle_keys in idle_by_model):
                idle[f"filter.{key}"] = reason
        return idle

    def cautions(self, scenario: Scene) -> list[str]:
        """Return the notes on the models' filter."""
        return self.filter.cautions(scenario)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> ModelBank:
        """Start every model from the prior."""
        models = self.models(model)
        n = len(position_velocity_components(model.motion))
        runs = prior.mean.shape[1]
        # Each state has the shared components of the prior, and those that its motion adds.
        first = self.filter.initialize(model, prior)
        shared = Gaussian(first.mean[:n], first.cov[:n, :n])
        return ModelBank(
            states=tuple(augment_gaussian(shared, extra_std(m.motion)) for m in models),
            weights=np.repeat(self.initial_weights[:, None], runs, axis=1),
            nis=np.full(runs, np.nan),
            reported=n,  # the estimate has the shared components alone
            angles=tuple(i for i in angle_rows(models[0].motion) if i < n),
        )

    def step(self, model: Model, state: ModelBank, z: Array, k: int, rng: Generator) -> ModelBank:
        """Mix, filter with every model, weigh by the likelihoods (Blom & Bar-Shalom 1988)."""
        models = self.models(model)
        # Step 1: predicted weights c_j = sum_i p_ij mu_i, mixing weights mu_i|j = p_ij mu_i / c_j.
        predicted_weights, mixing_weights = predict_weights(
            state.weights, np.array(self.transition)
        )
        # Step 2: mix the states that model j starts from, with weights mu_i|j.
        names = [m.motion.components for m in models]
        angles = [angle_rows(m.motion) for m in models]
        moments = mix_states(state.states, mixing_weights, names, angles, self.mixing)
        # With a fading memory, or as a square root, if the filter's keys ask so.
        mixed = [self.filter.prepared(of_model) for of_model in moments]
        # Step 3: filter with every model.
        first = self._filter_each(models, mixed, z, k)
        likelihoods = _likelihoods(first.innovations)
        if self.filter.gate is None:
            gated = _Gated(
                refused=np.zeros(z.shape, dtype=np.bool_),
                refused_count=np.zeros(z.shape[1]),
                used=z,
                filtered=first,
                likelihoods=likelihoods,
            )
        else:
            gated = self._gate(models, mixed, likelihoods, z, k)
        # Step 4: weights mu_j ~ c_j N(nu_j; 0, S_j), and mean NIS of the models.
        weights, nis = self._weigh(predicted_weights, gated.likelihoods, gated.used)
        # The states are those of the second pass if there is a gate, the innovations of the first.
        return state._replace(
            states=gated.filtered.states,
            weights=weights,
            nis=nis,
            innovations=first.innovations,
            predicted_weights=predicted_weights,
            refused=gated.refused,
            gated=gated.refused_count,
            # Of the measurement in a robust update, not of a model: None without the filter's `robust`.
            measurement_weight=self._mean_robust_weight(predicted_weights, gated.filtered),
        )

    def all_steps(self, model: Model, state: ModelBank, z: Array, k: int) -> Steps | None:
        """Filter all measurements z (n_z, T, M) in one call; None unless the models allow it.

        They must be linear with the same components, with a constant sensor, and filtered by a plain
        EKF. The sensor may also be a radar of `measured_by_kernel`.
        """
        # The filter must have the defaults of all its keys, and be of no subclass of EKF.
        if type(self) is not IMM or self.filter != _EKF or type(self.filter) is not EKF:
            return None
        models = self.models(model)
        matrices = matrices_of_models(models, k, z.shape[1])
        if matrices is None:
            return None
        transition = np.array(self.transition)
        measured = measured_by_kernel(model.sensor, matrices[0].motion.size)
        radar = None
        if measured is not None and measured.is_radar:
            radar = measured
        interacting = interact(state.states, state.weights, matrices, transition, z, radar)
        if interacting is None:
            return None
        # A smoother stores the states of all steps. It predicts by itself, so their predictions are left
        # out.
        return _steps_of(interacting, state, z, keeps_predictions=not self.smooths)

    def estimate(self, state: ModelBank) -> Gaussian:
        """Return the moments of the mixture, without components that only some models have."""
        return state.moments

    def _filter_each(
        self, models: list[Model], mixed: list[Gaussian], z: Array, k: int
    ) -> _Filtered:
        """Predict and update the mixed state of every model with z (n_z, M).

        A robust weight (M,) is the mean weight of the measured components in a model's robust update;
        None without the filter's key ``robust``.
        """
        states = []
        innovations = []
        robust_weights = []
        for model, before in zip(models, mixed, strict=True):
            posterior, innovation, weight = self.filter.predict_and_update(model, before, z, k)
            if self.smooths:
                # The smoother keeps the states of all steps in memory: leave out their predictions.
                innovation = innovation._replace(predicted=None)
            states.append(posterior)
            innovations.append(innovation)
            robust_weights.append(weight)
        return _Filtered(tuple(states), tuple(innovations), tuple(robust_weights))

    def _gate(
        self,
        models: list[Model],
        mixed: list[Gaussian],
        likelihoods: _Likelihoods,
        z: Array,
        k: int,
    ) -> _Gated:
        """Filter again without the components of z that the gates of all models refuse.

        ``mixed`` are the states before the step, and ``likelihoods`` those of the first pass with all
        components. Runs without a remaining component are only predicted.
        """
        # Step 1: the components that the gates of all models refuse, by the first pass.
        refused_by_model = [
            self.filter.refused_components(models[j].sensor, z, innovation, likelihoods.nis[j])
            for j, innovation in enumerate(likelihoods.innovations)
        ]
        refused = np.logical_and.reduce(refused_by_model)  # (n_z, M)
        # Step 2: the second pass.
        used = np.where(refused, np.nan, z)
        second = self._filter_each(models, mixed, used, k)
        # Step 3: where some measurements are left, the likelihoods are those of these measurements. A
        # run without any keeps those of the first pass, which `_weigh` does not use.
        partly = refused.any(axis=0) & ~np.isnan(used).all(axis=0)
        if partly.any():
            of_used = _likelihoods(second.innovations)
            likelihoods = _Likelihoods(
                innovations=of_used.innovations,
                nis=np.where(partly, of_used.nis, likelihoods.nis),
                mantissa=np.where(partly, of_used.mantissa, likelihoods.mantissa),
                exponent=np.where(partly, of_used.exponent, likelihoods.exponent),
            )
        return _Gated(
            refused=refused,
            # All models have the same sensor.
            refused_count=self.filter.count_refused(models[0].sensor, refused),
            used=used,
            filtered=second,
            likelihoods=likelihoods,
        )

    def _weigh(
        self, predicted_weights: Array, likelihoods: _Likelihoods, z: Array
    ) -> tuple[Array, Array]:
        """Return the models' weights (r, M) after the measurements z (n_z, M), and the mean NIS (M,).

        A likelihood is ``exp(-nis / 2) / (mantissa 2^exponent)``, in three parts as it may underflow.
        The mean NIS is by the predicted weights (r, M). A run without a measurement keeps the predicted
        weights, and its NIS is NaN.
        """
        nis = likelihoods.nis
        # A robust law of the innovation in place of N(0, S) changes its likelihood by this ratio.
        innovations = likelihoods.innovations
        log_ratios = np.array(
            [self.filter.log_ratio(nu, nis[j]) for j, nu in enumerate(innovations)]
        )
        weights = update_weights(
            predicted_weights,
            nis - 2.0 * log_ratios,
            likelihoods.mantissa,
            likelihoods.exponent,
        )
        mean_nis = total(predicted_weights * nis, axis=0)
        if any_nan(z):
            missing = np.isnan(z).all(axis=0)
            weights = np.where(missing, predicted_weights, weights)
            mean_nis = np.where(missing, np.nan, mean_nis)
        return weights, mean_nis

    def _mean_robust_weight(self, predicted_weights: Array, filtered: _Filtered) -> Array | None:
        """Average the models' robust weights (M,) of the measured components.

        As the mean NIS, it is taken with the models' probabilities (r, M) before the measurement. None
        if the filter has no key ``robust``.
        """
        if self.filter.robust is None:
            return None
        # With the key no model's weight is None.
        robust_weights = [weight for weight in filtered.robust_weights if weight is not None]
        return total(predicted_weights * np.stack(robust_weights), axis=0)

    def refused(self, state: ModelBank) -> Mask | None:
        """Return the components (n_z, M) that the gates of all models refused."""
        return None if self.filter.gate is None else state.refused

    def smoothed(
        self, model: Model, states: list[ModelBank], k: int, rng: Generator
    ) -> list[ModelBank]:
        """Smooth states and weights of the models at every step (Heskes & Zoeter 2002).

        It uses all later measurements, or those of `lag` steps. ``k`` is the step of the first state. No
        random numbers are drawn.
        """
        models = self.models(model)
        predict = partial(cross_transition, self.filter, unbiased=self.mixing == "unbiased")

        def smooth_bank(step: int, later: ModelBank) -> ModelBank:
            """Smooth ``states[step]``, that of step k + step; ``later`` is the next one, smoothed."""
            bank = states[step]
            smoothed = smooth_one_back(
                models,
                WeightedStates(bank.states, bank.weights),
                WeightedStates(later.states, later.weights),
                np.array(self.transition),
                predict,
                k + step + 1,
            )
            return bank._replace(states=smoothed.states, weights=smoothed.weights)

        return backwards(states, smooth_bank, self.lag)

    def log_likelihood(self, state: ModelBank) -> Array:
        """Return the logarithm (M,) of the models' likelihoods, summed with predicted weights.

        It is NaN before the first measurement, when no weights are predicted.
        """
        if state.predicted_weights is None:
            return np.full(state.nis.shape, np.nan)
        log_densities = [self.filter.log_density(innovation) for innovation in state.innovations]
        return log_mixture(state.predicted_weights, np.array(log_densities))

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of `diagnostics`."""
        return self.filter.diagnostic_names | {"mode"}

    def diagnostics(self, state: ModelBank) -> dict[str, Array]:
        """Report ``nis``, the models' mean; ``mode``, weight of all but the first; ``gated``.

        The first model is the quiescent one, so that ``mode`` is the probability of a maneuver.
        """
        weight_of_others = 1.0 - state.weights[0]
        values = {"nis": state.nis, "mode": weight_of_others}
        return values | self.filter.gate_and_weight_diagnostics(
            state.nis, state.gated, state.measurement_weight
        )


def _steps_of(
    interacting: Interacting, first: ModelBank, z: Array, keeps_predictions: bool
) -> Steps:
    """Return the results of `interact` as `Steps`.

    The steps begin after the state ``first`` and use z (n_z, T, M). ``keeps_predictions`` stores the
    predictions in the states.
    """
    # Arrays of states begin with the first state, those of measurements after it.
    posteriors = [select_steps(state, slice(1, None)) for state in interacting.states]
    weights_after = interacting.weights[:, 1:]

    def state_after(steps: int | slice) -> ModelBank:
        """Return the state after the measurement of this index, or of several as one batch."""
        innovations = [
            select_innovation(innovation, steps, keeps_predictions)
            for innovation in interacting.innovations
        ]
        # What no step changes is that of the state before the steps.
        return first._replace(
            states=tuple(select_steps(posterior, steps) for posterior in posteriors),
            weights=weights_after[:, steps],
            nis=interacting.nis[steps],
            innovations=tuple(innovations),
            predicted_weights=interacting.predicted_weights[:, steps],
            # Without a gate nothing is refused.
            refused=np.zeros(z[:, steps].shape, dtype=np.bool_),
            gated=np.zeros(z[0, steps].shape),
            measurement_weight=None,
        )

    def state_of_all_steps() -> ModelBank:
        """Return one state whose batch (T, M) is all steps, with the predictions if they are kept."""
        return state_after(slice(None))

    def state_before(steps: Index) -> ModelBank:
        """Return one state before the steps of the indices (K,), with the means (n, K M).

        The batch (K M,) has the M runs of the first of these steps, then those of the second, and so on.
        """
        states = tuple(join_steps(state, steps) for state in interacting.states)
        weights = interacting.weights[:, steps].reshape(len(states), -1)
        unknown = np.full(weights.shape[1], np.nan)
        # `IMM.step` reads states and weights alone, and replaces all that a measurement gives.
        return first._replace(states=states, weights=weights, nis=unknown, innovations=())

    # The estimate has no components that only the motions have.
    n = first.reported
    moments = interacting.estimate
    # The first model is the quiescent one: all others together have the probability of a maneuver.
    weight_of_others = 1.0 - weights_after[0]
    return Steps(
        estimate=Gaussian(moments.mean[:n], moments.cov[:n, :n]),
        diagnostics={"nis": interacting.nis, "mode": weight_of_others},
        state=state_after,
        together=state_of_all_steps,
        before=state_before,
    )


def _likelihoods(innovations: tuple[Innovation, ...]) -> _Likelihoods:
    """Compute NIS and sqrt(det S) of the models' innovations, each (r, M)."""
    nis, mantissa, exponent = zip(*[nu.nis_and_scale() for nu in innovations], strict=True)
    return _Likelihoods(innovations, np.array(nis), np.array(mantissa), np.array(exponent))


def _with_model(scenario: Scene, model: Model) -> Scene:
    """Return the facts of a scenario with another model, for the checks of the models' filter."""
    facts = {name: getattr(scenario, name) for name in ("steps", "times", "prior_type", "turns")}
    return cast(Scene, SimpleNamespace(model=model, **facts))
