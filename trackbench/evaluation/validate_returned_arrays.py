"""Validation of returned arrays: shapes and names, before numpy broadcasts them. NaN is a lost run."""

from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.evaluation.allowed_metric_names import check_metric_names
from trackbench.filters.base import WrongReturnError
from trackbench.filters.external_answers import ASYMMETRY

_METHODS = {
    "diagnostic": "diagnostics",
    "expectation": "expectation",
    "series": "log_likelihood",
    "metric": "run_metrics",
}


def check_estimate(estimate: Gaussian, sizes: tuple[int, int], *batch: int) -> None:
    """Check the shapes and types of an estimate.

    Parameters
    ----------
    estimate
        mean (n, M), and covariance (n, n, M) or (n, n). Of S steps that are checked in one call they are
        (n, S, M), and (n, n, S, M) or (n, n, S, 1)
    sizes
        numbers of components of the truth, and of the motion that the filter assumes; n is either of
        both
    *batch
        M, or S and M

    Raises
    ------
    WrongReturnError
        a ValueError, for another object, another shape, and numbers that are not real
    """
    try:
        mean = estimate.mean
        cov = estimate.cov
    except AttributeError:
        text = f"an estimate is a Gaussian, and this is a {type(estimate).__name__}"
        raise WrongReturnError("estimate", text) from None
    truth_size, motion_size = sizes
    n = truth_size if _is_real(mean, (truth_size, *batch)) else motion_size
    if not _is_real(mean, (n, *batch)):
        raise _wrong_array("estimate", "the mean of the estimate", mean, (n, *batch))
    shared = (n, n) if len(batch) == 1 else (n, n, batch[0], 1)
    if not _is_real(cov, (n, n, *batch), shared):
        subject = "the covariance of the estimate"
        raise _wrong_array("estimate", subject, cov, (n, n, *batch), shared)


def check_symmetry(cov: Array) -> None:
    """Check that a covariance is symmetric, as a Cholesky factor is not.

    Parameters
    ----------
    cov
        covariance (n, n[, *batch]). Entries that are not finite are those of lost runs, and are left out

    Raises
    ------
    WrongReturnError
        a ValueError, with the first entry that differs too much from its mirror image
    """
    across = np.swapaxes(cov, 0, 1)
    if np.array_equal(cov, across):
        return
    with np.errstate(invalid="ignore", over="ignore"):
        sd = np.sqrt(np.abs(np.diagonal(cov).astype(np.float64)))
        sd = np.moveaxis(sd, -1, 0)
        # A component that is known exactly, or nearly so, has rounding errors only.
        sd = np.maximum(sd, 1e-6 * sd.max(axis=0))
        scale = sd[:, None] * sd
        difference = np.abs(cov - across)
        differs = np.isfinite(difference) & (difference > ASYMMETRY * scale)
    if not differs.any():
        return
    place = tuple(np.argwhere(differs)[0])
    share = float(difference[place] / scale[place])
    row, column = (int(i) + 1 for i in place[:2])
    text = (
        f"the covariance of the estimate is not symmetric: row {row}, column {column} and its mirror "
        f"image differ by {share:.2g} of the product of the two standard deviations, more than "
        f"the allowed {ASYMMETRY:g}: keep (P + P') / 2 after each update, and of a Cholesky factor L "
        "return L L'"
    )
    raise WrongReturnError("estimate", text)


def check_axes(first: Gaussian, prior_mean: Array) -> None:
    """Check that components and runs of a mean are not exchanged.

    `check_estimate` finds exchanged axes by the shape, except for as many runs as components. Then the
    means are both (n, n), and only their values differ.

    Parameters
    ----------
    first
        first estimate of a filter, that of the prior
    prior_mean
        mean (n, M) of the prior

    Raises
    ------
    WrongReturnError
        a ValueError, if the first mean is the prior's with both axes exchanged
    """
    exchanged = first.mean.shape == prior_mean.shape[::-1] and np.array_equal(
        first.mean.T, prior_mean
    )
    if exchanged and not np.array_equal(first.mean, prior_mean):
        text = "components and runs of the mean are exchanged: components come first"
        raise WrongReturnError("estimate", text)


def checked_numbers(kind: str, values: dict[str, Any], *batch: int) -> dict[str, Array]:
    """Return copies of real numbers by name.

    Parameters
    ----------
    kind
        word for the numbers in the message, such as ``diagnostic``: a key of `_METHODS`, which has the
        name of the method that returned them
    values
        arrays (*batch) by name
    *batch
        shape of the arrays, such as M

    Returns
    -------
    dict
        arrays (*batch) of floats by name

    Raises
    ------
    WrongReturnError
        a ValueError, for anything but real numbers of this shape by name
    """
    check_numbers(kind, values, *batch)
    return {name: np.array(row, dtype=np.float64) for name, row in values.items()}


def check_numbers(kind: str, values: dict[str, Any], *batch: int) -> None:
    """Check that values are real numbers by name.

    Parameters
    ----------
    kind
        word for the numbers in the message, such as ``diagnostic``: a key of `_METHODS`, which has the
        name of the method that returned them
    values
        arrays (*batch) by name
    *batch
        shape of the arrays, such as M

    Raises
    ------
    WrongReturnError
        a ValueError, for anything but real numbers of this shape by name
    """
    method = _METHODS[kind]
    if not isinstance(values, dict):
        raise WrongReturnError(method, f"{kind}s are a {type(values).__name__}, not a mapping")
    for name, row in values.items():
        if not isinstance(name, str):
            raise WrongReturnError(method, f"the name of a {kind} is {name!r}, no word")
        if not _is_real(row, batch):
            raise _wrong_array(method, f"{kind} {name!r}", row, batch)


def checked_metrics(values: dict[str, Any], runs: int) -> dict[str, Array]:
    """Return a scenario's metrics (M,) of all runs, by names such as ``detection_delay_s[leg 1]``.

    Raises ValueError for other arrays and names. ``runs`` is M.
    """
    metrics = checked_numbers("metric", values, runs)
    check_metric_names(metrics)
    return metrics


def _is_real(value: Any, *shapes: tuple[int, ...]) -> bool:
    """Test whether the value is an unmasked array of real numbers, in one of the shapes."""
    return type(value) is np.ndarray and value.dtype.kind in "fiub" and value.shape in shapes


def _wrong_array(
    method: str, subject: str, value: Any, *shapes: tuple[int, ...]
) -> WrongReturnError:
    """Return the error about a value that is no array of real numbers in one of the shapes.

    ``method`` returned the value, and ``subject`` names it in the message.
    """
    if type(value) is np.ndarray:
        got = f"an array {value.shape} of {value.dtype}"
    else:
        got = f"a {type(value).__name__}"
    expected = " or ".join(map(str, shapes))
    return WrongReturnError(method, f"{subject} is {got}, not an array {expected} of real numbers")
