"""Units: each quantity of the package has its own, and an unknown one has none."""

from dataclasses import MISSING, fields
from typing import Any

import numpy as np
import pytest

from trackbench.evaluation.metric_expression import measure
from trackbench.metrics import quantity, unit_of
from trackbench.models.component_names import position_velocity_names
from trackbench.registry import kinds
from trackbench.report.figures.tuned_keys import axis_of_objective
from trackbench.report.findings.grid_headings import heading
from trackbench.report.findings.grid_headings import quantity as words_of
from trackbench.report.findings.metric_phrases import axis_of, head_of, metric_words, with_unit
from trackbench.report.rounded_numbers import multiple
from trackbench.scenarios.score import Score
from trackbench.units_of_components import UNITS_OF_QUANTITIES

UNITS = {
    "": {"x", "y", "z"},  # axes of a position, or components of a user's motion
    "m": {"position", "range", "mean_range", "radial", "cross", "px", "py", "pz"},
    "m/s": {"velocity", "vx", "vy", "vz", "range_rate"},
    "m/s^2": {"acceleration", "ax", "ay", "az"},
    "deg": {"azimuth_deg"},
    "rad": {"azimuth", "elevation"},
    "rad/s": {"turn_rate"},
}
KNOWN = {name: unit for unit, names in UNITS.items() for name in names}


def made(group: Any) -> list[Any]:
    """One of each kind of the package, with 1 for what it needs."""
    # Those whose components have the user's names, and one that needs one of two sigmas.
    written = {"function", "map", "ode", "landmark"}
    every = [
        c
        for kind, c in kinds(group).items()
        if c.__module__.startswith("trackbench.") and kind not in written
    ]
    return [c(**{f.name: 1.0 for f in fields(c) if f.default is MISSING}) for c in every]


def test_every_error_of_the_package_has_its_unit() -> None:
    names = {
        *Score().error_vectors(made("sensors")[0], position_velocity_names(3), *np.ones((2, 6, 1)))
    }
    for sensor in made("sensors"):
        names |= {*sensor.errors(*np.ones((2, 6, 1))), *sensor.observables(np.ones((6, 1)))}
    assert {"position", "azimuth_deg", "vx"} < names
    for name in names:
        assert unit_of(f"rmse_{name}") == unit_of(f"rmsd_{name}") == KNOWN[name]


def test_every_component_of_a_motion_has_its_unit() -> None:
    names = {
        name
        for motion in made("motions")
        for axes in (1, 2, 3)
        if axes == motion_axes(motion, axes)
        for name in motion.sampled(1.0, axes).components
    }
    assert {"px", "vz", "ay", "turn_rate", "x"} < names
    for name in names - {"x"}:
        assert unit_of(f"crps_{name}") == KNOWN[name]
    assert unit_of("crps_x") == ""  # of a scalar motion


def motion_axes(motion: Any, axes: int) -> int:
    """The axes that it has when it is asked for so many; 0 if it refuses."""
    try:
        motion.sampled(1.0, axes)
    except ValueError:
        return 0
    return axes


def test_every_component_of_a_sensor_has_its_unit() -> None:
    names = {name for sensor in kinds("sensors").values() for name in sensor.components}
    assert {"range", "azimuth", "range_rate", "elevation", "z"} < names
    for name in names - {"x", "y", "z"}:
        for metric in ("rmse_predicted_{}", "bias_held_2.{}"):
            assert unit_of(metric.format(name)) == KNOWN[name]
    assert unit_of("rmse_predicted_z") == ""  # a height, or a scalar sensor's


@pytest.mark.parametrize("name", ["heading", "temperature", "altitude", "power", "ax_bias"])
def test_an_unknown_quantity_has_no_unit(name: str) -> None:
    for metric in ("rmse", "bias", "std", "peak", "rmsd", "crps"):
        assert unit_of(f"{metric}_{name}") == ""
    m = measure(f"mean(rmse_{name})")
    assert with_unit("3.1", m) == "3.1"
    assert head_of("mean", m) == f"Mean {name.replace('_', ' ')} RMSE"


def test_a_name_may_end_in_its_unit() -> None:
    assert [unit_of(f"rmse_{n}") for n in ("heading_deg", "spin_deg_s", "clock_s", "way_km")] == [
        *("deg", "deg/s", "s", "km")
    ]
    assert metric_words(measure("rmse_spin_deg_s")) == "spin RMSE"
    assert words_of("scenario.sensor.sigma_azimuth_mrad") == ("sigma azimuth", "mrad")


