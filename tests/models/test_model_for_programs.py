"""The filter model that programs are told on their first line, with the keys of a config."""

import json
import math
import pickle
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from trackbench.config.suite import load_suite
from trackbench.contract.interval_check import at_unequal_intervals
from trackbench.contract.problems import ModelDraws, radar
from trackbench.filters import external_lines
from trackbench.filters.external import External
from trackbench.models.assume import Assume
from trackbench.models.base import Model
from trackbench.models.model_for_programs import PlainData, describe_model
from trackbench.models.motions.coordinated_turn import UnknownTurn
from trackbench.models.motions.kinematic import ConstantVelocity, WhiteAcceleration
from trackbench.models.sensors.function import FunctionSensor
from trackbench.models.sensors.noise import Noise
from trackbench.models.sensors.platform import Platform
from trackbench.models.sensors.position import PositionSensor
from trackbench.models.sensors.range_azimuth import PolarPosition, RangeAzimuth
from trackbench.scenarios.tracking import Tracking


def first_line(model: Model, **parameters: float) -> PlainData:
    """Read the first line that a program is sent, as strict JSON."""
    tracker = External(command=("cat",), parameters=parameters)

    def reject(word: str) -> float:
        raise AssertionError(f"{word} is not JSON")

    text = external_lines.first_line(model, tracker.parameters).removeprefix("trackbench 1 ")
    told: PlainData = json.loads(text, parse_constant=reject)
    return told


def test_a_program_is_told_motion_sensor_and_start_of_a_radar() -> None:
    told = first_line(radar(q=25.0, sigma=40.0).model)
    assert told["model"] is None
    (sensor,) = told["sensors"]
    assert sensor["R"] == [[1600.0, 0.0], [0.0, pytest.approx(0.0016)]]
    del sensor["R"]
    assert sensor == {
        "kind": "range-azimuth",
        "components": ["range", "azimuth"],
        "angles": ["azimuth"],
        "at": [0.0, 0.0],
        "sigma_range": 40.0,
        "sigma_azimuth": pytest.approx(0.04),
    }
    motion = WhiteAcceleration(q=25.0).sampled(2.0)
    assert told["motion"] == {
        "kind": "cwna",
        "q": 25.0,
        "F": motion.F.tolist(),
        "Q": motion.Q.tolist(),
    }
    assert told["start"] == {"kind": "gaussian", "sigma": [20.0, 10.0, 30.0, 15.0]}
    assert told["first_step"] == 0


def test_the_radar_of_the_problem_drone_has_its_place() -> None:
    """The place that programs could not know: nearly 2 km from the origin."""
    told = first_line(load_scenario("drone").model)
    (sensor,) = told["sensors"]
    assert sensor["at"] == [-1500.0, -1500.0]


def load_scenario(name: str) -> Tracking:
    """Load the scenario of a problem of the suite `standard`."""
    (problem,) = load_suite(Path("standard"), chosen_problems=[name]).problems
    scenario = problem.experiment.points[0].scenario
    assert isinstance(scenario, Tracking)
    return scenario


def test_what_no_filter_models_is_not_told() -> None:
    """A filter of the package is not told the bias either; its sensor only has the noise."""
    sensor = RangeAzimuth(
        sigma_range=3.0, sigma_azimuth_mrad=2.0, bias=(5.0, 0.1), detection=0.5, period=2
    )
    told = first_line(replace(radar(), sensor=sensor).model)
    assert set(told["sensors"][0]) == {
        "kind", "components", "angles", "at", "sigma_range", "sigma_azimuth", "R",
    }  # fmt: skip


def test_the_assumed_model_is_told_and_not_the_true_one() -> None:
    assumed = Assume(
        motion=ConstantVelocity(q=0.5), sensor=RangeAzimuth(sigma_range=1.0, sigma_azimuth_mrad=1.0)
    )
    told = first_line(radar(q=25.0).with_assumptions(assumed).model)
    assert told["motion"]["kind"] == "cv"
    assert told["motion"]["q"] == 0.5
    assert told["sensors"][0]["sigma_range"] == 1.0


def test_angles_and_rates_are_in_radians() -> None:
    motion = UnknownTurn(q=1.0, turn_walk_deg_s=2.0)
    told = first_line(radar().with_assumptions(Assume(motion=motion)).model)
    assert told["motion"]["turn_walk"] == pytest.approx(math.radians(2.0))
    assert told["motion"]["initial_std"] == pytest.approx(math.radians(3.0))
    assert "F" not in told["motion"]
    assert np.array(told["motion"]["Q"]).shape == (5, 5)
    assert told["components"][-1] == "turn_rate"


