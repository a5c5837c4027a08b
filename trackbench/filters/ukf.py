"""Kalman filters by sigma points: unscented, cubature, Gauss-Hermite."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Interval

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Updated
from trackbench.core.smoothing import Transition
from trackbench.core.unscented import PointRule, Unscented, gauss_hermite
from trackbench.field_types import Finite, Positive
from trackbench.filters.kf import MAX_ORDER, MERWE_DEMO, NonlinearFilter
from trackbench.models.base import Model, Scene
from trackbench.models.gaussian_steps import (
    additive_step,
    augmented_size,
    augmented_step,
    point_transition,
    spread_conflicts,
)
from trackbench.registry import register

_MAX_POINTS = 5000


@dataclass(frozen=True, kw_only=True)
class SigmaPointFilter(NonlinearFilter):
    """Base of the filters whose moments are weighted sums over sigma points."""

    @property
    def rule(self) -> PointRule:
        """Points and weights."""
        raise NotImplementedError

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update by sigma points."""
        step = augmented_step if self.augmented else additive_step
        return step(model, state, z, k, self.assumed, self.rule)

    def transition(self, model: Model, state: Gaussian, k: int) -> Transition:
        """Predict to step k by sigma points, with the covariance with x_{k-1}."""
        return point_transition(model, state, k, self.assumed, self.rule, self.augmented)

    @property
    def augmented(self) -> bool:
        """True if the points are of state and noise together."""
        return False


@register("filters", "ukf")
@dataclass(frozen=True, kw_only=True)
class UKF(SigmaPointFilter):
    """Unscented Kalman filter, with sigma points of state and noise or of the state alone.

    Julier & Uhlmann 1997; van der Merwe et al. 2000, section 3.2.
    """

    alpha: Positive = 1.0
    """spread of the sigma points"""
    beta: Finite = 0.0
    """extra weight of the center in the covariance (2 is optimal for a Gaussian)"""
    kappa: Finite = 2.0
    """secondary scaling of the sigma points"""
    noise: Literal["augmented", "additive"] = "augmented"
    """sigma points of state and noise together, or of the state with the noise covariance added"""
    presets: ClassVar[dict[str, dict[str, object]]] = {"merwe-demo": MERWE_DEMO}

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject also sigma points without spread, and a square root of a negative weight."""
        out = super().conflicts(scenario)
        out |= spread_conflicts(self.alpha, self.kappa, scenario.model, self.augmented)
        if self.form == "square-root" and not out:
            n_x = len(scenario.model.motion.components)
            n = augmented_size(scenario.model) if self.augmented else n_x
            if self.rule.points(Gaussian(np.zeros(n), np.eye(n))).cov_weights[0] < 0.0:
                out["form"] = "square-root needs a center weight >= 0; enlarge kappa or beta"
        return out

    @property
    def augmented(self) -> bool:
        """True if the points are of state and noise together."""
        return self.noise == "augmented"

    @property
    def rule(self) -> PointRule:
        """Scaled unscented transform."""
        return Unscented(self.alpha, self.beta, self.kappa)


@register("filters", "ckf")
@dataclass(frozen=True, kw_only=True)
class CKF(SigmaPointFilter):
    """Cubature Kalman filter: the third-degree spherical-radial rule, without a center point.

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

    Ito & Xiong 2000. A state of n components has order^n points.
    """

    order: Annotated[int, Interval(ge=2, le=MAX_ORDER)] = 3
    """points along each axis"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Reject also an order with too many points."""
        out = super().conflicts(scenario)
        # A product rule has order^n points.
        number = self.order ** len(scenario.model.motion.components)
        if number > _MAX_POINTS:
            out["order"] = f"{number} points a step; at most {_MAX_POINTS}"
        return out

    @property
    def rule(self) -> PointRule:
        """Product rule."""
        return gauss_hermite(self.order)
