"""Units of keys are declared, and never guessed from words."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest

from trackbench.field_types import Unit
from trackbench.report.figures.panels_of_points_and_filters import panel_headings
from trackbench.report.findings import metric_phrases
from trackbench.report.plotting import style
from trackbench.report.tables_and_figures import Results
from trackbench.report.units_of_config_keys import unit_of_setting

STORED = Path(__file__).parents[2] / "results"

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
    assert unit_of_setting({}, None, Keys, ["plain"]) == ""
    assert unit_of_setting({}, None, Keys, ["declared"]) == "km/h"


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
    assert unit_of_setting({"kind": kind}, group, None, [key]) == unit


@pytest.mark.parametrize(
    ("experiment", "figure", "x_labels"),
    [
        ("ais", "tuning-EKF-Singer", ["sigma of motion (m/s²)", "sigma of sensor 1 (m)"]),
        (
            "adaptive-kf-tuned",
            "tuning-IMM",
            ["q of motion 1 (m²/s⁴)", "q of motion 2 (m²/s⁴)"],
        ),
    ],
)
def test_axes_of_tuned_keys_have_words_and_units(
    experiment: str, figure: str, x_labels: list[str]
) -> None:
    results = Results(STORED / experiment)
    with style.rc_context():
        drawn = results.parts("figures")[figure].draw(results)
    panels = [ax for ax in drawn.axes if ax.axison]
    assert [ax.get_xlabel() for ax in panels] == x_labels
    names = [text.get_text().replace("\n", " ") for text in drawn.legends[0].get_texts()]
    has_spread = "Within 1 standard error of the best" in names
    # The score of a recording has no standard error.
    assert has_spread == (experiment != "ais")
    caption = results.parts("figures")[figure].default_caption(results)
    assert ("Shaded is what is within its standard error." in caption) == has_spread
    assert caption.endswith("Triangles stand for trials above the axis.")
    assert ("Best trial, ± 1 standard error" if has_spread else "Best trial") in names
    assert {"Trial", "Trial above the axis", "Only this key changed"} <= set(names)
    trials = [line for ax in panels for line in ax.lines if line.get_label() == "Trial"]
    assert trials
    assert not any(line.get_clip_on() for line in trials)


@pytest.mark.parametrize(
    ("unit", "shown"),
    [
        ("m^2/s^3", "m²/s³"),
        ("(m/s^2)^2", "m²/s⁴"),
        ("(m/s)^2", "m²/s²"),
        ("rad/s", "rad/s"),
        ("s^-1", "s⁻¹"),
        ("", ""),
    ],
)
def test_units_have_raised_powers(unit: str, shown: str) -> None:
    assert metric_phrases.with_raised_powers(unit) == shown


def test_the_time_of_a_state_without_units_has_none() -> None:
    """The system of Lorenz has components without units."""
    results = Results(STORED / "lorenz63-mandel")
    assert "scenario.T" not in results.grid_units
    headings = panel_headings(results, results.points())
    assert headings == ["T = 0.05", "T = 0.35", "T = 0.55"]
