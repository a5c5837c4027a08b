"""Interacting multiple model filter, with any motions and any filter of one Gaussian."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Annotated, ClassVar, Literal, NamedTuple, cast

import numpy as np
from numpy.random import Generator

from trackbench.core import linalg
from trackbench.core.arrays import Array, Mask, any_nan
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.kalman import Innovation
from trackbench.core.mixtures import (
    combine,
    common_components,
    given_later,
    log_mixture,
    pad,
    predict_weights,
    update_weights,
)
from trackbench.core.smoothing import Transition, backwards, smooth_step
from trackbench.core.sums import total
from trackbench.field_types import InvalidKeyError, Registered
from trackbench.filters.base import FixedLag, SmoothingFilter
from trackbench.filters.ekf import EKF
from trackbench.filters.jump_markov import JumpMarkov, shared_components
from trackbench.filters.kf import GaussianFilter, of_refusals
from trackbench.models.base import Model, Scene, angle_rows, extra_std
from trackbench.models.priors import augment_gaussian
from trackbench.registry import register

_EKF = EKF()


class ModelBank(NamedTuple):
    """A Gaussian per model, with the models' weights."""

    states: tuple[Gaussian, ...]
    weights: Array
    """weights of the models (r, M)"""
    nis: Array
    """mean NIS of the models (M,)"""
    reported: int
    """number of components that the estimate has"""
    innovations: tuple[Innovation, ...] = ()
    predicted: Array | None = None
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
        n, states = self.reported, self.states
        if any(len(s.mean) > n for s in states):
            states = tuple(Gaussian(s.mean[:n], s.cov[:n, :n]) for s in states)
        return combine(states, self.weights, angles=self.angles)

    @property
    def prediction(self) -> Gaussian | None:
        """Estimate of the step without its measurement, bit for bit; None if it is not stored."""
        states = [i.predicted for i in self.innovations if i.predicted is not None]
        if self.predicted is None or len(states) < len(self.states):
            return None
        return self._replace(states=tuple(states), weights=self.predicted).moments


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
        """Also what the models' filter requires of sensor and prior."""
        return (*self.requires, *(n for n in self.filter.requires if not n.startswith("motion.")))

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject motions that do not fit the target, and conflicts of the models' filter with them."""
        misfits = super().conflicts(scenario)
        if misfits:
            return misfits
        out: dict[str, str] = {}
        # Check the filter with each of the motions.
        for model in self.models(scenario.model):
            out |= self.filter.conflicts(_with_model(scenario, model))
        return {f"filter.{key}".rstrip("."): what for key, what in out.items()}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Report also the keys of the models' filter that are idle with every motion."""
        first, *others = (
            self.filter.idle_keys(_with_model(scenario, model))
            for model in self.models(scenario.model)
        )
        shared = set(first).intersection(*others)
        of_all = {f"filter.{key}": why for key, why in first.items() if key in shared}
        return super().idle_keys(scenario) | of_all

    def cautions(self, scenario: Scene) -> list[str]:
        """Return the notes on the models' filter."""
        return self.filter.cautions(scenario)

    def init(self, model: Model, prior: Distribution, rng: Generator) -> ModelBank:
        """Start every model from the prior."""
        n, runs = len(shared_components(model.motion)), prior.mean.shape[1]
        first = self.filter.initialize(model, prior)
        first = Gaussian(first.mean[:n], first.cov[:n, :n])
        states = tuple(augment_gaussian(first, extra_std(m.motion)) for m in self.models(model))
        weights = np.repeat(self.initial_weights[:, None], runs, axis=1)
        angles = tuple(i for i in angle_rows(self.models(model)[0].motion) if i < n)
        nis = np.full(runs, np.nan)
        return ModelBank(states, weights, nis=nis, reported=n, angles=angles)

    def step(self, model: Model, state: ModelBank, z: Array, k: int, rng: Generator) -> ModelBank:
        """Mix, filter with every model, weigh by the likelihoods (Blom & Bar-Shalom 1988)."""
        # Step 1: predicted weights c_j = sum_i p_ij mu_i, mixing weights p_ij mu_i / c_j.
        predicted, mixing = predict_weights(state.weights, np.array(self.transition))
        models, mixed_states = self.models(model), []
        names = [m.motion.components for m in models]
        for j, like in enumerate(state.states):
            # Step 2: mix the states, each filled up to the components of model j; means of an angle are
            # first brought near each other.
            filled = [
                pad(s, like, common_components(of, names[j]), self.mixing == "unbiased")
                for s, of in zip(state.states, names, strict=True)
            ]
            spreadless = self._without_spread(names, j)
            angles = angle_rows(models[j].motion)
            mixed = combine(filled, mixing[:, j], spreadless, angles)
            mixed_states.append(self.filter.prepared(mixed))
        # Step 3: filter with every model.
        pairs = [*zip(models, mixed_states, strict=True)]
        updated = [self.filter.robust_update(of, mixed, z, k) for of, mixed in pairs]
        states, innovations, sensor_weights = zip(*updated, strict=True)
        if self.smooths:  # all states stay in memory
            innovations = tuple(innovation._replace(predicted=None) for innovation in innovations)
        # Step 4: weights mu_j ~ c_j N(nu_j; 0, S_j).
        judged = [innovation.nis_and_scale() for innovation in innovations]
        nis, mantissa, exponent = map(np.array, zip(*judged, strict=True))
        refused = np.zeros(z.shape, dtype=np.bool_)
        innovations_used = innovations
        if self.filter.gate is not None:
            # Leave out what every model's gate refuses; without any other measurement predict only.
            by_model = [
                self.filter.refused_components(model.sensor, z, innovation, nis_of_model)
                for innovation, nis_of_model in zip(innovations, nis, strict=True)
            ]
            refused = np.logical_and.reduce(by_model)
            z = np.where(refused, np.nan, z)
            updated = [self.filter.robust_update(of, mixed, z, k) for of, mixed in pairs]
            states, accepted, sensor_weights = zip(*updated, strict=True)
            # The likelihoods are those of the measurements of the other sensors.
            partly = refused.any(axis=0) & ~np.isnan(z).all(axis=0)
            if partly.any():
                judged = [innovation.nis_and_scale() for innovation in accepted]
                of_accepted = map(np.array, zip(*judged, strict=True))
                nis, mantissa, exponent = (
                    np.where(partly, new, old)
                    for new, old in zip(of_accepted, (nis, mantissa, exponent), strict=True)
                )
                innovations_used = accepted
        ratios = np.array([*map(self.filter.log_ratio, innovations_used, nis)])
        weights = update_weights(predicted, nis - 2.0 * ratios, mantissa, exponent)
        mean_nis = total(predicted * nis, axis=0)
        if any_nan(z):
            missing = np.isnan(z).all(axis=0)
            weights = np.where(missing, predicted, weights)
            mean_nis = np.where(missing, np.nan, mean_nis)
        bank = state._replace(
            states=states,
            weights=weights,
            nis=mean_nis,
            innovations=innovations,
            predicted=predicted,
            measurement_weight=None,
        )
        if self.filter.robust is not None:
            mean = total(predicted * np.stack(sensor_weights), axis=0)
            bank = bank._replace(measurement_weight=mean)
        gated = self.filter.number_of_refused(model.sensor, refused)
        return bank._replace(refused=refused, gated=gated)

    def refused(self, state: ModelBank) -> Mask | None:
        """Return the components (n_z, M) that the gates of all models refused."""
        return None if self.filter.gate is None else state.refused

    def smoothed(
        self, model: Model, states: list[ModelBank], k: int, rng: Generator
    ) -> list[ModelBank]:
        """Smooth states and weights of the models at every step (Heskes & Zoeter 2002)."""
        models = self.models(model)

        def one_back(step: int, later: ModelBank) -> ModelBank:
            bank, rows, smoothed = states[step], [], []
            priors = [per_run_moments(state) for state in bank.states]
            _, mixing = predict_weights(bank.weights, np.array(self.transition))
            for j, to in enumerate(models):
                # Step 1: predict each state i by model j.
                pairs = zip(models, priors, strict=True)
                moves = [self._move(of, x, to, priors[j], k + 1 + step) for of, x in pairs]
                # Step 2: x_{k+1} given i, j and all z; Pr(i, j | all z) = mu_j|T p_ij mu_i c_ij / c_j.
                predicted = [move.predicted for move in moves]
                angles = angle_rows(to.motion)
                ends, log_c = given_later(predicted, mixing[:, j], later.states[j], angles)
                share = update_weights(mixing[:, j], -2.0 * log_c)
                rows.append(later.weights[j] * share)
                # Step 3: smooth each state i.
                smoothed.append(list(map(smooth_step, priors, moves, ends)))
            # Step 4: collapse over the models j of the next step.
            joint = np.stack(rows)
            weights = total(joint, axis=0)
            joint /= np.where(weights > 0.0, weights, 1.0)
            merged = []
            for i, x in enumerate(zip(*smoothed, strict=True)):
                merged.append(combine(x, joint[:, i], angles=angle_rows(models[i].motion)))
            return bank._replace(states=tuple(merged), weights=weights)

        return backwards(states, one_back, self.lag)

    def _move(self, of: Model, state: Gaussian, to: Model, like: Gaussian, k: int) -> Transition:
        """Predict a model's state to step k by another model, with the covariance of both."""
        names, others = of.motion.components, to.motion.components
        shared = common_components(names, others)
        y = per_run_moments(pad(state, like, shared, self.mixing == "unbiased"))
        transition = self.filter.faded_transition(to, y, k)
        if names == others:
            return transition
        # Regress the state on y, which has the other model's components: C = cov(x, y) P_y^-1 C_y.
        cross = np.zeros((len(names), *y.cov.shape[1:]))
        cross[:, list(shared[1])] = state.cov[:, list(shared[0])]
        return replace(transition, cross=linalg.matmul(Transition(y, cross).gain, transition.cross))

    def _without_spread(self, names: list[tuple[str, ...]], j: int) -> list[list[int]]:
        """List the components of model j that each state lacks, if they enter without spread."""
        if self.mixing != "zero-mean":
            return []
        missing = []
        for of_state in names:
            missing.append([i for i, name in enumerate(names[j]) if name not in of_state])
        return missing

    def estimate(self, state: ModelBank) -> Gaussian:
        """Return the moments of the mixture, without components that only some models have."""
        return state.moments

    def log_likelihood(self, state: ModelBank) -> Array:
        """Return the logarithm (M,) of the models' likelihoods, summed with predicted weights."""
        if state.predicted is None:
            return np.full(state.nis.shape, np.nan)
        each = np.array([*map(self.filter.log_density, state.innovations)])
        return log_mixture(state.predicted, each)

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of `diagnostics`."""
        return self.filter.diagnostic_names | {"mode"}

    def diagnostics(self, state: ModelBank) -> dict[str, Array]:
        """Report ``nis``, the models' mean; ``mode``, weight of all but the first; ``gated``."""
        refusals = of_refusals(self.filter, state.nis, state.gated, state.measurement_weight)
        return {"nis": state.nis, "mode": 1.0 - state.weights[0]} | refusals


def _with_model(scenario: Scene, model: Model) -> Scene:
    """Replace the model of a scenario, for the hooks of the models' filter."""
    facts = {name: getattr(scenario, name) for name in ("steps", "times", "prior_type", "turns")}
    return cast(Scene, SimpleNamespace(model=model, **facts))
