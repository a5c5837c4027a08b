"""Updates of objects of filterpy and Stone Soup with a part of a measurement's components."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from trackbench.core.arrays import Array, Mask
from trackbench.core.kalman import Innovation

Foreign: TypeAlias = Any
"""An object of filterpy or Stone Soup, which have no types."""
Functions: TypeAlias = dict[str, Callable[..., Array]]
"""Further arguments of an object's update, by name."""
PARTIAL_UNSUPPORTED = "a part of a measurement is missing, and this filter takes whole ones"
_NO_WEIGHT = 1e16  # factor on the variance of a missing component
"""Variance of a missing component, in sensor variances: its gain is below float64's precision."""


def measured_part(nu: ArrayLike, S: ArrayLike, is_measured: Mask) -> Innovation:
    """Return the innovation of the measured components of one run.

    Parameters
    ----------
    nu : array_like (n_z,), (n_z, 1), (m,) or (m, 1)
        Innovation of all components, or of the m measured ones only.
    S : array_like (n_z, n_z) or (m, m)
        Covariance of ``nu``.
    is_measured : array (n_z,)
        True where a component is measured.

    Returns
    -------
    Innovation
        Innovation (m, 1) of the m measured components, with its covariance (m, m).
    """
    column = np.asarray(nu, dtype=float).reshape(-1, 1)
    cov = np.asarray(S, dtype=float)
    if len(column) == is_measured.sum():
        return Innovation(column, cov)
    return Innovation(column[is_measured], cov[np.ix_(is_measured, is_measured)])


def inflate_missing(R: Array, is_measured: Mask) -> Array:
    """Give the missing components vast variances, so that an update gives them a gain of nearly zero.

    Parameters
    ----------
    R : array (n_z, n_z)
        Covariance of the measurement noise.
    is_measured : array (n_z,)
        True where a component is measured.

    Returns
    -------
    array (n_z, n_z)
        R of the measured components. A missing component has 1e16 times its variance, or 1e16 if that is
        larger, and no correlation with the others.
    """
    # Without correlations, a vast variance leaves the component with a gain of nearly zero.
    inflated = np.where(is_measured[:, None] & is_measured, R, 0.0)
    missing = ~is_measured
    inflated[missing, missing] = _NO_WEIGHT * np.maximum(np.diagonal(R)[missing], 1.0)
    return inflated


@contextmanager
def partial_update(
    parts: Sequence[Foreign], z: Array, is_measured: Mask, keywords: Functions
) -> Iterator[tuple[Array, Functions]]:
    """Prepare filterpy's objects for an update with the measured components of z.

    If H is a matrix, or the keyword ``HJacobian`` of an extended filter's update, the rows of the
    missing components are left out of H, R and z. Otherwise R gets vast variances for them. The objects
    have their whole H and R again after the update.

    Parameters
    ----------
    parts : sequence of object
        Filters of an IMM, or the only filter.
    z : array (n_z,)
        Measurement, NaN where a component is missing.
    is_measured : array (n_z,)
        True where a component is measured.
    keywords : dict of callable
        Further arguments of the object's update by name, such as ``HJacobian``, ``Hx`` and ``residual``.

    Yields
    ------
    z : array (m,) or (n_z,)
        The m measured components, or all with zero for the missing ones.
    keywords : dict of callable
        Further arguments of the update, of the same components as z.

    Raises
    ------
    ValueError
        If a filter has no R. Also for an IMM whose filters have no H, as vast variances would make its
        likelihoods wrong.
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
            # A matrix H has lost its rows above, functions lose them here.
            yield z[is_measured], _keywords_of_part(keywords, is_measured)
        else:
            # Any number may stand for a missing component, whose vast variance leaves it no weight.
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
