"""Interacting multiple model filter: any motions, whatever their states, and any Gaussian step."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Index
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.mixtures import (
    combine,
    common_components,
    log_mixture,
    pad,
    predict_weights,
    update_weights,
)
from trackbench.core.sums import total
from trackbench.field_types import InvalidKeyError, Registered
from trackbench.filters.ekf import EKF
from trackbench.filters.gaussian_base import GaussianFilter
from trackbench.filters.jump_markov import JumpMarkov, own_components
from trackbench.models.base import Model, Scene, extra_std
from trackbench.models.priors import augment_gaussian
from trackbench.registry import register

_EKF = EKF()


class Models(NamedTuple):
    """A Gaussian per model, their weights (r, M), the mixture's NIS (M,), components reported.

    ``seen`` are the models' innovations and ``predicted`` their weights before it, once there are any.
    """

    states: tuple[Gaussian, ...]
    weights: Array
    nis: Array
    reported: int
    seen: tuple[Innovation, ...] = ()
    predicted: Array | None = None


@register("filters", "imm")
@dataclass(frozen=True, kw_only=True)
class IMM(JumpMarkov[Models]):
    """Interacting multiple model filter (Blom & Bar-Shalom 1988).

    The first motion is the quiescent one: ``mode`` reports the weight of all others.
    """

    mixing: Literal["unbiased", "zero"] = "unbiased"
    """how a smaller state is filled to mix with a larger: the larger's own moments, or zeros"""
    filter: Annotated[GaussianFilter, Registered("filters")] = _EKF
    """filter of each model: ekf, ukf, {kind: cmkf, conversion: mucm}; of a linear model ekf is the
    Kalman filter"""
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "believes in motions of its own"}

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.filter, GaussianFilter):
            raise InvalidKeyError("is no filter of one Gaussian", "filter")
        if self.filter.gate is not None:
            raise InvalidKeyError("the models of an IMM refuse no measurement", "filter", "gate")

    @property
    def all_requirements(self) -> tuple[str, ...]:
        """Of sensor and start also what the models' filter needs; their motions are its own."""
        return (*self.requires, *(n for n in self.filter.requires if not n.startswith("motion.")))

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Motions that do not fit; what the models' filter cannot do with one of them."""
        misfits = super().conflicts(scenario)
        if misfits:
            return misfits
        found: dict[str, str] = {}
        for own in self.models(scenario.model):
            found |= self.filter.conflicts(_Believed(scenario, own))
        return {f"filter.{key}".rstrip("."): what for key, what in found.items()}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Its own, and those of the models' filter that are idle with each of the motions."""
        first, *others = (
            self.filter.idle_keys(_Believed(scenario, own)) for own in self.models(scenario.model)
        )
        of_all = {f"filter.{k}": why for k, why in first.items() if all(k in o for o in others)}
        return super().idle_keys(scenario) | of_all

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Models:
        """The prior in every model."""
        n, runs = own_components(model.motion), prior.mean.shape[1]
        first = self.filter.started(model, prior)
        first = Gaussian(first.mean[:n], first.cov[:n, :n])
        states = tuple(augment_gaussian(first, extra_std(own.motion)) for own in self.models(model))
        weights = np.repeat(self.at_first[:, None], runs, axis=1)
        return Models(states, weights, np.full(runs, np.nan), n)

    def step(self, model: Model, state: Models, z: Array, k: int, rng: Generator) -> Models:
        """Mix, filter with every model, weigh by the likelihoods."""
        predicted, mixing = predict_weights(state.weights, np.array(self.transition))
        models, states, all_seen = self.models(model), [], []
        names = [own.motion.components for own in models]
        for j, own in enumerate(models):
            like = state.states[j]
            padded_to = [
                pad(s, like, common_components(of, names[j]), self.mixing == "unbiased")
                for s, of in zip(state.states, names, strict=True)
            ]
            posterior, seen = self.filter.updated(own, combine(padded_to, mixing[:, j]), z, k)
            states.append(posterior)
            all_seen.append(seen)
        judged = [seen.nis_and_scale() for seen in all_seen]
        nis, scale = (np.stack(rows) for rows in zip(*judged, strict=True))
        weights = update_weights(predicted, nis, scale)
        nis_of_all = total(predicted * nis, axis=0)
        missing = np.isnan(z).all(axis=0)
        if missing.any():
            weights = np.where(missing, predicted, weights)
            nis_of_all = np.where(missing, np.nan, nis_of_all)
        return Models(
            tuple(states), weights, nis_of_all, state.reported, tuple(all_seen), predicted
        )

    def estimate(self, state: Models) -> Gaussian:
        """Moments of the mixture, of the scenario's own components."""
        n = state.reported
        own = [Gaussian(s.mean[:n], s.cov[:n, :n]) for s in state.states]
        return combine(own, state.weights)

    def log_likelihood(self, state: Models) -> Array:
        """Logarithm (M,) of the models' likelihoods by predicted weight."""
        if state.predicted is None:
            return np.full(state.nis.shape, np.nan)
        each = np.stack([seen.log_likelihood for seen in state.seen])
        return log_mixture(state.predicted, each)

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return frozenset({"nis", "mode"})

    def diagnostics(self, state: Models) -> dict[str, Array]:
        """``nis``: the models' mean NIS by predicted weight; ``mode``: weight of all but the first."""
        return {"nis": state.nis, "mode": 1.0 - state.weights[0]}


class _Believed(Scene):
    """A scenario as the filter of one model sees it."""

    def __init__(self, scenario: Scene, model: Model) -> None:
        self._scenario, self._model = scenario, model

    @property
    def model(self) -> Model:
        return self._model

    @property
    def steps(self) -> Index:
        return self._scenario.steps

    @property
    def times(self) -> Array:
        return self._scenario.times

    @property
    def prior_type(self) -> type[Distribution]:
        return self._scenario.prior_type
