"""Baselines without data or without memory."""

from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.filters.base import Filter
from trackbench.filters.gaussian_base import MODEL_NOISE, extended_prediction
from trackbench.models.base import Model
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.registry import register


@register("filters", "prior-mean")
@dataclass(frozen=True, kw_only=True)
class PriorMean(Filter[Gaussian]):
    """Baseline without data: mean and covariance predicted by the motion alone (linear motion)."""

    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian",)
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "uses no measurement"}
    density_only: ClassVar[bool] = True
    uses_measurements: ClassVar[bool] = False

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Gaussian:
        """Return the prior's moments."""
        return per_run_moments(prior)

    def step(self, model: Model, state: Gaussian, z: Array, k: int, rng: Generator) -> Gaussian:
        """Predict by the motion; the measurement is not used."""
        return extended_prediction(model, state, k, MODEL_NOISE)

    def estimate(self, state: Gaussian) -> Gaussian:
        """Return the prediction."""
        return state


@register("filters", "inversion")
@dataclass(frozen=True, kw_only=True)
class Inversion(Filter[Gaussian]):
    """Baseline without memory: the state that the measurement alone implies, h^-1(z)."""

    requires: ClassVar[tuple[str, ...]] = ("sensor.inverse", "sensor.jacobian", "motion.jacobian")

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Gaussian:
        """Return the prior's moments."""
        return per_run_moments(prior)

    def step(self, model: Model, state: Gaussian, z: Array, k: int, rng: Generator) -> Gaussian:
        """Invert z to h^-1(z) with variance R / h'^2; predict where z is missing."""
        sensor = cast(SquareThenLine, model.sensor)
        # x = h^-1(z), with variance R / h'(x)^2, infinite where h' is zero
        x = sensor.inverse(z, k)
        R = sensor.measurement(x, k).cov
        with np.errstate(divide="ignore"):
            cov = with_trailing(R, 1, leading=2) / np.square(sensor.jacobian(x, k))
        missing = np.isnan(z).any(axis=0)
        if not missing.any():
            return Gaussian(x, cov)
        # Predict by a linearized motion in the runs without a measurement.
        predicted = extended_prediction(model, state, k, MODEL_NOISE)
        return Gaussian(np.where(missing, predicted.mean, x), np.where(missing, predicted.cov, cov))

    def estimate(self, state: Gaussian) -> Gaussian:
        """Return the inverted measurement."""
        return state
