"""Baselines without data or without memory: prior mean, inverted measurement, converted scans."""

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, cast

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.polar_conversions import Conversion
from trackbench.filters.assumed_noise import MODEL_NOISE
from trackbench.filters.base import WHOLE_FILTER, Filter
from trackbench.filters.ekf_linearization import extended_prediction
from trackbench.models.base import Model, Scene
from trackbench.models.sensors.range_azimuth import RangeAzimuth
from trackbench.models.sensors.square_then_line import SquareThenLine
from trackbench.models.two_scan_prior import TwoPoint
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
        # x = h^-1(z), the non-negative root of a square, with variance R / h'(x)^2, infinite where h' is
        # zero
        x = sensor.inverse(z, k)
        R = sensor.measurement(x, k).cov
        with np.errstate(divide="ignore"):
            cov = with_trailing(R, 1, leading=2) / np.square(sensor.jacobian(x, k))
        missing = np.isnan(z).any(axis=0)
        if not missing.any():
            return Gaussian(x, cov)
        # Predict by a linearized motion, with the model's Q, in the runs without a measurement.
        predicted = extended_prediction(model, state, k, assumed=MODEL_NOISE)
        return Gaussian(np.where(missing, predicted.mean, x), np.where(missing, predicted.cov, cov))

    def estimate(self, state: Gaussian) -> Gaussian:
        """Return the inverted measurement."""
        return state


class LastTwoScans(NamedTuple):
    """Last two scans, and their two-point difference."""

    scans: TwoPoint
    difference: Gaussian


@register("filters", "conversion")
@dataclass(frozen=True, kw_only=True)
class Converted(Filter[LastTwoScans]):
    """Baseline without memory: the last scan's converted position, and its two-point difference.

    The position shows a conversion's own bias and consistency (banana paper, Fig. 6).
    """

    conversion: Conversion = "ucm"
    """conversion of range and azimuth to a position: ccm, ucm, mucm or ducm"""
    requires: ClassVar[tuple[str, ...]] = ("state.planar", "sensor.reading", "prior.gaussian")

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject a motion with further components than positions and velocities."""
        others = ", ".join(scenario.model.motion.components[4:])
        if others:
            message = (
                f"conversion estimates position and velocity only; its motion has {others}, too"
            )
            return {WHOLE_FILTER: f"{message}; give it `assume: {{motion: {{kind: cv, q: 0}}}}`"}
        return {}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> LastTwoScans:
        """Start from the first two scans."""
        assert isinstance(prior, TwoPoint)
        return LastTwoScans(scans=prior, difference=prior.gaussian(self.conversion))

    def step(
        self, model: Model, state: LastTwoScans, z: Array, k: int, rng: Generator
    ) -> LastTwoScans:
        """Drop the older scan and take z as the newer one; a missing z is predicted from both scans."""
        sensor = cast(RangeAzimuth, model.sensor)
        expected = model.motion.transition(state.difference.mean, k).mean
        scan = np.where(np.isnan(z).any(axis=0), sensor.polar(expected), z)
        scans = replace(state.scans, first=state.scans.second, second=scan)
        return LastTwoScans(scans=scans, difference=scans.gaussian(self.conversion))

    def estimate(self, state: LastTwoScans) -> Gaussian:
        """Return the converted position, and the velocity between the last two."""
        return state.difference
