"""A filter's own order of components, and the scenario's."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.distributions import Gaussian
from trackbench.models.base import Model

Pair = tuple[Array, Array]
"""Mean (n,) and covariance (n, n) of one run."""


def mistakes(
    model: Model, state: Sequence[str], measured: Sequence[str], extra_std: Mapping[str, float]
) -> str | None:
    """Why a filter of these components cannot be run on the model, if it cannot."""
    names, seen = model.motion.components, model.sensor.components
    lacking = [name for name in names if state and name not in state]
    unknown = [name for name in state if name not in names and name not in extra_std]
    if measured and sorted(measured) != sorted(seen):
        return f"it takes {', '.join(measured)}, and what is measured here is {', '.join(seen)}"
    if lacking:
        return f"its state ({', '.join(state)}) has no {lacking[0]}"
    if unknown:
        what = f"its {unknown[0]} is no component here ({', '.join(names)})"
        return f"{what}: say by `extra_std` how far from zero it may start"
    return None


@dataclass(frozen=True)
class Order:
    """Where the scenario's components stand in a filter's own state and measurement."""

    places: Index
    """of the scenario's components in the filter's state (n_x,)"""
    first_cov: Array
    """covariance (n, n) of a state of the filter's own of which nothing is known"""
    rows: Index
    """of the filter's measurement in the scenario's (n_z,)"""

    @classmethod
    def of(
        cls, model: Model, state: Sequence[str], measured: Sequence[str], std: Mapping[str, float]
    ) -> "Order":
        """Of names that have no `mistakes`; no names are the scenario's own."""
        names, seen = model.motion.components, model.sensor.components
        own = list(state or names)
        variances = [std.get(name, 0.0) ** 2 if name not in names else 0.0 for name in own]
        return cls(
            np.array([own.index(name) for name in names]),
            np.diag(variances),
            np.array([seen.index(name) for name in measured or seen]),
        )

    def started(self, mean: Array, cov: Array) -> Pair:
        """The filter's own first state, in arrays of its own, from the scenario's."""
        own_mean, own_cov = np.zeros(len(self.first_cov)), self.first_cov.copy()
        own_mean[self.places] = mean
        own_cov[np.ix_(self.places, self.places)] = cov
        return own_mean, own_cov

    def reported(self, mean: Array, cov: Array) -> Gaussian:
        """The scenario's components of estimates (n, M) and (n, n, M) of the filter's own."""
        return Gaussian(mean[self.places], cov[np.ix_(self.places, self.places)])


def as_numbers(given: Any, shape: tuple[int, ...]) -> Array | None:
    """Real numbers of this shape; a column for a vector, too. None if it is anything else."""
    try:
        found = np.asarray(given)
    except ValueError:  # rows of different lengths
        return None
    if found.shape != shape and found.shape == (*shape, 1):
        found = found[..., 0]
    return found if found.shape == shape and found.dtype.kind in "fiub" else None
