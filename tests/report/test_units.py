"""Units of keys are declared, and never guessed from words."""

from dataclasses import dataclass
from typing import Annotated

import pytest

from trackbench.field_types import Unit
from trackbench.report.results import _unit

TEXTS = (
    *("names of files, s", "standard deviation, m", "time between looks, s, or steps"),
    *("rate, deg/s", "speed in km, m/s"),
)


@pytest.mark.parametrize("text", TEXTS)
def test_no_unit_comes_from_the_words_of_a_docstring(text: str) -> None:
    @dataclass(frozen=True, kw_only=True)
    class Keys:
        plain: float = 1.0
        declared: Annotated[float, Unit("km/h")] = 1.0

    Keys.__doc__ = text
    assert _unit({}, None, Keys, ["plain"]) == ""
    assert _unit({}, None, Keys, ["declared"]) == "km/h"


@pytest.mark.parametrize(
    ("group", "kind", "key", "unit"),
    [
        ("sensors", "position", "sigma", "m"),
        ("sensors", "range-azimuth", "sigma_azimuth_mrad", "mrad"),
        ("motions", "cwna", "q", "m^2/s^3"),
        ("motions", "singer", "tau", "s"),
        ("scenarios", "tracking", "T", "s"),
        ("scenarios", "tracking", "last", ""),
        ("filters", "alpha-beta", "q", "(m/s^2)^2"),
        ("filters", "pf", "N", ""),
    ],
)
def test_keys_of_the_package_have_their_units(group: str, kind: str, key: str, unit: str) -> None:
    assert _unit({"kind": kind}, group, None, [key]) == unit
