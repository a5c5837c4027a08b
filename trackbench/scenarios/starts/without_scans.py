"""Starts that need no scan: the first state is known, or known to within an error."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian, PointMass, Uniform
from trackbench.core.mixtures import GaussianMixture, brought_together
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.field_types import ByComponent, Finite, InvalidKeyError, Positive, freeze_mappings
from trackbench.models.component_names import by_component
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.starts.base import FixedStart, InitialScans, Start, repeated


@register("starts", "known")
@dataclass(frozen=True, kw_only=True)
class Known(Start):
    """Every filter starts at the true first state."""

    of_truth: ClassVar[bool] = True

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return a point."""
        return PointMass

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return point masses at the truth."""
        return PointMass(opening.truth)


@dataclass(frozen=True, kw_only=True)
class _Spread:
    """Keys of a normal distribution's covariance."""

    sigma: ByComponent | None = None
    """standard deviation of each component, in order (px, vx, py, vy of a planar target) or by name, 0
    where none is given; m and m/s"""
    cov: tuple[tuple[Finite, ...], ...] | None = None
    """covariance matrix, instead"""

    def __post_init__(self) -> None:
        freeze_mappings(self)
        if (self.sigma is None) == (self.cov is None):
            raise ValueError("give one of sigma and cov")

    def for_state(self, components: tuple[str, ...]) -> Self:
        """Return the start with numbers in the order of the components; raises InvalidKeyError."""
        if self.sigma is not None:
            sigma = by_component(self.sigma, components, "start", "sigma")
            if (sigma < 0.0).any():
                raise InvalidKeyError("a standard deviation is not negative", "start", "sigma")
            return replace(self, sigma=tuple(sigma.tolist()))
        n = len(components)
        P = self._cov  # (0, 0) if rows of the key differ in length
        if P.shape != (n, n):
            message = f"needs {n} rows of {n} numbers, for {', '.join(components)}"
            raise InvalidKeyError(message, "start", "cov")
        # Symmetric, and no eigenvalue below zero but for rounding.
        differing = np.argwhere(P != P.T)
        if len(differing):
            i, j = differing[0] + 1
            message = f"not symmetric: row {i}, column {j} and the reverse differ"
            raise InvalidKeyError(message, "start", "cov")
        least = np.linalg.eigvalsh(P)[0]
        if least < -1e-12 * np.abs(P).max():
            message = f"has the eigenvalue {least:.3g}, and a covariance has none below 0"
            raise InvalidKeyError(message, "start", "cov")
        return self

    @property
    def _cov(self) -> Array:
        """Covariance (n, n).

        If rows of the key ``cov`` differ in length, it has the shape (0, 0), which `for_state` refuses.
        """
        if self.cov is None:
            assert isinstance(self.sigma, tuple)  # after `for_state`
            return np.diag(np.square(self.sigma))
        width = max(map(len, self.cov), default=0)
        if any(len(row) != width for row in self.cov):
            return np.empty((0, 0))
        return np.array(self.cov, dtype=float)


@dataclass(frozen=True, kw_only=True)
class _Located(_Spread):
    """Keys of a normal distribution."""

    mean: ByComponent
    """mean of each component, in order or by name, 0 where none is given; m and m/s"""

    def for_state(self, components: tuple[str, ...]) -> Self:
        """Return the distribution with numbers in the order of the components."""
        mean = by_component(self.mean, components, "start", "mean")
        return replace(super().for_state(components), mean=tuple(mean.tolist()))

    @property
    def gaussian(self) -> Gaussian:
        """Distribution with mean (n,), after `for_state`."""
        return Gaussian(np.array(self.mean), self._cov)


@dataclass(frozen=True, kw_only=True)
class NormalStart(_Spread, Start):
    """Base of the starts from a normal distribution."""

    def bound(self, path: Array, k: int, sensor: Sensors, T: float, diffusion: float) -> Array:
        """Return the covariance."""
        return self._cov


@register("starts", "gaussian")
@dataclass(frozen=True, kw_only=True)
class GaussianStart(NormalStart):
    """The prior mean is the truth plus a normal error, whose covariance every filter has.

    The truth of a driven target is drawn about its configured state; about a path that is flown in every
    run the prior's mean is.
    """

    of_truth: ClassVar[bool] = True

    def truth(self, nominal: Array, rng: Streams) -> Array:
        """Draw the truth (n_x, M) about the configured state (n_x, M)."""
        return Gaussian(nominal, self._cov).sample(rng)

    def prior(
        self, opening: InitialScans, sensor: Sensors, nominal: Array | None, rng: Streams
    ) -> Distribution:
        """Return the distribution about ``nominal`` (n_x, M), from which the truth was drawn.

        If the truth was not drawn, ``nominal`` is None, and the prior's mean is drawn about the truth
        (n_x, M) in ``opening``.
        """
        if nominal is not None:
            return Gaussian(nominal, self._cov)
        mean = Gaussian(opening.truth, self._cov).sample(rng)
        return Gaussian(mean, self._cov)


