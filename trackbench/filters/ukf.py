"""Kalman filters by sigma points: unscented, cubature, Gauss-Hermite."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, ClassVar, Literal

from annotated_types import Interval

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Updated
from trackbench.core.unscented import GaussHermite, PointRule, Unscented
from trackbench.field_types import Finite, Positive
from trackbench.filters.ekf import MERWE_DEMO
from trackbench.filters.gaussian_base import NonlinearFilter
from trackbench.models.base import Model, Scene
from trackbench.models.gaussian_steps import additive_step, augmented_step, spread_conflicts
from trackbench.registry import register

_MOST_POINTS = 5000


@dataclass(frozen=True, kw_only=True)
class SigmaPointFilter(NonlinearFilter):
    """Base of the filters whose moments are weighted sums over points."""

    @property
    def rule(self) -> PointRule:
        """Points and weights."""
        raise NotImplementedError

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict by points of the state, update by points of the prediction."""
        return additive_step(model, state, z, k, self.assumed, self.rule)


@register("filters", "ukf")
@dataclass(frozen=True, kw_only=True)
class UKF(SigmaPointFilter):
    """Unscented Kalman filter, of noise-augmented sigma points or of the state's alone.

    Julier & Uhlmann 1997; van der Merwe et al. 2000, section 3.2.
    """

    alpha: Positive = 1.0
    """spread of the sigma points"""
    beta: Finite = 0.0
    """extra weight of the centre in the covariance (2 is optimal for a Gaussian)"""
    kappa: Finite = 2.0
    """secondary scaling of the sigma points"""
    noise: Literal["augmented", "additive"] = "augmented"
    """sigma points of state and noise together, or of the state, the noise's covariance added"""
    presets: ClassVar[dict[str, dict[str, object]]] = {"merwe-demo": MERWE_DEMO}

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """The same, and sigma points that spread."""
        augmented = self.noise == "augmented"
        spread = spread_conflicts(self.alpha, self.kappa, scenario.model, augmented)
        return super().conflicts(scenario) | spread

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update."""
        step = augmented_step if self.noise == "augmented" else additive_step
        return step(model, state, z, k, self.assumed, self.rule)

    @property
    def rule(self) -> PointRule:
        """The scaled unscented transform."""
        return Unscented(self.alpha, self.beta, self.kappa)


@register("filters", "ckf")
@dataclass(frozen=True, kw_only=True)
class CKF(SigmaPointFilter):
    """Cubature Kalman filter: the third-degree spherical-radial rule, without a centre point.

    Arasaratnam & Haykin 2009; a UKF with additive noise, alpha = 1, beta = 0, kappa = 0.
    """

    @property
    def rule(self) -> PointRule:
        """2 n points of equal weight."""
        return Unscented(1.0, 0.0, 0.0)


@register("filters", "ghkf")
@dataclass(frozen=True, kw_only=True)
class GHKF(SigmaPointFilter):
    """Gauss-Hermite Kalman filter: a product rule, exact for polynomials of degree 2 order - 1.

    Ito & Xiong 2000. It has order^n points of a state of n components.
    """

    order: Annotated[int, Interval(ge=2, le=9)] = 3
    """points along each axis"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """The same, and not too many points."""
        out = super().conflicts(scenario)
        number = self.order ** len(scenario.model.motion.components)
        if number > _MOST_POINTS:
            out["order"] = f"{number} points a step; at most {_MOST_POINTS}"
        return out

    @property
    def rule(self) -> PointRule:
        """The product rule."""
        return _gauss_hermite(self.order)


@lru_cache
def _gauss_hermite(order: int) -> GaussHermite:
    return GaussHermite(order)
