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
_NO_WEIGHT = 1e16  # factor on the variance of a missing component
"""Variance of a missing component, in sensor variances: its gain is below float64's precision."""


def component_mismatch(
    model: Model, state: Sequence[str], measured: Sequence[str], extra_std: Mapping[str, float]
) -> str | None:
    """Explain why a filter with these components cannot run on the model; None if it can.

    Parameters
    ----------
    model
        the model that the scenario lets the filter assume
    state, measured
        components of the filter's state and measurement; empty for those of the scenario
    extra_std
        initial standard deviations of components that only the filter has

    Returns
    -------
    str or None
        the reason
    """
    scenario_state = model.motion.components
    scenario_measured = model.sensor.components
    # Step 1: the measurement.
    if measured and sorted(measured) != sorted(scenario_measured):
        filter_names = ", ".join(measured)
        scenario_names = ", ".join(scenario_measured)
        return f"it takes {filter_names}; this scenario measures {scenario_names}"
    # Step 2: components of the scenario that the filter lacks, and need not estimate if they are always
    # zero.
    missing = [name for name in scenario_state if state and name not in state]
    if missing:
        zero_components = always_zero_components(model)
        for name in missing:
            if name not in zero_components:
                return f"its state ({', '.join(state)}) has no {name}"
    # Step 3: components of the filter that the scenario lacks.
    for name in state:
        if name not in scenario_state and name not in extra_std:
            scenario_names = ", ".join(scenario_state)
            message = f"its {name} is not a component of this scenario ({scenario_names})"
            return f"{message}; give its initial standard deviation in `extra_std`"
    return None


def always_zero_components(model: Model) -> list[str]:
    """Name the components that stay at zero: the motion neither moves them from zero nor adds noise.

    Such are the errors of a sensor in scenarios with faults. A filter need not estimate them.
    """
    motion = model.motion
    zero_components = []
    with np.errstate(all="ignore"):
        for i, name in enumerate(motion.components):
            # Try an arbitrary state in which this component is zero.
            x = np.linspace(0.5, 1.5, len(motion.components))[:, None]
            x[i] = 0.0
            next_state = motion.transition(x, 1)
            # The component's row (n, 1) of the covariance, which may lack the axis over states.
            noise = np.asarray(with_trailing(next_state.cov, 1, leading=2))[i]
            if next_state.mean[i, 0] == 0.0 and not noise.any():
                zero_components.append(name)
    return zero_components


@dataclass(frozen=True)
class Order:
    """Positions of the scenario's components in a filter's state and measurement."""

    shared: Index
    """positions of the scenario's components that the filter has, in the scenario (n_shared,)"""
    places: Index
    """their positions in the filter's state (n_shared,)"""
    size: int
    """number of the scenario's components n_x; a component that the filter lacks is always zero"""
    first_cov: Array
    """initial covariance (n, n) of the components that only the filter has"""
    rows: Index
    """position of each component of the filter's measurement in the scenario's (n_z,)"""

    @classmethod
    def from_model(
        cls, model: Model, state: Sequence[str], measured: Sequence[str], std: Mapping[str, float]
    ) -> "Order":
        """Find the positions of the scenario's components in a filter's state and measurement.

        ``model`` is the one that the scenario lets the filter assume. ``state`` and ``measured`` name
        the components of the filter's state and measurement; empty ones are those of the scenario.
        ``std`` has the initial standard deviations of the components that only the filter has. The
        filter's `conflicts` has already rejected components with a `component_mismatch`.
        """
        scenario_state = model.motion.components
        scenario_measured = model.sensor.components
        filter_state = list(state or scenario_state)
        filter_measured = measured or scenario_measured
        # Components that only the filter has start about zero with their own variance. The others get
        # their covariance from the prior, in `to_filter`.
        variances = []
        for name in filter_state:
            is_extra = name not in scenario_state
            variances.append(std.get(name, 0.0) ** 2 if is_extra else 0.0)
        shared = [name for name in scenario_state if name in filter_state]
        return cls(
            shared=np.array([scenario_state.index(name) for name in shared]),
            places=np.array([filter_state.index(name) for name in shared]),
            size=len(scenario_state),
            first_cov=np.diag(variances),
            rows=np.array([scenario_measured.index(name) for name in filter_measured]),
        )

    def to_filter(self, mean: Array, cov: Array) -> Pair:
        """Reorder the scenario's first state, mean (n_x,) and cov (n_x, n_x), for the filter.

        Return new arrays, mean (n,) and cov (n, n), of the n components of the filter's state. `shared`
        are the rows of the common components in the scenario's state, and `places` those in the
        filter's. The filter's other components have mean zero, and their covariance is in `first_cov`.
        """
        filter_mean = np.zeros(len(self.first_cov))
        filter_mean[self.places] = mean[self.shared]
        filter_cov = self.first_cov.copy()
        filter_cov[np.ix_(self.places, self.places)] = cov[np.ix_(self.shared, self.shared)]
        return filter_mean, filter_cov

    def to_scenario(self, mean: Array, cov: Array) -> Gaussian:
        """Select the scenario's components of the filter's estimates (n, M) and (n, n, M).

        `places` are the rows of the common components in the filter's state, and `shared` those in the
        scenario's, which has `size` components.
        """
        selected = mean[self.places]
        selected_cov = cov[np.ix_(self.places, self.places)]
        if len(self.shared) == self.size:
            return Gaussian(selected, selected_cov)
        # Components that the filter lacks are zero.
        M = mean.shape[1]
        scenario_mean = np.zeros((self.size, M))
        scenario_mean[self.shared] = selected
        scenario_cov = np.zeros((self.size, self.size, M))
        scenario_cov[np.ix_(self.shared, self.shared)] = selected_cov
        return Gaussian(scenario_mean, scenario_cov)


