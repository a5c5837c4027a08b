"""The scenario that filters are tuned on, and what of the judged one it holds out."""

import copy
from dataclasses import replace
from typing import Any

import numpy as np

from trackbench.config.build_kinds import build_kind
from trackbench.config.dump import as_config
from trackbench.config.experiment import Experiment, Point
from trackbench.config.includes import deep_merge
from trackbench.config.plugin_checks import mistake_of
from trackbench.evaluation.block import simulate
from trackbench.yaml_source import Source

KEYS = ("tuning", "scenario")
NOISE, PATH, RUNS, TIME = "noise", "noise and path", "recordings", "time"
"""What of the judged data training has not seen, as the manifest says it."""


def training_point(source: Source, point: Point) -> Point | None:
    """Return the point with the scenario that training simulates; None if its keys are mistaken."""
    given = (source.data.get("tuning") or {}).get("scenario")
    if given is None:
        return point
    if not isinstance(given, dict):  # said with the other settings
        return None
    # Positions of the given keys stand over those of the scenario that they are laid over.
    whole = deep_merge(copy.deepcopy(source.data["scenario"]), copy.deepcopy(given), by_kind=True)
    own = Source({KEYS[0]: {KEYS[1]: whole}})
    own.adopt_positions(KEYS, source.subtree(("scenario",), None))
    own.adopt_positions(KEYS, source.subtree(KEYS, None))
    scenario = build_kind("scenarios", own, KEYS)
    what = None if scenario is None else mistake_of(scenario, bounded=False)
    if what is not None:
        own.add_problem(KEYS, what)
    source.problems += own.problems
    return None if own.problems else replace(point, scenario=scenario)


def same_recordings(a: Point, b: Point) -> bool:
    """Return whether two points take their runs from the same recorded data."""
    targets: list[Any] = [as_config(point.scenario).get("target") for point in (a, b)]
    return a.scenario.recorded_runs is not None and targets[0] == targets[1]


def held_out(experiment: Experiment) -> str:
    """Return the judged data outside training; the paths of two runs are compared."""
    judged, training = experiment.points[0], experiment.training
    assert training is not None
    if same_recordings(judged, training):
        return RUNS if training.scenario.training is None else TIME
    if judged.scenario.recorded_runs or training.scenario.recorded_runs:
        return PATH
    seed = experiment.settings.seed
    paths = [
        simulate(point.scenario, seed, run, 1).truth for point, run in ((judged, 0), (training, -1))
    ]
    n, steps = np.min([path.shape[:2] for path in paths], axis=0)
    one, other = (path[:n, :steps] for path in paths)
    return NOISE if np.array_equal(one, other, equal_nan=True) else PATH


def training_cautions(experiment: Experiment) -> list[str]:
    """Return a sentence on filters that are tuned on the very path that judges them."""
    if not experiment.tuned or held_out(experiment) != NOISE:
        return []
    return [
        "filters are tuned on the path that judges them, and only the noise is held out; to train on "
        "other paths: `tuning: {scenario: {target: {kind: random-legs, ...}}}` (docs/tuning.md)"
    ]
