"""Components of one run: the filter's order against the scenario's, and missing components."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from trackbench.core.arrays import Array, Index, Mask, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.models.base import Model

Pair = tuple[Array, Array]
"""Mean (n,) and covariance (n, n) of one run."""
Foreign: TypeAlias = Any
"""An object of filterpy or Stone Soup, which have no types."""
Functions: TypeAlias = dict[str, Callable[..., Array]]
"""Further arguments of an object's update, by name."""
PARTIAL_UNSUPPORTED = "a part of a measurement is missing, and this filter takes whole ones"
_NO_WEIGHT = 1e16
"""Variance of a missing component, in sensor variances: its gain is below float64's precision."""


def component_mismatch(
    model: Model, state: Sequence[str], measured: Sequence[str], extra_std: Mapping[str, float]
) -> str | None:
    """Explain why a filter with these components cannot run on the model; None if it can."""
    names, measurements = model.motion.components, model.sensor.components
    lacking = [name for name in names if state and name not in state]
    if lacking:
        zeros = held_at_zero(model)
        lacking = [name for name in lacking if name not in zeros]
    unknown = [name for name in state if name not in names and name not in extra_std]
    if measured and sorted(measured) != sorted(measurements):
        return f"it takes {', '.join(measured)}; this scenario measures {', '.join(measurements)}"
    if lacking:
        return f"its state ({', '.join(state)}) has no {lacking[0]}"
    if unknown:
        what = f"its {unknown[0]} is not a component of this scenario ({', '.join(names)})"
        return f"{what}; give its initial standard deviation in `extra_std`"
    return None


def held_at_zero(model: Model) -> list[str]:
    """Name the components that the motion leaves at zero, without noise, if they are zero.

    Such are the errors of a sensor in scenarios with faults. A filter need not estimate them.
    """
    motion = model.motion
    held = []
    with np.errstate(all="ignore"):
        for i, name in enumerate(motion.components):
            # Any state in which this component is zero.
            x = np.linspace(0.5, 1.5, len(motion.components))[:, None]
            x[i] = 0.0
            moved = motion.transition(x, 1)
            noise = np.asarray(with_trailing(moved.cov, 1, leading=2))[i]
            if moved.mean[i, 0] == 0.0 and not noise.any():
                held.append(name)
    return held


@dataclass(frozen=True)
class Order:
    """Positions of the scenario's components in a filter's state and measurement."""

    shared: Index
    """positions of the scenario's components that the filter has, in the scenario (n_shared,)"""
    places: Index
    """their positions in the filter's state (n_shared,)"""
    size: int
    """number of the scenario's components n_x; those that the filter lacks are known to be zero"""
    first_cov: Array
    """initial covariance (n, n) of the components that only the filter has"""
    rows: Index
    """position of each component of the filter's measurement in the scenario's (n_z,)"""

    @classmethod
    def of(
        cls, model: Model, state: Sequence[str], measured: Sequence[str], std: Mapping[str, float]
    ) -> "Order":
        """Return the order of names without a `component_mismatch`; no names are the scenario's."""
        names, measurements = model.motion.components, model.sensor.components
        ours = list(state or names)
        # Components that only the filter has start about zero with their own variance.
        variances = [std.get(name, 0.0) ** 2 if name not in names else 0.0 for name in ours]
        shared = [name for name in names if name in ours]
        return cls(
            shared=np.array([names.index(name) for name in shared]),
            places=np.array([ours.index(name) for name in shared]),
            size=len(names),
            first_cov=np.diag(variances),
            rows=np.array([measurements.index(name) for name in measured or measurements]),
        )

    def to_filter(self, mean: Array, cov: Array) -> Pair:
        """Reorder the scenario's first state for the filter, in new arrays."""
        our_mean, our_cov = np.zeros(len(self.first_cov)), self.first_cov.copy()
        our_mean[self.places] = mean[self.shared]
        our_cov[np.ix_(self.places, self.places)] = cov[np.ix_(self.shared, self.shared)]
        return our_mean, our_cov

    def to_scenario(self, mean: Array, cov: Array) -> Gaussian:
        """Select the scenario's components of the filter's estimates (n, M) and (n, n, M)."""
        selected = mean[self.places]
        selected_cov = cov[np.ix_(self.places, self.places)]
        if len(self.shared) == self.size:
            return Gaussian(selected, selected_cov)
        M = mean.shape[1]
        whole = np.zeros((self.size, M))
        whole[self.shared] = selected
        whole_cov = np.zeros((self.size, self.size, M))
        whole_cov[np.ix_(self.shared, self.shared)] = selected_cov
        return Gaussian(whole, whole_cov)


