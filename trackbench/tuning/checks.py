"""What an experiment's tuning may ask for: every mistake with its line, and the axes of its keys."""

from dataclasses import replace
from typing import Any

from trackbench.experiment.problems import Problem
from trackbench.experiment.reading.checks import blame_label
from trackbench.experiment.reading.definition import Point, Settings
from trackbench.experiment.reading.source import Source
from trackbench.tuning.axes import Axis, read_axis
from trackbench.tuning.objective import bad_terms, default_metric
from trackbench.tuning.scenario import KEYS, same_recordings
from trackbench.tuning.settings import tuned
from trackbench.tuning.trials import Tried, make_trial

_MOST_KEYS = 5


def with_defaults(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> Settings:
    """Metric and runs written out, if anything is tuned by them."""
    if training is None:
        return settings
    tuning, scenario = settings.tuning, training.scenario
    if tuning.metric is None:
        # Without a truth in either scenario, the metric is one that needs none.
        least = min(points[0], training, key=lambda point: point.scenario.has_truth)
        tuning = replace(tuning, metric=default_metric(least.scenario))
    if scenario.training is not None and "runs" not in (source.data.get("tuning") or {}):
        tuning = replace(tuning, runs=scenario.recorded_runs or tuning.runs)
    return replace(settings, tuning=tuning)


def tuned_axes(
    source: Source, settings: Settings, points: list[Point], training: Point | None
) -> dict[str, tuple[Axis, ...]]:
    """The axes of the keys of each filter that is tuned and run."""
    if not settings.tune:
        return {}
    before, out = len(source.problems), dict[str, tuple[Axis, ...]]()
    _check(source, settings, points, training)
    for label, keys in settings.tune.items():
        if label == KEYS[1] and label not in settings.filters:
            what = "is no filter; the scenario of training stands under `tuning: {scenario: ...}`"
            source.blame_key(("tune", label), what)
        elif label not in settings.filters:
            blame_label(source, settings, ("tune", label), label)
        elif not 1 <= len(keys) <= _MOST_KEYS:
            what = f"{len(keys)} keys; a filter is tuned in 1 to {_MOST_KEYS}"
            source.blame_key(("tune", label), what)
        elif label == settings.reference:
            source.blame_key(("tune", label), "the reference filter is what others are measured to")
        else:
            axes = [_axis(source, label, key, keys[key]) for key in keys]
            good = len(source.problems) == before
            if None not in axes and training is not None and good:
                whole = _tried(source, training, label, [a for a in axes if a is not None])
                if not settings.only or tuned(label) in settings.only:
                    out[label] = whole
    return out


def _check(source: Source, settings: Settings, points: list[Point], training: Point | None) -> None:
    tuning = settings.tuning
    if settings.grid:
        what = "each point of a grid has values of its own: tune one experiment per point"
        source.blame_key(("tune",), what)
    for word, what in bad_terms(tuning.metric):
        keys = ("tuning", "metric", *([] if isinstance(tuning.metric, str) else [word]))
        source.blame(keys, what)
    most = 0 if training is None else training.scenario.recorded_runs or 0
    in_time = training is not None and training.scenario.training is not None
    shared = training is not None and not in_time and same_recordings(points[0], training)
    beside = settings.runs if shared else 0
    if most and beside + tuning.runs > most:
        what = (
            f"{tuning.runs} training runs beside {settings.runs} of the results are more than the "
            f"{most} recorded ones: ask for fewer `runs`, or fewer here, or share out their time "
            "(the scenario's `score: {train: 0.5}`)"
            if beside
            else f"{tuning.runs} is more than the {most} recorded runs"
        )
        source.blame(("tuning", "runs"), what)


def _axis(source: Source, label: str, key: str, written: Any) -> Axis | None:
    try:
        return read_axis(key, written)
    except ValueError as error:
        source.blame(("tune", label, key), str(error))
        return None


def _tried(source: Source, point: Point, label: str, axes: list[Axis]) -> tuple[Axis, ...]:
    """The axes, those of whole numbers found out by trying; both ends and every choice must do."""
    middle: dict[str, Any] = {axis.key: axis.at(0.5) for axis in axes}
    out = []
    for axis in axes:
        if not axis.choices and axis.low.is_integer() and axis.high.is_integer():
            between = {**middle, axis.key: 0.5 * (axis.low + axis.high) + 0.25}
            if not isinstance(make_trial(source, point, label, between), Tried):
                axis = replace(axis, whole=True)
                middle[axis.key] = axis.at(0.5)
        out.append(axis)
    for axis in out:
        for value in axis.choices or (axis.at(0.0), axis.at(1.0)):
            tried = make_trial(source, point, label, {**middle, axis.key: value})
            for problem in [] if isinstance(tried, Tried) else tried:
                source.blame(("tune", label, axis.key), f"at {value}: {_said(problem, label)}")
    return tuple(out)


def _said(problem: Problem, label: str) -> str:
    path = problem.path.removeprefix(f"filters.{label}").removeprefix(".")
    return f"{path}: {problem.what}" if path else problem.what
