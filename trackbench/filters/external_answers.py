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
    """Return the numbers of the answers: (T, n) of means, or (T, n + n^2) with covariances.

    Covariances that are symmetric up to rounding are made symmetric. Raises ProgramError for a wrong
    answer.
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
    """Raise ProgramError unless a run that was begun anew has its earlier estimate.

    The estimate is a mean (n,) and a covariance (n, n). ``again`` are the numbers (n,) or (n + n^2,) of
    the repeated answer to the estimate's line. The new lines that the program is sent follow that line.
    """
    if not equals_estimate(again, mean, cov):
        message = "a run that begins again has other estimates: "
        hint = "does `init` set all of the state, and SEED all noise?"
        # `answered` counts the answers to the new lines, which follow those that were sent again. The
        # wrong answer, to the last line that was sent again, has the number -1.
        raise ProgramError(f"{message}{hint}", answered=-1)


def equals_estimate(answer: Array, mean: Array, cov: Array) -> bool:
    """Test whether an answer (n,) or (n + n^2,) is the estimate: mean (n,) and cov (n, n)."""
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
                f", which differ by {share:.3g} of the product of the two standard deviations; "
                f"{ASYMMETRY:g} is allowed: keep (P + P') / 2 after each update"
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
