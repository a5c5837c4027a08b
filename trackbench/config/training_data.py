"""Training data of tuning: its scenario in a config, and in what it differs from the judged data."""

import copy
from dataclasses import replace

import numpy as np

from trackbench.config.build_components import build_kind
from trackbench.config.component_as_config import as_config
from trackbench.config.experiment import Experiment, Point
from trackbench.config.includes import deep_merge
from trackbench.evaluation.simulated_runs import simulate
from trackbench.plugins.plugin_errors import PluginError
from trackbench.plugins.scenario_trial import check_scenario
from trackbench.yaml_source import Source

TRAINING_SCENARIO = ("tuning", "scenario")
"""Keys of the training scenario in a config."""
NOISE = "noise"
PATH = "noise and path"
RUNS = "recordings"
TIME = "time"
"""Names, in the manifest, of the judged data that is held out of training."""


def training_point(source: Source, point: Point) -> Point | None:
    """Build the point with the scenario that training simulates; None if its keys are mistaken.

    Without such a scenario in the config it is ``point`` itself, the first of the experiment.
    """
    if not source.is_set(TRAINING_SCENARIO):
        return point
    changes = source.value_at(TRAINING_SCENARIO)
    if not isinstance(changes, dict):  # reported with the other settings
        return None
    # A component of another kind replaces that of the scenario whole (`by_kind`).
    whole = deep_merge(source.data["scenario"], changes, by_kind=True)
    changed = source.replaced(TRAINING_SCENARIO, copy.deepcopy(whole))
    scenario = build_kind("scenarios", changed, TRAINING_SCENARIO)
    if scenario is not None:
        try:
            check_scenario(scenario, bounded=False)  # no lower bounds are computed in training
        except PluginError as error:
            changed.add_problem(TRAINING_SCENARIO, str(error))
    source.problems += changed.problems
    if changed.problems:
        return None
    return replace(point, scenario=scenario)


def same_recordings(a: Point, b: Point) -> bool:
    """Test whether two points take their runs from the same recorded data."""
    if a.scenario.recorded_runs is None:  # simulated
        return False
    # The target of a recording has the paths of its data files.
    return as_config(a.scenario).get("target") == as_config(b.scenario).get("target")


def held_out_data(experiment: Experiment) -> str:
    """Name in what the judged data differ from the training data: noise, path, recordings or time.

    The result is one of the constants `NOISE`, `PATH`, `RUNS` and `TIME`.
    """
    judged = experiment.points[0]
    training = experiment.training
    assert training is not None
    # Of the same recordings either other runs are for training, or the first part of each. In the second
    # case the scenario has this part as a scenario of its own, `training`.
    if same_recordings(judged, training):
        return RUNS if training.scenario.training is None else TIME
    if judged.scenario.recorded_runs or training.scenario.recorded_runs:
        return PATH
    # Simulated data: compare the path of the first judged run with that of the first training run.
    # Training runs count down from -1.
    seed = experiment.settings.seed
    judged_path = simulate(judged.scenario, seed, 0, 1).truth
    training_path = simulate(training.scenario, seed, -1, 1).truth
    # The two scenarios may differ in components and steps: compare those of both.
    n, steps = np.minimum(judged_path.shape[:2], training_path.shape[:2])
    is_same_path = np.array_equal(
        judged_path[:n, :steps], training_path[:n, :steps], equal_nan=True
    )
    return NOISE if is_same_path else PATH
