"""Key `tune` of a config: its tuned keys, read and checked; checks of objective and training data."""

from collections.abc import Mapping
from dataclasses import replace

from trackbench.config.available_metrics import names_of
from trackbench.config.chosen_filters import add_label_problem
from trackbench.config.experiment import Experiment, Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.metric_name_checks import why_unknown
from trackbench.config.requested_metrics import requests_of_tuning
from trackbench.config.requested_truth import is_measured_in, needs_truth
from trackbench.config.training_data import NOISE, held_out_data, same_recordings
from trackbench.config.tuned_filters import Trial, make_trial
from trackbench.config.tuning import tuned_label
from trackbench.config.tuning_axes import Axis, read_axis
from trackbench.config.tuning_objective import bad_terms
from trackbench.errors import counted
from trackbench.yaml_source import Source

_MOST_KEYS = 5


def tuned_axes(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> dict[str, tuple[Axis, ...]]:
    """Read, by label, the axes of the tuned keys of each filter that is run.

    ``training`` is the point with the training scenario, on which values of the axes are tried; None if
    it cannot be built. Mistakes are added to the source.
    """
    if not settings.tune:
        return {}
    problems_before = len(source.problems)
    _check_tuning(source, settings, points, training)
    axes_by_label: dict[str, tuple[Axis, ...]] = {}
    for label, keys in settings.tune.items():
        # An entry `scenario` under `tune` was meant for `tuning`, and gets a message of its own.
        if label not in settings.filters and label != "scenario":
            add_label_problem(source, settings, ("tune", label), label)
            continue
        message = _why_not_tunable(settings, label, len(keys))
        if message:
            source.add_key_problem(("tune", label), message)
            continue
        axes = _read_axes(source, label, keys)
        # The values of the axes are tried on the filter only if nothing else is mistaken.
        if training is None or len(source.problems) > problems_before:
            continue
        tried_axes = _try_axes(source, training, label, axes)
        if not settings.only or tuned_label(label) in settings.only:
            axes_by_label[label] = tried_axes
    return axes_by_label


def _why_not_tunable(settings: Settings, label: str, number_of_keys: int) -> str:
    """Explain why a filter cannot be tuned; an empty text if it can."""
    if label not in settings.filters:  # only `scenario` is passed on by `tuned_axes`
        return "is no filter; the scenario of training stands under `tuning: {scenario: ...}`"
    if not 1 <= number_of_keys <= _MOST_KEYS:
        return f"{number_of_keys} keys; a filter is tuned in 1 to {_MOST_KEYS}"
    if label == settings.reference:
        return "the reference filter measures the others; tune another filter"
    return ""


def _read_axes(source: Source, label: str, keys: Mapping[str, object]) -> list[Axis]:
    """Read the axis of each tuned key; mistakes are added to the source."""
    axes = []
    for key, written in keys.items():
        try:
            axes.append(read_axis(key, written))
        except ValueError as error:
            source.add_problem(("tune", label, key), str(error))
    return axes


def _check_tuning(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> None:
    """Check the grid, the objective and the number of training runs."""
    tuning = settings.tuning
    # Step 1: the grid and the terms of the objective.
    if settings.grid:
        message = "each point of a grid has values of its own: tune one experiment per point"
        source.add_key_problem(("tune",), message)
    for word, message in bad_terms(tuning.metric):
        place = (
            ("tuning", "metric") if isinstance(tuning.metric, str) else ("tuning", "metric", word)
        )
        source.add_problem(place, message)
    # Step 2: the number of recorded runs.
    if training is None or not training.scenario.recorded_runs:
        return
    recorded_runs = training.scenario.recorded_runs
    trains_on_time_share = training.scenario.training is not None
    if not trains_on_time_share and same_recordings(points[0], training):
        # Results and training take different runs of the same recordings.
        if settings.runs + tuning.runs > recorded_runs:
            message = (
                f"{counted(tuning.runs, 'training run')} beside {settings.runs} of the results are more"
                f" than the {recorded_runs} recorded ones: ask for fewer `runs`, or fewer here, or"
                " share out their time (the scenario's `score: {train: 0.5}`)"
            )
            source.add_problem(("tuning", "runs"), message)
    elif tuning.runs > recorded_runs:
        message = f"{tuning.runs} is more than the {counted(recorded_runs, 'recorded run')}"
        source.add_problem(("tuning", "runs"), message)


def _try_axes(source: Source, point: Point, label: str, axes: list[Axis]) -> tuple[Axis, ...]:
    """Try values of the tuned keys' ``axes`` on the filter; return the axes.

    An axis whose key takes only whole numbers is returned as whole. A value at an end, or a choice, that
    the filter rejects is a mistake, which is added to the source.
    """
    # Step 1: an axis between whole numbers is whole if the filter rejects a value between them.
    # Each key at the middle of its axis: while one key is tried, the others stay there.
    middle: dict[str, object] = {axis.key: axis.at(0.5) for axis in axes}
    tried_axes = []
    for axis in axes:
        tried_axis = axis
        if not axis.choices and axis.low.is_integer() and axis.high.is_integer():
            # The middle plus 1/4 is no whole number, as the middle is a multiple of 1/2.
            between = {**middle, axis.key: 0.5 * (axis.low + axis.high) + 0.25}
            if not isinstance(make_trial(source, point, label, between), Trial):
                tried_axis = replace(axis, whole=True)
                middle[axis.key] = tried_axis.at(0.5)
        tried_axes.append(tried_axis)
    # Step 2: try both ends and all choices, with the other keys at their middle.
    for axis in tried_axes:
        for value in axis.choices or (axis.at(0.0), axis.at(1.0)):
            trial = make_trial(source, point, label, {**middle, axis.key: value})
            if isinstance(trial, Trial):
                continue
            for problem in trial:
                path = problem.path.removeprefix(f"filters.{label}").removeprefix(".")
                message = f"{path}: {problem.message}" if path else problem.message
                source.add_problem(("tune", label, axis.key), f"at {value}: {message}")
    return tuple(tried_axes)


def training_cautions(experiment: Experiment) -> list[str]:
    """Warn of filters that are tuned on the very path that judges them; empty without such filters."""
    if not experiment.tuned or held_out_data(experiment) != NOISE:
        return []
    return [
        "filters are tuned on the path that judges them, and only the noise is held out; to train on "
        "other paths: `tuning: {scenario: {target: {kind: random-legs, ...}}}` (docs/tuning.md)"
    ]


def check_trained_metrics(source: Source, settings: Settings, training: Point | None) -> None:
    """Check that the metric of tuning is one of the training scenario, which has the truth it needs.

    ``training`` is the point with the scenario that filters are tuned on. It is None if nothing is tuned
    or the scenario has mistakes.
    """
    if training is None:
        return
    # Training may take the first part of each recording, as a scenario of its own.
    trained_scenario = training.scenario.training or training.scenario
    # A truth is recorded, but at no step that the training scores. In a scenario without any truth
    # metrics of errors do not exist, which is reported as for other unknown metrics.
    if trained_scenario.has_truth and not is_measured_in(trained_scenario):
        for request in requests_of_tuning(settings):
            if needs_truth(request.measure):
                message = (
                    "no step of the training has a truth; "
                    "tune by log_score, or train on other steps"
                )
                source.add_problem(request.keys, message)
    if settings.tuning.scenario is None:  # the metric is then checked with those of the experiment
        return
    # No filters beside those of the point count. The objective may be a diagnostic, too.
    names = names_of(settings, [training], left_out={}, with_diagnostics=True)
    for request in requests_of_tuning(settings):
        why = why_unknown(request, names, settings)
        if why is not None:
            source.add_problem(("tuning", "scenario"), f"tuning.metric: {why}")