def test_several_sensors_are_a_list_in_the_order_of_the_measurement() -> None:
    path = Platform(steps=(0, 4), x=(0.0, 10.0), y=(1.0, 2.0))
    sensors = (
        RangeAzimuth(sigma_range=3.0, sigma_azimuth_mrad=2.0, platform=path),
        PositionSensor(sigma=4.0),
        PolarPosition(sigma_range=3.0, sigma_azimuth_mrad=2.0, at=(1.0, 2.0)),
        FunctionSensor(h={"r": "px", "s": "atan2(py, px)"}, R={"r": 4.0, "s": "px**2"}),
    )
    told = first_line(replace(radar(), sensor=sensors).model)["sensors"]
    kinds = ["range-azimuth", "position", "polar-position", "function"]
    assert [sensor["kind"] for sensor in told] == kinds
    assert told[0]["platform"] == {"steps": [0, 4], "x": [0.0, 10.0], "y": [1.0, 2.0]}
    assert "at" not in told[0]
    assert told[1]["R"] == [[16.0, 0.0], [0.0, 16.0]]
    assert told[1]["H"] == [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]
    assert "H" not in told[0]
    assert told[2]["at"] == [1.0, 2.0]
    assert "R" not in told[2]  # it depends on the state
    assert told[3]["R"] == {"r": 4.0, "s": "px**2"}
    assert told[3]["angles"] == ["s"]


def test_the_covariance_of_noise_that_is_not_normal_is_that_of_its_variance() -> None:
    """Only `model` had it, and not the sensor."""
    h = {"x": "px", "y": "py"}
    sensors = (
        FunctionSensor(h=h, noise=Noise(kind="student-t", df=2.5, scale=5.0)),
        FunctionSensor(h=h, noise=Noise(kind="mixture", outliers=0.1, factor=10.0), R=4.0),
        FunctionSensor(h=h, noise=Noise(kind="student-t", df=2.0, scale=5.0)),
        FunctionSensor(h={"n": "px"}, noise="poisson"),
    )
    told = first_line(replace(radar(), sensor=sensors).model)["sensors"]
    # The variances are scale^2 df / (df - 2), and R (0.9 + 0.1 factor^2).
    assert told[0]["R"] == [[125.0, 0.0], [0.0, 125.0]]
    np.testing.assert_allclose(told[1]["R"], [[43.6, 0.0], [0.0, 43.6]], rtol=1e-12)
    assert "R" not in told[2]  # it is infinite
    assert "R" not in told[3]  # the variance of a count is its rate
    (single,) = first_line(replace(radar(), sensor=sensors[0]).model)["sensors"]
    assert single["R"] == first_line(replace(radar(), sensor=sensors[0]).model)["model"]["R"]


def test_unequal_steps_have_no_matrices() -> None:
    problem = at_unequal_intervals(ModelDraws(base=radar()))
    assert problem is not None
    told = first_line(problem.model)
    assert told["T"] is None
    assert told["motion"] == {"kind": "cwna", "q": 25.0}


def test_a_program_that_searches_the_line_finds_what_it_found_before() -> None:
    """Programs find `"F": [[` of a linear model, or a parameter `"q": `, by their text."""
    tracker = External(command=("cat",))
    text = external_lines.first_line(radar().model, tracker.parameters)
    told = first_line(radar().model)
    assert [*told] == [
        "components", "measurement", "T", "parameters", "model",
        "first_step", "motion", "sensors", "start",
    ]  # fmt: skip
    searched = text.partition('"first_step"')[2]
    assert '"q":25.0' in searched
    assert ": " not in searched
    assert ", " not in searched


def test_a_model_without_a_config_has_sensors_alone() -> None:
    motion, sensor = radar().model
    told = describe_model(Model(motion, sensor))
    assert told["motion"] is None
    assert told["start"] is None
    assert told["sensors"][0]["kind"] == "range-azimuth"


def test_a_described_model_is_a_model_that_can_be_copied() -> None:
    model = radar().model
    motion, sensor = model
    assert (model.motion, model.sensor) == (motion, sensor)
    for copied in (pickle.loads(pickle.dumps(model)), deepcopy(model)):
        assert describe_model(copied) == describe_model(model)
    # A copy with another sensor has no description, as that would be of the first one.
    described = describe_model(model._replace(sensor=PositionSensor(sigma=1.0)))
    assert described["sensors"][0]["kind"] == "position"


def test_equations_are_told_as_written() -> None:
    told = first_line(load_scenario("ungm").model)
    assert told["motion"]["kind"] == "map"
    assert told["motion"]["Q"] == [[1.0]]
    assert told["sensors"][0]["h"] == {"y": "x**2/20"}
