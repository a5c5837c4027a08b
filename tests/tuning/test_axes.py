"""Ranges of keys as they are written."""

from typing import Any

import pytest

from trackbench.config.tuning_axes import Axis, read_axis


def test_a_logarithmic_range_is_even_in_the_logarithm() -> None:
    axis = read_axis("q", "log:1e-6..10")
    assert [axis.at(s) for s in (-1.0, 0.0, 3 / 7, 1.0, 2.0)] == [1e-6, 1e-6, 1e-3, 10.0, 10.0]
    assert axis.share(1e-3) == pytest.approx(3 / 7)


def test_values_have_four_digits_and_stay_within_the_ends() -> None:
    axis = read_axis("q", "0.123456..0.654321")
    assert axis.at(0.5) == 0.3889
    assert (axis.at(0.0), axis.at(1.0)) == (0.123456, 0.654321)
    assert axis.share(0.7) is None
    assert axis.share(True) is None


def test_whole_numbers_and_choices() -> None:
    whole = Axis("N", 1, 9, whole=True)
    assert [whole.at(s) for s in (0.0, 0.49, 0.51, 1.0)] == [1, 5, 5, 9]
    assert isinstance(whole.at(0.3), int)
    kinds = read_axis("kind", ["cv", "cwna", "ca"])
    assert [kinds.at(s) for s in (0.0, 0.5, 1.0)] == ["cv", "cwna", "ca"]
    assert [kinds.at(kinds.share(kind) or 0.0) for kind in kinds.choices] == list(kinds.choices)
    assert kinds.share("singer") is None


@pytest.mark.parametrize(
    ("written", "what"),
    [
        ("1..1", "does not rise"),
        ("10..1", "does not rise"),
        ("log:0..1", "ends above zero"),
        ("0..1e999", "does not rise"),
        ("log:1e-300..1e300", "is too wide; ends of up to 1e100, or log:1e-100..1e100"),
        ("log:1e-101..1", "is too wide"),
        ("-1e101..1", "is too wide"),
        ("0..1:5", "write a..b"),
        (3, "write a..b"),
        (None, "write a..b"),
        (["cv"], "at least two"),
        (["cv", "cv"], "twice"),
    ],
)
def test_what_is_no_range_is_said(written: Any, what: str) -> None:
    with pytest.raises(ValueError, match=what):
        read_axis("q", written)
