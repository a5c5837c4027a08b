"""What a filter gives back, held to shape and names before numpy broadcasts it to something."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.metrics import is_reserved

_WORD = re.compile(r"[\w.-]+")


@contextmanager
def told_to_copy() -> Iterator[None]:
    """Say of numpy's error about a read-only array what the author of a filter has to know."""
    try:
        yield
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        what = "what a filter is given is read-only: copy it before you write to it"
        raise ValueError(f"{what} ({error})") from error


def check_estimate(found: Gaussian, n: int, runs: int) -> None:
    """Raise ValueError unless the mean is (n, M) and the covariance (n, n, M) or (n, n), all real."""
    if not _is_real(found.mean, (n, runs)):
        raise _refused("the mean of the estimate", found.mean, (n, runs))
    if not _is_real(found.cov, (n, n, runs), (n, n)):
        raise _refused("the covariance of the estimate", found.cov, (n, n, runs), (n, n))


def checked_numbers(what: str, given: dict[str, Any], runs: int) -> dict[str, Array]:
    """Copies of real numbers per run (M,) by name; raises ValueError for anything else."""
    for name, row in given.items():
        if not _is_real(row, (runs,)):
            raise _refused(f"{what} {name!r}", row, (runs,))
    return {name: np.array(row, dtype=np.float64) for name, row in given.items()}


def check_names(names: Iterable[str]) -> None:
    """Raise ValueError at the name of a diagnostic that would replace a metric of the errors."""
    for name in names:
        if is_reserved(name):
            raise ValueError(f"a diagnostic cannot be named {name!r}, as metrics of errors are")
        if not _WORD.fullmatch(name):  # rmse[k<=30] and mean(rmse) are metrics of errors, too
            raise ValueError(f"a diagnostic cannot be named {name!r}: use letters, digits, . _ -")


def _is_real(given: Any, *shapes: tuple[int, ...]) -> bool:
    """Whether it is an array of real numbers, and none that hides some of them behind a mask."""
    return type(given) is np.ndarray and given.dtype.kind in "fiub" and given.shape in shapes


def _refused(what: str, given: Any, *shapes: tuple[int, ...]) -> ValueError:
    is_array = type(given) is np.ndarray
    found = f"an array {given.shape} of {given.dtype}" if is_array else f"a {type(given).__name__}"
    expected = " or ".join(map(str, shapes))
    return ValueError(f"{what} is {found}, not an array {expected} of real numbers")