def test_a_plugin_declares_the_unit_of_a_quantity() -> None:
    quantity("temperature", "K")
    try:
        quantity("temperature", "K")  # as a plugin that is loaded twice
        assert head_of("mean", measure("rmse_temperature")) == "Mean temperature RMSE (K)"
        assert unit_of("crps_temperature") == unit_of("rmse_predicted_1.temperature") == "K"
        for name, unit in (("temperature", "C"), ("position", "km")):
            with pytest.raises(ValueError, match="already"):
                quantity(name, unit)
    finally:
        del UNITS_OF_QUANTITIES["temperature"]


@pytest.mark.parametrize(
    ("objective", "label"),
    [
        ("mean(rmse_position)", "Position RMSE (m)"),
        ("log_score", "Negative log score (nats)"),
        ("anees", "Distance of ANEES from 1"),
        (
            {"rms(rmse_position)": 1.0, "anees": 0.5},
            "Sum of 1 x Position RMSE (m) + 0.5 x Distance of ANEES from 1",
        ),
    ],
)
def test_the_axis_of_an_objective_is_no_expression(
    objective: str | dict[str, float], label: str
) -> None:
    assert axis_of_objective(objective) == label


def test_paths_that_vary_together_have_a_value_each() -> None:
    assert heading({"scenario.Q & scenario.R": [1469.1, 15099]}) == "Q = 1469.1, R = 15099"
    assert heading({"scenario.Q & scenario.P": "[1, [[2]]]"}) == "Q = 1, P = 2"  # from a file
    assert heading({"scenario.target.runs": ["b2"]}) == "runs = b2"
    assert heading({"scenario.target.runs": "['b2', 'b3']"}) == "runs = b2, b3"
    assert heading({"filters.KF.q & filters.EKF.q": 2}) == "q = 2"
    assert heading({"filters.KF.way & filters.EKF.way": "a b"}) == "way = a b"
    assert heading({"scenario.q": [1, 2]}) == "q = [1, 2]"


@pytest.mark.parametrize(
    ("expression", "label"),
    [
        ("mean(rmse_position)", "Position RMSE (m)"),
        ("mean(rmse_heading)", "Heading RMSE"),
        ("mean(rmse)", "RMSE"),
        ("rms(rmse_position)", "Position RMSE (m)"),
        ("log_score", "Log score (nats)"),
        ("variance(rmse_position)", "variance(rmse_position)"),
        ("mean(rmse_position[turns])", "Position RMSE in turns (m)"),
        ("rmse_position@20", "Position RMSE at step 20 (m)"),
        ("anees_position", "ANEES position"),
        ("rmse_position@5..9", "rmse_position@5..9"),
        ("mean(nees)", "mean(nees)"),
    ],
)
def test_an_axis_says_what_it_shows(expression: str, label: str) -> None:
    assert axis_of(measure(expression)) == label


@pytest.mark.parametrize(
    ("ratio", "width", "text"),
    [
        (1.51, 5.0, "1.5"),
        (0.2, 5.0, "0.2"),
        (9.96, 5.0, "10"),
        (23.4, 11.0, "23"),
        (1.0243, 0.02, "1.024"),
        (1.0243, np.nan, "1.02"),
        (1.002, np.nan, "1.002"),
        (1.0002, np.inf, "1.000"),
        (1.0, np.nan, "1"),
        (2.0, np.nan, "2"),
    ],
)
def test_a_ratio_below_ten_has_a_decimal(ratio: float, width: float, text: str) -> None:
    """A ratio of 2 beside errors of 15.1 and 10 would contradict them, and so would 1 beside 10.02."""
    assert multiple(ratio, width) == text


def test_whole_numbers_of_a_grid_keep_all_digits() -> None:
    """They may be names, as the MMSI of a ship; other numbers have six digits."""
    assert heading({"scenario.target.runs": [235013375]}) == "runs = 235013375"
    assert heading({"seed": -1234567}) == "seed = -1234567"
    assert heading({"cov": 100_000_000_000}) == "cov = 1e+11"
    assert heading({"q": 0.123456789}) == "q = 0.123457"
    assert heading({"smooth": True}) == "smooth = True"
