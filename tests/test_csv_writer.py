"""The rows of per_run.csv have the same bytes with the C kernels and without."""

import numpy as np
import pytest

from trackbench.core import compiled
from trackbench.csv_writer import numbered_rows

SPECIAL = [
    *(0.0, -0.0, 1.0, -1.0, 5e-324, -3e-310, 1e308, np.inf, -np.inf, np.nan, np.nan),
    *(1e-5, 0.0001, 1.5e-7, 123456789.0, 1234567890.0, 0.1, 0.30000000000000004, 1e15, 1e16, 1e17),
    *(2.5, 2.5, 2.5, 9.9999999999, 99999999.95, -1e-300, 1 / 3, 2 / 3),
]


@pytest.mark.skipif(compiled.kernels is None, reason="no C compiler")
@pytest.mark.parametrize("digits", [1, 2, 6, 9, 10, 14, 15, 16, 17])
def test_rows_have_the_same_bytes(monkeypatch: pytest.MonkeyPatch, digits: int) -> None:
    rng = np.random.default_rng(1)
    random = rng.standard_normal(3000) * 10.0 ** rng.integers(-30, 30, 3000)
    moderate = rng.standard_normal(3000) * 10.0 ** rng.integers(-17, 17, 3000)
    # Decimals of few digits, halves between two of them, and their neighbors.
    powers = 10.0 ** np.arange(-18, 18)
    halves = np.outer([1.0, 5.0, 0.15, 1.25, 9.5, 9.9999999995, 0.99999999995, 122.5], powers)
    halves = np.concatenate((halves.ravel(), 2.0 ** np.arange(-60, 60), np.arange(200) / 64.0))
    halves = np.concatenate((halves, np.nextafter(halves, 0.0), np.nextafter(halves, np.inf)))
    values = np.concatenate((SPECIAL, random, moderate, halves))
    head = '"a, ""b""",1,'
    compiled_rows, compiled_numbers = numbered_rows(head, ",rmse (m²),", values, digits)
    monkeypatch.setattr(compiled, "kernels", None)
    rows, numbers = numbered_rows(head, ",rmse (m²),", values, digits)
    assert compiled_rows == rows
    assert compiled_numbers.tobytes() == numbers.tobytes()
    assert rows.count(b"\n") == len(values)


def test_no_runs_are_no_rows() -> None:
    rows, numbers = numbered_rows("a,", ",b,", np.empty(0), 9)
    assert (rows, len(numbers)) == (b"", 0)
