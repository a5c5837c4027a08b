"""Interacting multiple model filter: any motions, whatever their states, and any Gaussian step."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.mixing import combined, padded, predicted_weights, shared, updated_weights
from trackbench.core.sums import total
from trackbench.filters.extended import EKF
from trackbench.filters.gaussian import GaussianFilter
from trackbench.keys import MistakenKeyError, PartOf, Share
from trackbench.models.base import Model, Motion, extra_std
from trackbench.models.extended import extended_gaussian
from trackbench.registry import register

_ROUNDING = 1e-9  # of a row's sum
_EKF = EKF()


class Models(NamedTuple):
    """A Gaussian per model, their weights (r, M), the mixture's NIS (M,), components reported."""

    states: tuple[Gaussian, ...]
    weights: Array
    nis: Array
    reported: int


@register("filters", "imm")
@dataclass(frozen=True, kw_only=True)
class IMM:
    """Interacting multiple model filter (Blom & Bar-Shalom 1988).

    The first motion is the quiescent one: ``mode`` reports the weight of all others.
    """

    motions: Annotated[tuple[Motion, ...], PartOf("motions")]
    """motions of the models, such as [{kind: cv, q: 0.01}, {kind: ca, q: 0.001}]"""
    transition: tuple[tuple[Share, ...], ...]
    """probability of going from model i (row) to model j in one step; rows sum to 1"""
    initial: tuple[Share, ...] | None = None
    """probability of each model at the start; default: equal"""
    mixing: Literal["unbiased", "zero"] = "unbiased"
    """how a smaller state is filled to mix with a larger: the larger's own moments, or zeros"""
    filter: Annotated[GaussianFilter, PartOf("filters")] = _EKF
    """filter of each model: ekf, ukf, {kind: cmkf, conversion: mucm}; of a linear model ekf is the
    Kalman filter"""
    needs: ClassVar[tuple[str, ...]] = ("motion.T",)
    excused: ClassVar[dict[str, str]] = {"kalman": "believes in motions of its own"}

    def __post_init__(self) -> None:
        r = len(self.motions)
        if not isinstance(self.filter, GaussianFilter):
            raise MistakenKeyError("is no filter of one Gaussian", "filter")
        if self.filter.gate is not None:
            raise MistakenKeyError("the models of an IMM refuse no measurement", "filter", "gate")
        if r < 2:
            raise MistakenKeyError("an IMM has at least two motions", "motions")
        if len(self.transition) != r:
            what = f"{len(self.transition)} rows for {r} motions"
            raise MistakenKeyError(what, "transition")
        for i, row in enumerate(self.transition):
            if len(row) != r:
                raise MistakenKeyError(f"{len(row)} entries for {r} motions", "transition", i)
            if abs(sum(row) - 1.0) > _ROUNDING:
                raise MistakenKeyError(f"the row sums to {sum(row):g}, not to 1", "transition", i)
        if self.initial is not None and len(self.initial) != r:
            raise MistakenKeyError(f"{len(self.initial)} entries for {r} motions", "initial")
        if self.initial is not None and abs(sum(self.initial) - 1.0) > _ROUNDING:
            raise MistakenKeyError(f"sums to {sum(self.initial):g}, not to 1", "initial")

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Models:
        """The prior in every model."""
        r, runs = len(self.motions), prior.mean.shape[1]
        n = len(model.motion.components) - len(extra_std(model.motion))
        first = self.filter.started(model, prior)
        first = Gaussian(first.mean[:n], first.cov[:n, :n])
        states = tuple(
            extended_gaussian(first, extra_std(own.motion)) for own in self._models(model)
        )
        start = np.full(r, 1.0 / r) if self.initial is None else np.array(self.initial)
        weights = np.repeat(start[:, None], runs, axis=1)
        return Models(states, weights, np.full(runs, np.nan), n)

    def step(self, model: Model, state: Models, z: Array, k: int, rng: Generator) -> Models:
        """Mix, filter with every model, weigh by the likelihoods."""
        predicted, mixing = predicted_weights(state.weights, np.array(self.transition))
        models, states, judged = self._models(model), [], []
        names = [own.motion.components for own in models]
        for j, own in enumerate(models):
            like = state.states[j]
            padded_to = [
                padded(s, like, shared(of, names[j]), self.mixing == "unbiased")
                for s, of in zip(state.states, names, strict=True)
            ]
            posterior, seen = self.filter.updated(own, combined(padded_to, mixing[:, j]), z, k)
            states.append(posterior)
            judged.append(seen.judged())
        nis, scale = (np.stack(rows) for rows in zip(*judged, strict=True))
        weights = updated_weights(predicted, nis, scale)
        nis_of_all = total(predicted * nis, axis=0)
        missing = np.isnan(z).all(axis=0)
        if missing.any():
            weights = np.where(missing, predicted, weights)
            nis_of_all = np.where(missing, np.nan, nis_of_all)
        return Models(tuple(states), weights, nis_of_all, state.reported)

    def _models(self, model: Model) -> list[Model]:
        """A model per motion, along the axes and over the interval of the one that is assumed."""
        own: Any = model.motion
        axes = (len(own.components) - len(extra_std(own))) // 2
        return [Model(motion.sampled(own.T, axes), model.sensor) for motion in self.motions]

    def estimate(self, state: Models) -> Gaussian:
        """Moments of the mixture, of the scenario's own components."""
        n = state.reported
        own = [Gaussian(s.mean[:n], s.cov[:n, :n]) for s in state.states]
        return combined(own, state.weights)

    def diagnostics(self, state: Models) -> dict[str, Array]:
        """``nis``: the models' mean NIS by predicted weight; ``mode``: weight of all but the first."""
        return {"nis": state.nis, "mode": 1.0 - state.weights[0]}
