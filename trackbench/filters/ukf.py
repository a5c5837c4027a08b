"""Kalman filters by sigma points: unscented and cubature.

A step reads on from `GaussianFilter.step` to `sigma_point_steps.py`. Points and weights are in
`core/sigma_points.py`.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Updated
from trackbench.core.rts_smoother import Transition
from trackbench.core.sigma_points import PointRule, Unscented
from trackbench.field_types import Finite, Positive
from trackbench.filters.all_steps_at_once import is_plain, nonlinear_steps
from trackbench.filters.base import Steps
from trackbench.filters.gaussian_base import NonlinearFilter, Tracked
from trackbench.filters.merwe_demo import MERWE_DEMO
from trackbench.filters.sigma_point_steps import additive_step, augmented_step, point_transition
from trackbench.models.base import Model, Scene
from trackbench.registry import register


@dataclass(frozen=True, kw_only=True)
class SigmaPointFilter(NonlinearFilter):
    """Base of the filters whose moments are weighted sums over sigma points."""

    @property
    def rule(self) -> PointRule:
        """Points and weights."""
        raise NotImplementedError

    def update(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update by sigma points."""
        if self.augmented:
            return augmented_step(model, state, z, k, self.assumed, self.rule)
        return additive_step(model, state, z, k, self.assumed, self.rule)

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
        model = scenario.model
        conflicts = super().conflicts(scenario)
        conflicts |= spread_conflicts(self.alpha, self.kappa, model, self.augmented)
        if self.form == "square-root" and not conflicts:
            n = augmented_size(model) if self.augmented else len(model.motion.components)
            standard_normal = Gaussian(np.zeros(n), np.eye(n))
            if self.rule.points(standard_normal).cov_weights[0] < 0.0:
                conflicts["form"] = "square-root needs a center weight >= 0; enlarge kappa or beta"
        return conflicts

    def all_steps(self, model: Model, state: Tracked, z: Array, k: int) -> Steps | None:
        """Filter all measurements z (n_z, T, M) in one call, with the results of `step` bit for bit.

        None unless this is a plain UKF of augmented points, and `nonlinear_steps` can filter with this
        motion and sensor.
        """
        # These keys may have any value. All others, such as `noise: augmented`, must have their
        # defaults.
        if not is_plain(self, UKF, "alpha", "beta", "kappa", "smooth", "start", "P0"):
            return None
        # A smoother stores the states of all steps: leave out their predictions.
        return nonlinear_steps(
            model, state, z, k, keeps_predictions=not self.smooths, rule=self.rule
        )

    @property
    def augmented(self) -> bool:
        """True if the points are of state and noise together."""
        return self.noise == "augmented"

    @property
    def rule(self) -> Unscented:
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


def augmented_size(model: Model) -> int:
    """Return the number of components of the augmented state (x, v, n) of `augmented_step`."""
    return 2 * len(model.motion.components) + len(model.sensor.components)


def spread_conflicts(
    alpha: float, kappa: float, model: Model, augmented: bool = True
) -> dict[str, str]:
    """Reject sigma points that coincide: alpha^2 (n + kappa) must be positive and finite.

    Parameters
    ----------
    alpha, kappa : float
        Spread and secondary scaling of the sigma points.
    model : Model
        Motion and sensor that the filter assumes.
    augmented : bool
        Count the n components of state and noises together; otherwise those of the state alone.

    Returns
    -------
    dict
        Reason by key, ``kappa`` or ``alpha``; empty if the points have a spread.
    """
    # n + lambda = alpha^2 (n + kappa) scales the points: it must be positive and finite.
    n = augmented_size(model) if augmented else len(model.motion.components)
    if n + kappa <= 0:
        parts = ", of state, noise and measurement" if augmented else ""
        return {"kappa": f"n + kappa must be greater than 0; n = {n}{parts}"}
    if not 0 < alpha * alpha * (n + kappa) < float("inf"):
        return {"alpha": f"alpha^2 (n + kappa) must be a finite number greater than 0; n = {n}"}
    return {}