def as_numbers(value: ArrayLike, shape: tuple[int, ...]) -> Array | None:
    """Read real numbers of this ``shape``; None for any other value.

    A vector (n,) may be a column (n, 1).
    """
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        return None
    if array.shape != shape and array.shape == (*shape, 1):
        array = array[..., 0]
    # Floats, whole numbers with and without a sign, and booleans.
    if array.shape != shape or array.dtype.kind not in "fiub":
        return None
    return array


def measured_part(nu: ArrayLike, S: ArrayLike, is_measured: Mask) -> Innovation:
    """Return the innovation (n, 1) of the measured components, which ``is_measured`` (n_z,) marks.

    The innovation ``nu`` and its covariance ``S`` may have all components, or the measured ones only.
    """
    column = np.asarray(nu, dtype=float).reshape(-1, 1)
    cov = np.asarray(S, dtype=float)
    if len(column) == is_measured.sum():
        return Innovation(column, cov)
    return Innovation(column[is_measured], cov[np.ix_(is_measured, is_measured)])


def inflate_missing(R: Array, is_measured: Mask) -> Array:
    """Return the sensor's covariance R (n_z, n_z) with vast variances of the missing components."""
    # Without correlations, a vast variance leaves the component with a gain of nearly zero.
    inflated = np.where(is_measured[:, None] & is_measured, R, 0.0)
    missing = ~is_measured
    inflated[missing, missing] = _NO_WEIGHT * np.maximum(np.diagonal(R)[missing], 1.0)
    return inflated


@contextmanager
def partial_update(
    parts: Sequence[Foreign], z: Array, is_measured: Mask, keywords: Functions
) -> Iterator[tuple[Array, Functions]]:
    """Prepare filterpy's objects for an update with the measured components of z (n_z,).

    ``is_measured`` (n_z,) marks these components. Yield the z and the keywords of the update. If H is a
    matrix or a keyword, the rows of the missing components are left out of H, R and z. Otherwise R gets
    vast variances for them. ``parts`` are the filters of an IMM, or the only filter. Raises ValueError
    for an IMM whose filters have no H, as vast variances would make its likelihoods wrong.
    """
    has_rows = "HJacobian" in keywords or all(hasattr(part, "H") for part in parts)
    if not all(hasattr(part, "R") for part in parts) or (len(parts) > 1 and not has_rows):
        raise ValueError(PARTIAL_UNSUPPORTED)
    # Step 1: remember the attributes of the whole measurement.
    names = ("H", "dim_z", "R") if has_rows else ("R",)
    attributes: list[dict[str, Any]] = []
    for part in parts:
        attributes.append({name: getattr(part, name) for name in names if hasattr(part, name)})
    try:
        # Step 2: leave out the rows of the missing components, or give them no weight.
        for part, values in zip(parts, attributes, strict=True):
            if has_rows:
                part.R = values["R"][np.ix_(is_measured, is_measured)]
                part.dim_z = int(is_measured.sum())
            else:
                part.R = inflate_missing(values["R"], is_measured)
            if "H" in values:
                part.H = values["H"][is_measured]
        if has_rows:
            yield z[is_measured], _keywords_of_part(keywords, is_measured)
        else:
            yield np.where(is_measured, z, 0.0), keywords
    finally:
        # Step 3: restore the attributes.
        for part, values in zip(parts, attributes, strict=True):
            for name, value in values.items():
                setattr(part, name, value)


def _keywords_of_part(keywords: Functions, is_measured: Mask) -> Functions:
    """Restrict an extended filter's functions of the measurement to the measured components.

    ``keywords`` are further arguments of filterpy's update by name: the functions ``HJacobian`` and
    ``Hx`` of the state, and ``residual`` of two measurements. ``is_measured`` (n_z,) marks the measured
    components. Arguments other than these stay as they are.
    """

    def select_rows(function: Callable[..., Array]) -> Callable[..., Array]:
        return lambda *args: np.asarray(function(*args))[is_measured]

    def residual(*measurements: Array) -> Array:
        """Return the rows that are measured of the user's difference of measurements."""
        # The user's function takes whole measurements: zeros stand for the missing components.
        whole_measurements = []
        for z in measurements:
            whole = np.zeros((len(is_measured), *z.shape[1:]))
            whole[is_measured] = z
            whole_measurements.append(whole)
        return np.asarray(keywords["residual"](*whole_measurements))[is_measured]

    restricted = dict(keywords)
    for name in ("HJacobian", "Hx"):
        if name in keywords:
            restricted[name] = select_rows(keywords[name])
    if "residual" in keywords:
        restricted["residual"] = residual
    return restricted