@register("starts", "given")
@dataclass(frozen=True, kw_only=True)
class GivenStart(_Located, NormalStart, FixedStart):
    """Every filter starts from the same normal distribution, wherever the target really is.

    In a recording it is the state one step before the first row. If the first row has no measurement, as
    in a log of wheels, it is the state at the first row.
    """

    draws_truth: ClassVar[bool] = False

    def distribution(self, runs: int) -> Distribution:
        """Return the configured prior."""
        return Gaussian(repeated(np.array(self.mean), runs), self._cov)


@register("starts", "uniform")
@dataclass(frozen=True, kw_only=True)
class UniformStart(FixedStart):
    """Every component is uniform between two limits; a driven target's first state is drawn from it.

    Particle filters and `grid` use the distribution itself, other filters its exact mean and covariance.
    """

    low: ByComponent
    """lower limit of each component, in order or by name, 0 where none is given"""
    high: ByComponent
    """upper limit of each component; a component with equal limits is known"""

    def __post_init__(self) -> None:
        freeze_mappings(self)

    def for_state(self, components: tuple[str, ...]) -> Self:
        """Return the start with numbers in the order of the components; raises InvalidKeyError."""
        low = by_component(self.low, components, "start", "low").tolist()
        high = by_component(self.high, components, "start", "high").tolist()
        for name, least, largest in zip(components, low, high, strict=True):
            if least > largest:
                message = f"{name}: {largest:g} is below `low`, {least:g}"
                raise InvalidKeyError(message, "start", "high")
        return replace(self, low=tuple(low), high=tuple(high))

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return a uniform distribution."""
        return Uniform

    def distribution(self, runs: int) -> Distribution:
        """Return the configured prior."""
        return Uniform(np.array(self.low), np.array(self.high), runs)


@dataclass(frozen=True, kw_only=True)
class MixturePart(_Located):
    """A normal distribution with a weight."""

    weight: Positive = 1.0
    """weight relative to the sum of all weights"""


@register("starts", "mixture")
@dataclass(frozen=True, kw_only=True)
class MixtureStart(FixedStart):
    """A mixture of normal distributions; a driven target's first state is drawn from it.

    Particle filters and `grid` use the distribution itself, other filters its exact mean and covariance.
    """

    parts: tuple[MixturePart, ...]
    """the normal distributions: [{weight: 1, mean: {x: -3}, sigma: {x: 1}}, ...]"""

    def __post_init__(self) -> None:
        if not self.parts:
            raise InvalidKeyError("is empty: name at least one part", "parts")

    def for_state(self, components: tuple[str, ...]) -> Self:
        """Return the start with numbers in the order of the components; raises InvalidKeyError."""
        parts = []
        for i, part in enumerate(self.parts):
            try:
                parts.append(part.for_state(components))
            except InvalidKeyError as error:
                # The part's error has the path (start, KEY).
                raise InvalidKeyError(str(error), "start", "parts", i, *error.path[1:]) from None
        return replace(self, parts=tuple(parts))

    def on_one_turn(self, angles: Sequence[int]) -> Self:
        """Return the start with the angles of the parts' means within half a turn of their direction.

        Else parts at 179 and -179 deg would have the mean 0.
        """
        if not angles:
            return self
        states = [Gaussian(part.gaussian.mean[:, None], part.gaussian.cov) for part in self.parts]
        weights = np.array([[part.weight] for part in self.parts])
        parts = []
        for part, state in zip(self.parts, brought_together(states, weights, angles), strict=True):
            parts.append(replace(part, mean=tuple(state.mean[:, 0].tolist())))
        return replace(self, parts=tuple(parts))

    def prior_type(self, sensor: Sensors) -> type[Distribution]:
        """Return a mixture."""
        return GaussianMixture

    def distribution(self, runs: int) -> Distribution:
        """Return the configured prior, its weights divided by their sum."""
        weights = np.array([part.weight for part in self.parts])
        parts = tuple(part.gaussian for part in self.parts)
        return GaussianMixture(weights / total(weights, axis=0), parts, runs)
