"""What all filters share that carry one Gaussian: one step is all that tells them apart."""

from dataclasses import dataclass
from functools import cache
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, Mask, fixed
from trackbench.core.conversions import Conversion
from trackbench.core.distributions import Distribution, Gaussian, per_run_moments
from trackbench.core.kalman import Innovation, Updated
from trackbench.field_types import NonNegative, OpenShare, Positive
from trackbench.filters.base import Filter
from trackbench.models.base import Model, Scene
from trackbench.models.gaussian_steps import (
    MODEL_NOISE,
    AssumedNoise,
    extended_step,
    idle_noise_mean,
)
from trackbench.models.priors import Convertible
from trackbench.registry import register


class Tracked(NamedTuple):
    """The posterior N(mean, cov), the last normalised innovation squared (M,), what was refused (M,).

    ``seen`` is the innovation itself, once there is one.
    """

    posterior: Gaussian
    nis: Array
    gated: Mask | None = None
    seen: Innovation | None = None


@dataclass(frozen=True, kw_only=True)
class GaussianFilter(Filter[Tracked]):
    """Base of the filters with one Gaussian: they differ by `updated`, which an IMM takes, too."""

    gate: OpenShare | None = None
    """refuse a measurement whose NIS is beyond this part of its chi-square law, such as 0.999"""

    summed_diagnostics: ClassVar[frozenset[str]] = frozenset({"gated"})

    def started(self, model: Model, prior: Distribution) -> Gaussian:
        """The first state: the prior's moments."""
        return Gaussian(prior.mean, prior.cov)

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict to step k and update with z (n_z, M)."""
        raise NotImplementedError

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Tracked:
        """The first state, with nothing judged yet."""
        return Tracked(self.started(model, prior), np.full(prior.mean.shape[1], np.nan))

    def step(self, model: Model, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict and update."""
        posterior, innovation = self.updated(model, state.posterior, z, k)
        nis = innovation.nis
        if self.gate is None:
            return Tracked(posterior, nis, seen=innovation)
        refused = nis > _limits(self.gate, len(z))[(~np.isnan(innovation.nu)).sum(axis=0)]
        if refused.any():
            posterior, _ = self.updated(model, state.posterior, np.where(refused, np.nan, z), k)
        return Tracked(posterior, nis, refused, innovation)

    def estimate(self, state: Tracked) -> Gaussian:
        """The posterior."""
        return state.posterior

    def log_likelihood(self, state: Tracked) -> Array:
        """log N(innovation; 0, S) (M,) of the last measurement, refused or not."""
        if state.seen is None:
            return np.full(state.nis.shape, np.nan)
        return state.seen.log_likelihood

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """What `diagnostics` gives."""
        return frozenset({"nis"} if self.gate is None else {"nis", "gated"})

    def diagnostics(self, state: Tracked) -> dict[str, Array]:
        """``nis``: normalised innovation squared, expected n_z; ``gated``: refused measurements."""
        if self.gate is None:
            return {"nis": state.nis}
        refused = np.zeros(len(state.nis)) if state.gated is None else state.gated.astype(float)
        return {"nis": state.nis, "gated": refused}


@cache
def _limits(gate: float, n_z: int) -> Array:
    """The chi-square value (n_z + 1,) that so many measured components exceed with 1 - gate."""
    from scipy.special import chdtri

    return fixed(np.array([np.inf, *(chdtri(n, 1.0 - gate) for n in range(1, n_z + 1))]))


@dataclass(frozen=True, kw_only=True)
class NonlinearFilter(GaussianFilter):
    """Keys shared by the filters of a nonlinear model that linearise it or take sigma points of it."""

    Q: Positive | None = None
    """process noise variance assumed of a scalar state; default: the model's"""
    R: Positive | None = None
    """measurement noise variance assumed of a scalar measurement; default: the model's"""
    P0: NonNegative | None = None
    """initial variance assumed of a scalar state; default: the prior's"""
    noise_mean: bool = True
    """whether the prediction adds the mean of the process noise"""
    start: Conversion | None = None
    """conversion of the two scans that a radar's filter starts from; default: the prior's moments"""

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """A start from converted scans needs a radar's two scans, a variance a scalar."""
        out, (motion, sensor) = {}, scenario.model
        if self.start is not None and not issubclass(scenario.prior_type, Convertible):
            out["start"] = "there are no two scans of range and azimuth to start from"
        for key, components in (("Q", motion), ("P0", motion), ("R", sensor)):
            if getattr(self, key) is not None and len(components.components) > 1:
                out[key] = "one variance for several components: say what is assumed by `assume`"
        return out

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """A normal process noise has no mean."""
        return idle_noise_mean(scenario)

    def started(self, model: Model, prior: Distribution) -> Gaussian:
        """The prior's moments, or the two-point start."""
        if self.start is not None and isinstance(prior, Convertible):
            prior = prior.gaussian(self.start)
        if self.P0 is not None:
            prior = Gaussian(prior.mean, self.P0 * np.eye(len(prior.mean)))
        return per_run_moments(prior)

    @property
    def assumed(self) -> AssumedNoise:
        """The noise that is assumed."""
        return AssumedNoise(self.Q, self.R, self.noise_mean)


@register("filters", "kf")
@dataclass(frozen=True, kw_only=True)
class KF(GaussianFilter):
    """Kalman filter of a linear motion and a linear sensor (adaptive-kf paper, eqs. 8-12).

    The covariance does not depend on the data, so it and the gain are computed once for all runs.
    """

    requires: ClassVar[tuple[str, ...]] = ("motion.F|linear", "sensor.H")

    def updated(self, model: Model, state: Gaussian, z: Array, k: int) -> Updated:
        """Predict and update: of a linear model the extended step is the Kalman filter's."""
        return extended_step(model, state, z, k, MODEL_NOISE)
