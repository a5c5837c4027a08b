"""Start `mixture`: a mixture of normal distributions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.mixtures import GaussianMixture, brought_together
from trackbench.core.sums import total
from trackbench.field_types import InvalidKeyError, Positive
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.starts.base import FixedStart
from trackbench.scenarios.starts.normal_distribution import Located


@dataclass(frozen=True, kw_only=True)
class MixturePart(Located):
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
