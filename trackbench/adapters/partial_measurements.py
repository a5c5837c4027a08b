"""Half a measurement for objects that take whole ones, and what they thought of it beforehand."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.kalman import Innovation

_NO_WEIGHT = 1e16
"""Variance of what is missing, in those of the sensor: no gain is left of it in a float64."""
PARTIAL_UNSUPPORTED = "a part of a measurement is missing, and this filter takes whole ones"


def measured_part(nu: Any, S: Any, there: Mask) -> Innovation:
    """The innovation and its covariance of what was measured, ``there`` (n_z,), as of one run (n, 1).

    An object that was given no more than that has it already.
    """
    nu, S = np.asarray(nu, dtype=float).reshape(-1, 1), np.asarray(S, dtype=float)
    if len(nu) == there.sum():
        return Innovation(nu, S)
    return Innovation(nu[there], S[np.ix_(there, there)])


def inflate_missing(R: Array, there: Mask) -> Array:
    """The sensor's covariance with so large variances of what is missing that nothing comes of it."""
    out = np.where(there[:, None] & there, R, 0.0)
    out[~there, ~there] = _NO_WEIGHT * np.maximum(np.diagonal(R)[~there], 1.0)
    return out


@contextmanager
def partial_update(
    each: Sequence[Any], z: Array, there: Mask, keywords: dict[str, Any]
) -> Iterator[tuple[Array, dict[str, Any]]]:
    """Let filterpy's objects be updated with a part of z (n_z,): the z and the keywords they take.

    Where H is a matrix or a keyword, its rows and those of R are left out; of others what is missing
    has no weight. Raises ValueError for a bank of those, whose likelihoods would not hold then.
    """
    rows = "HJacobian" in keywords or all(hasattr(one, "H") for one in each)
    if not all(hasattr(one, "R") for one in each) or (len(each) > 1 and not rows):
        raise ValueError(PARTIAL_UNSUPPORTED)
    names = ("H", "dim_z", "R") if rows else ("R",)
    before = [{name: getattr(one, name) for name in names if hasattr(one, name)} for one in each]
    try:
        for one, had in zip(each, before, strict=True):
            one.R = had["R"][np.ix_(there, there)] if rows else inflate_missing(had["R"], there)
            if rows:
                one.dim_z = int(there.sum())
            if "H" in had:
                one.H = had["H"][there]
        yield (z[there], _of_part(keywords, there)) if rows else (np.where(there, z, 0.0), keywords)
    finally:
        for one, had in zip(each, before, strict=True):
            for name, value in had.items():
                setattr(one, name, value)


def _of_part(keywords: dict[str, Any], there: Mask) -> dict[str, Any]:
    """An extended filter's functions, of a part of the measurement."""

    def rows_of(function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *args: np.asarray(function(*args))[there]

    def residual(*pair: Array) -> Array:
        whole = [np.zeros((len(there), *part.shape[1:])) for part in pair]
        for part, into in zip(pair, whole, strict=True):
            into[there] = part
        return np.asarray(keywords["residual"](*whole))[there]

    out = {n: rows_of(f) if n in ("HJacobian", "Hx") else f for n, f in keywords.items()}
    return out | ({"residual": residual} if "residual" in keywords else {})