def as_numbers(value: ArrayLike, shape: tuple[int, ...]) -> Array | None:
    """Read real numbers of this shape; None of anything else. A vector may come as a column."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        return None
    if array.shape != shape and array.shape == (*shape, 1):
        array = array[..., 0]
    return array if array.shape == shape and array.dtype.kind in "fiub" else None


def measured_part(nu: ArrayLike, S: ArrayLike, is_measured: Mask) -> Innovation:
    """Return the innovation (n, 1) of the measured components, ``is_measured`` (n_z,).

    An object that was updated with these components alone has it already.
    """
    nu, S = np.asarray(nu, dtype=float).reshape(-1, 1), np.asarray(S, dtype=float)
    if len(nu) == is_measured.sum():
        return Innovation(nu, S)
    return Innovation(nu[is_measured], S[np.ix_(is_measured, is_measured)])


def inflate_missing(R: Array, is_measured: Mask) -> Array:
    """Give the missing components vast variances in the sensor's covariance."""
    # Without correlations, a vast variance leaves the component with a gain of nearly zero.
    out = np.where(is_measured[:, None] & is_measured, R, 0.0)
    missing = ~is_measured
    out[missing, missing] = _NO_WEIGHT * np.maximum(np.diagonal(R)[missing], 1.0)
    return out


@contextmanager
def partial_update(
    parts: Sequence[Foreign], z: Array, is_measured: Mask, keywords: Functions
) -> Iterator[tuple[Array, Functions]]:
    """Let filterpy's objects be updated with a part of z (n_z,): yield their z and keywords.

    If H is a matrix or a keyword, the rows of the missing components are left out of it and of R.
    Other objects get vast variances in R. Raises ValueError for an IMM of those: its likelihoods
    would be wrong.
    """
    has_rows = "HJacobian" in keywords or all(hasattr(part, "H") for part in parts)
    if not all(hasattr(part, "R") for part in parts) or (len(parts) > 1 and not has_rows):
        raise ValueError(PARTIAL_UNSUPPORTED)
    # Step 1: remember the attributes of the whole measurement.
    names = ("H", "dim_z", "R") if has_rows else ("R",)
    before: list[dict[str, Any]] = []
    for part in parts:
        before.append({n: getattr(part, n) for n in names if hasattr(part, n)})
    try:
        # Step 2: leave out the rows of the missing components, or give them no weight.
        for part, whole in zip(parts, before, strict=True):
            if has_rows:
                part.R = whole["R"][np.ix_(is_measured, is_measured)]
                part.dim_z = int(is_measured.sum())
            else:
                part.R = inflate_missing(whole["R"], is_measured)
            if "H" in whole:
                part.H = whole["H"][is_measured]
        if has_rows:
            yield z[is_measured], _keywords_of_part(keywords, is_measured)
        else:
            yield np.where(is_measured, z, 0.0), keywords
    finally:
        # Step 3: restore the attributes.
        for part, whole in zip(parts, before, strict=True):
            for name, value in whole.items():
                setattr(part, name, value)


def _keywords_of_part(keywords: Functions, is_measured: Mask) -> Functions:
    """Restrict an extended filter's functions to a part of the measurement."""

    def rows_of(function: Callable[..., Array]) -> Callable[..., Array]:
        return lambda *args: np.asarray(function(*args))[is_measured]

    def residual(*pair: Array) -> Array:
        # The user's function takes whole measurements: zeros stand for the missing components.
        whole = [np.zeros((len(is_measured), *part.shape[1:])) for part in pair]
        for part, into in zip(pair, whole, strict=True):
            into[is_measured] = part
        return np.asarray(keywords["residual"](*whole))[is_measured]

    out = {n: rows_of(f) if n in ("HJacobian", "Hx") else f for n, f in keywords.items()}
    return out | ({"residual": residual} if "residual" in keywords else {})
