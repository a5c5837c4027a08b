"""Extended and unscented Kalman filters alone."""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.conversions import Conversion
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.unscented import Unscented
from trackbench.keys import Finite, NonNegative, Positive
from trackbench.models.base import Model
from trackbench.models.gaussian import Assumed, extended_step, spread_conflicts, unscented_step
from trackbench.models.twopoint import TwoPoint, two_scan_conflicts
from trackbench.registry import register


class Tracked(NamedTuple):
    """The posterior N(mean, cov) and the last normalised innovation squared (M,)."""

    posterior: Gaussian
    nis: Array


@dataclass(frozen=True, kw_only=True)
class GaussianFilter:
    """Keys and hooks shared by the filters that carry one Gaussian."""

    Q: Positive | None = None
    """process noise variance assumed on every component; default: the model's"""
    R: Positive | None = None
    """measurement noise variance assumed; default: the model's"""
    P0: NonNegative | None = None
    """initial variance assumed on every component; default: the prior's"""
    noise_mean: bool = True
    """whether the prediction adds the mean of the process noise"""
    start: Conversion | None = None
    """conversion of the two scans that a radar's filter starts from; default: the prior's moments"""

    def conflicts(self, scenario: Any) -> dict[str, str]:
        """A start from converted scans needs a radar, and two of its scans."""
        if self.start is None:
            return {}
        if not hasattr(scenario.model.sensor, "reading"):
            return {"start": f"scenario {scenario.kind} has no range and azimuth to convert"}
        return two_scan_conflicts(scenario, "start")

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Tracked:
        """The prior's moments, or the two-point start."""
        if self.start is not None:
            assert isinstance(prior, TwoPoint)
            prior = prior.gaussian(self.start)
        n, runs = prior.mean.shape
        cov = prior.cov if self.P0 is None else self.P0 * np.eye(n)
        cov = np.broadcast_to(with_trailing(cov, 1, leading=2), (n, n, runs))
        return Tracked(Gaussian(prior.mean, cov), np.full(runs, np.nan))

    def estimate(self, state: Tracked) -> Gaussian:
        """The posterior."""
        return state.posterior

    def diagnostics(self, state: Tracked) -> dict[str, Array]:
        """``nis``: normalised innovation squared, expected n_z."""
        return {"nis": state.nis}

    @property
    def _assumed(self) -> Assumed:
        return Assumed(self.Q, self.R, self.noise_mean)


@register("filters", "ekf")
@dataclass(frozen=True, kw_only=True)
class EKF(GaussianFilter):
    """Extended Kalman filter: first-order linearisation at the mean (Anderson & Moore 1979)."""

    needs: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")
    presets: ClassVar[dict[str, dict[str, object]]] = {
        "merwe-demo": {"Q": 0.75, "R": 1e-5, "P0": 0.75, "noise_mean": False}
    }

    def step(self, model: Model, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict and update by the Jacobians."""
        posterior, innovation = extended_step(model, state.posterior, z, k, self._assumed)
        return Tracked(posterior, innovation.nis)


@register("filters", "ukf")
@dataclass(frozen=True, kw_only=True)
class UKF(GaussianFilter):
    """Unscented Kalman filter with noise-augmented sigma points.

    Julier & Uhlmann 1997; van der Merwe et al. 2000, section 3.2.
    """

    alpha: Positive = 1.0
    """spread of the sigma points"""
    beta: Finite = 0.0
    """extra weight of the centre in the covariance (2 is optimal for a Gaussian)"""
    kappa: Finite = 2.0
    """secondary scaling of the sigma points"""
    presets: ClassVar[dict[str, dict[str, object]]] = {
        "merwe-demo": {"Q": 0.75, "R": 1e-5, "P0": 0.75, "noise_mean": False}
    }

    def conflicts(self, scenario: Any) -> dict[str, str]:
        """The same, and sigma points that spread."""
        spread = spread_conflicts(self.alpha, self.kappa, scenario.model)
        return super().conflicts(scenario) | spread

    def step(self, model: Model, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict and update by sigma points."""
        unscented = Unscented(self.alpha, self.beta, self.kappa)
        posterior, innovation = unscented_step(
            model, state.posterior, z, k, self._assumed, unscented
        )
        return Tracked(posterior, innovation.nis)
