"""What all filters share that carry one Gaussian: one step is all that tells them apart."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator

from trackbench.core.arrays import Array, with_trailing
from trackbench.core.conversions import Conversion
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.filters.base import prior_kind
from trackbench.keys import NonNegative, Positive
from trackbench.models.base import Model
from trackbench.models.gaussian import Assumed
from trackbench.models.twopoint import Convertible


class Tracked(NamedTuple):
    """The posterior N(mean, cov) and the last normalised innovation squared (M,)."""

    posterior: Gaussian
    nis: Array


@dataclass(frozen=True, kw_only=True)
class GaussianFilter:
    """Base of the filters with one Gaussian: they differ by `updated`, which an IMM takes, too."""

    def started(self, model: Model, prior: Distribution) -> Gaussian:
        """The first state: the prior's moments."""
        return Gaussian(prior.mean, prior.cov)

    def updated(
        self, model: Model, state: Gaussian, z: Array, k: int
    ) -> tuple[Gaussian, Innovation]:
        """Predict to step k and update with z (n_z, M)."""
        raise NotImplementedError

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Tracked:
        """The first state, with nothing judged yet."""
        return Tracked(self.started(model, prior), np.full(prior.mean.shape[1], np.nan))

    def step(self, model: Model, state: Tracked, z: Array, k: int, rng: Generator) -> Tracked:
        """Predict and update."""
        posterior, innovation = self.updated(model, state.posterior, z, k)
        return Tracked(posterior, innovation.nis)

    def estimate(self, state: Tracked) -> Gaussian:
        """The posterior."""
        return state.posterior

    def diagnostics(self, state: Tracked) -> dict[str, Array]:
        """``nis``: normalised innovation squared, expected n_z."""
        return {"nis": state.nis}


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

    def conflicts(self, scenario: Any) -> dict[str, str]:
        """A start from converted scans needs a radar's two scans, a variance a scalar."""
        out, (motion, sensor) = {}, scenario.model
        if self.start is not None and not issubclass(prior_kind(scenario), Convertible):
            out["start"] = "there are no two scans of range and azimuth to start from"
        for key, components in (("Q", motion), ("P0", motion), ("R", sensor)):
            if getattr(self, key) is not None and len(components.components) > 1:
                out[key] = "one variance for several components: say what is assumed by `assume`"
        return out

    def started(self, model: Model, prior: Distribution) -> Gaussian:
        """The prior's moments, or the two-point start."""
        if self.start is not None and isinstance(prior, Convertible):
            prior = prior.gaussian(self.start)
        n, runs = prior.mean.shape
        cov = prior.cov if self.P0 is None else self.P0 * np.eye(n)
        cov = np.broadcast_to(with_trailing(cov, 1, leading=2), (n, n, runs))
        return Gaussian(prior.mean, cov)

    @property
    def assumed(self) -> Assumed:
        """The noise that is assumed."""
        return Assumed(self.Q, self.R, self.noise_mean)
