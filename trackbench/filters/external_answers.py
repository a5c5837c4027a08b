"""Numbers that an external program answers: read, checked, and covariances made symmetric."""

from collections.abc import Iterator, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.filters.external_process import ProgramError, shown_reason

ASYMMETRY = 1e-5
"""Largest difference of a covariance's entry from its mirror image, as a share of the product of the two
standard deviations; numbers of float32 have such rounding errors."""
_SEPARATORS = "; write a space between two numbers, and a decimal point"


def read_numbers(answers: Sequence[str], n: int) -> Array:
    """Return the numbers of a program's answers to the lines of one run.

    Covariances that are symmetric up to rounding are made symmetric.

    Parameters
    ----------
    answers : sequence of str
        T answers, one or more.
    n : int
        Number of components of the state.

    Returns
    -------
    array (T, n) or (T, n + n^2)
        Means, or means and the rows of the covariances.

    Raises
    ------
    ProgramError
        For an answer that is no estimate, or whose covariance is not symmetric. Its `answered` is the
        number of the right answers before it.
    """
    size = len(answers[0].split())
    for i, answer in enumerate(answers):
        fields = answer.split()
        if fields[0] == "error":
            _, _, text = answer.partition("error")
            raise ProgramError(f"the program reports an error: {shown_reason(text)}", answered=i)
        if len(fields) != size or size not in (n, n + n * n):
            message = _describe_wrong_size(len(fields), size, n)
            if "," in answer:
                message += _SEPARATORS
            raise ProgramError(message, answered=i)
    text = " ".join(answers)
    try:
        numbers = np.array(text.split(), dtype=np.float64).reshape(-1, size)
    except ValueError:
        numbers = None
    # numpy reads 1_0 as ten.
    if numbers is None or "_" in text:
        i, word = next(_fields_without_number(answers))
        message = f"the program answers {word[:60]!r}, which is no number"
        if "," in word:
            message += _SEPARATORS
        raise ProgramError(message, answered=i) from None
    if size > n:
        numbers[:, n:] = _symmetrized(numbers[:, n:].reshape(-1, n, n)).reshape(-1, n * n)
    return numbers


def check_repeated(again: Array, mean: Array, cov: Array) -> None:
    """Check that a run that was begun anew has its earlier estimate.

    The new lines that the program is sent follow the line of this estimate.

    Parameters
    ----------
    again : array (n,) or (n + n^2,)
        Numbers of the repeated answer to the estimate's line.
    mean : array (n,)
        Mean of the earlier estimate.
    cov : array (n, n)
        Covariance of the earlier estimate; NaN if the program answers only means.

    Raises
    ------
    ProgramError
        If the numbers differ. Its `answered` is -1.
    """
    if not equals_estimate(again, mean, cov):
        message = "a run that begins again has other estimates: "
        hint = "does `init` set all of the state, and SEED all noise?"
        # `answered` counts the answers to the new lines, which follow those that were sent again. The
        # wrong answer, to the last line that was sent again, has the number -1.
        raise ProgramError(f"{message}{hint}", answered=-1)


def equals_estimate(answer: Array, mean: Array, cov: Array) -> bool:
    """Test whether an answer is an estimate, bit for bit.

    Parameters
    ----------
    answer : array (n,) or (n + n^2,)
        Mean, or mean and the rows of the covariance.
    mean : array (n,)
        Mean of the estimate.
    cov : array (n, n)
        Covariance of the estimate; NaN if the program answers only means.

    Returns
    -------
    bool
        True if all numbers are equal, or NaN in both.
    """
    n = len(mean)
    answered_cov = np.full((n, n), np.nan)  # that of a program that answers only means
    if len(answer) > n:
        answered_cov = answer[n:].reshape(n, n)
    has_same_mean = np.array_equal(mean, answer[:n], equal_nan=True)
    has_same_cov = np.array_equal(cov, answered_cov, equal_nan=True)
    return has_same_mean and has_same_cov


def _describe_wrong_size(count: int, first: int, n: int) -> str:
    """Describe an answer of ``count`` numbers, where the first answer has ``first`` numbers.

    ``n`` is the number of components of the state.
    """
    names = {n: "a mean alone", n + n * n: "a mean and a covariance"}
    if count in names and first in names:
        return f"the program answers {names[count]}, and before it {names[first]}"
    sizes = f"{n} of a mean, or {n + n * n} of a mean and a covariance"
    return f"the program answers {count} numbers, not {sizes}"


def _symmetrized(P: Array) -> Array:
    """Return covariances (T, n, n) with the mean of the entries that differ from their mirror image.

    Raises ProgramError if they differ by more than rounding, also in float32. The mirror image of a NaN
    or an infinity must be the same.
    """
    across = P.swapaxes(1, 2)
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(np.abs(np.diagonal(P, axis1=1, axis2=2)))
        scale = sd[:, :, None] * sd[:, None]
        # If a variance is not finite, the limit is relative to the two numbers that are compared.
        scale = np.where(np.isfinite(scale), scale, np.maximum(np.abs(P), np.abs(across)))
        difference = np.abs(P - across)
        differs = difference > ASYMMETRY * scale
        mean = 0.5 * P + 0.5 * across
    is_number = np.isfinite(P) & np.isfinite(across)
    is_alike = (np.isnan(P) & np.isnan(across)) | (across == P)
    wrong = np.where(is_number, differs, ~is_alike)
    if wrong.any():
        i, row, column = (int(k) for k in np.argwhere(wrong)[0])
        first, second = _written_differently(float(P[i, row, column]), float(P[i, column, row]))
        where = f"row {row + 1}, column {column + 1} and its mirror image"
        message = "the program answers a covariance that is not symmetric: "
        message += f"{where} are {first} and {second}"
        if is_number[i, row, column]:
            share = float(difference[i, row, column] / scale[i, row, column])
            message += (
                f", which differ by {share:.3g} of the product of the two standard deviations, more "
                f"than the allowed {ASYMMETRY:g}: keep (P + P') / 2 after each update"
            )
        raise ProgramError(message, answered=i)
    return np.where(is_alike, P, mean)


def _written_differently(a: float, b: float) -> tuple[str, str]:
    """Write two different numbers with as few digits as show the difference, at least 6."""
    for digits in (6, 9, 12):
        if f"{a:.{digits}g}" != f"{b:.{digits}g}":
            return f"{a:.{digits}g}", f"{b:.{digits}g}"
    return f"{a:.17g}", f"{b:.17g}"


def _fields_without_number(answers: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Yield the fields that are no numbers, each with the index of its answer.

    The ``answers`` are lines of the program, each with numbers between spaces.
    """
    for i, answer in enumerate(answers):
        for word in answer.split():
            try:
                np.array([word], dtype=np.float64)
            except ValueError:
                yield i, word
                continue
            # numpy reads 1_0 as ten, as Python does; a program that prints it is in error.
            if "_" in word:
                yield i, word
