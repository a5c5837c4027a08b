"""Dates and times of recordings in a form of strptime."""

import pytest

from trackbench.scenarios.recordings.parse_dates import moment


@pytest.mark.parametrize(
    ("cell", "form", "microsecond"),
    [
        ("12:00:05:10", "%H:%M:%S:%f", 100_000),
        ("12:00:05:105", "%H:%M:%S:%f", 105_000),
        ("12:00:05", "%H:%M:%S:%f", 0),
        ("120005", "%H%M%S.%f", 0),
        ("01.02.2024 12:00:05", "%d.%m.%Y %H:%M:%S.%f", 0),
        ("01.02.2024 12:00:05.123456789", "%d.%m.%Y %H:%M:%S.%f", 123_456),
        ("5", "%f", 500_000),
    ],
)
def test_a_second_may_have_digits_or_none(cell: str, form: str, microsecond: int) -> None:
    assert moment(cell, form).microsecond == microsecond


@pytest.mark.parametrize(("cell", "form"), [("noon", "%f"), ("12:00:05:x", "%H:%M:%S:%f")])
def test_another_form_is_a_value_error(cell: str, form: str) -> None:
    with pytest.raises(ValueError, match=f"a time as {form}"):
        moment(cell, form)


def test_elapsed_hours_go_on_beyond_a_day() -> None:
    before = moment("23:59:59", "%H:%M:%S")
    after = moment("24:00:00.5", "%H:%M:%S.%f")
    assert (after - before).total_seconds() == 1.5
    assert (moment("100:00:00", "%H:%M:%S") - after).total_seconds() == 76 * 3600 - 0.5


def test_a_day_of_the_year_is_a_date_in_iso_8601() -> None:
    assert moment("2024-123T04:05:06.5+02:00").isoformat() == "2024-05-02T04:05:06.500000+02:00"
    assert moment("2024123T040506").isoformat() == "2024-05-02T04:05:06"
    assert moment("2024-366").isoformat() == "2024-12-31T00:00:00"


@pytest.mark.parametrize(
    "cell", ["2023-366", "2024-000", "2024-367T00:00:00", "2024-12", "2024123"]
)
def test_a_day_that_the_year_lacks_is_a_value_error(cell: str) -> None:
    with pytest.raises(ValueError, match="a time in ISO 8601"):
        moment(cell)
