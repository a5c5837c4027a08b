"""Validation of returned arrays: shapes and names, before numpy broadcasts them. NaN is a lost run."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.filters.base import WrongReturnError
from trackbench.metrics import is_reserved

_METHODS = {
    "diagnostic": "diagnostics",
    "expectation": "expectation",
    "series": "log_likelihood",
    "metric": "run_metrics",
}
_WORD = re.compile(r"[\w.-]+")
_METRIC = re.compile(_WORD.pattern + r"(\[[^\[\]\x00-\x1f]+\])?")


@contextmanager
def explain_read_only_errors() -> Iterator[None]:
    """Explain numpy's error about a read-only array to the author of a filter."""
    try:
        yield
    except ValueError as error:
        if "read-only" not in str(error) and "WRITEABLE" not in str(error):
            raise
        what = "what a filter is given is read-only: copy it before you write to it"
        raise ValueError(f"{what} ({error})") from error


def check_estimate(estimate: Gaussian, sizes: tuple[int, int], *batch: int) -> None:
    """Raise ValueError unless the mean is (n, M) and the covariance (n, n, M) or (n, n), all real.

    n is either of the sizes: components of the truth, or of the motion that the filter assumes. Of many
    steps the batch is (S, M), and covariances that the runs share are (n, n, S, 1).
    """
    try:
        mean, cov = estimate.mean, estimate.cov
    except AttributeError:
        what = f"an estimate is a Gaussian, and this is a {type(estimate).__name__}"
        raise WrongReturnError("estimate", what) from None
    # The truth's number of components, or that of the assumed motion.
    n = sizes[0] if _is_real(mean, (sizes[0], *batch)) else sizes[1]
    if not _is_real(mean, (n, *batch)):
        raise _refused("estimate", "the mean of the estimate", mean, (n, *batch))
    shared = (n, n) if len(batch) == 1 else (n, n, batch[0], 1)
    if not _is_real(cov, (n, n, *batch), shared):
        what = "the covariance of the estimate"
        raise _refused("estimate", what, cov, (n, n, *batch), shared)


def check_axes(first: Gaussian, start: Array) -> None:
    """Raise ValueError for a first mean (n, n) that is the start's, components and runs exchanged."""
    exchanged = first.mean.shape == start.shape[::-1] and np.array_equal(first.mean.T, start)
    if exchanged and not np.array_equal(first.mean, start):
        what = "components and runs of the mean are exchanged: components come first"
        raise WrongReturnError("estimate", what)


def checked_numbers(what: str, given: dict[str, Any], *batch: int) -> dict[str, Array]:
    """Return copies of real numbers (*batch) by name; raises ValueError for anything else."""
    check_numbers(what, given, *batch)
    return {name: np.array(row, dtype=np.float64) for name, row in given.items()}


def check_numbers(what: str, given: dict[str, Any], *batch: int) -> None:
    """Raise ValueError for anything but real numbers (*batch) by name."""
    if not isinstance(given, dict):
        text = f"{what}s are a {type(given).__name__}, not a mapping"
        raise WrongReturnError(_METHODS[what], text)
    for name, row in given.items():
        if not isinstance(name, str):
            raise WrongReturnError(_METHODS[what], f"the name of a {what} is {name!r}, no word")
        if not _is_real(row, batch):
            raise _refused(_METHODS[what], f"{what} {name!r}", row, batch)


def checked_metrics(given: dict[str, Any], runs: int) -> dict[str, Array]:
    """Validate a scenario's run metrics and their names, such as ``detection_delay_s[leg 1]``."""
    metrics = checked_numbers("metric", given, runs)
    for name in metrics:
        if not _METRIC.fullmatch(name):
            why = "use letters, digits, . _ - and what it is of as in detection_delay_s[leg 1]"
            raise WrongReturnError("run_metrics", f"a metric cannot be named {name!r}: {why}")
    return metrics


def check_names(names: Iterable[str]) -> None:
    """Raise ValueError at the name of a diagnostic that would replace a metric of the errors."""
    for name in names:
        if is_reserved(name):
            why = "as metrics of errors are"
            raise WrongReturnError("diagnostics", f"a diagnostic cannot be named {name!r}, {why}")
        if not _WORD.fullmatch(name):  # rmse[k<=30] and mean(rmse) are metrics of errors, too
            why = "use letters, digits, . _ -"
            raise WrongReturnError("diagnostics", f"a diagnostic cannot be named {name!r}: {why}")


def _is_real(given: Any, *shapes: tuple[int, ...]) -> bool:
    """Test whether the value is an unmasked array of real numbers."""
    return type(given) is np.ndarray and given.dtype.kind in "fiub" and given.shape in shapes


def _refused(method: str, what: str, given: Any, *shapes: tuple[int, ...]) -> WrongReturnError:
    is_array = type(given) is np.ndarray
    got = f"an array {given.shape} of {given.dtype}" if is_array else f"a {type(given).__name__}"
    expected = " or ".join(map(str, shapes))
    return WrongReturnError(method, f"{what} is {got}, not an array {expected} of real numbers")
