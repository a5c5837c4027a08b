"""Checks of tables and figures: conflicts, declared tracks, runs and components, key figure."""

from collections.abc import Iterable, Iterator, Sequence

from trackbench.component_parts import field_values, is_foreign
from trackbench.config.bound_and_exact_errors import exact_label, why_not_controlled
from trackbench.config.chosen_filters import add_label_problem
from trackbench.config.did_you_mean import unknown
from trackbench.config.experiment import DrawnExhibit, Exhibit, Labeled, Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.key_and_value_mistakes import add_conflicts
from trackbench.evaluation.metric_expression import Measure
from trackbench.filters.base import WrongReturnError
from trackbench.plugins.checked_hook_calls import call_hook, check_words
from trackbench.plugins.plugin_errors import PluginError, plugin_code
from trackbench.registry import Group
from trackbench.yaml_source import Keys, Source


def check_key_figure(source: Source, settings: Settings) -> None:
    """Check that the report's key figure is one of the experiment's."""
    name = settings.key_figure
    if name is not None and name not in settings.figures:
        hint = "there are none: leave this key out"
        if settings.figures:
            hint = unknown(name, list(settings.figures))
        source.add_problem(("key_figure",), f"{name!r} is not a figure here; {hint}")


def check_drawable(
    source: Source, group: Group, exhibits: dict[str, Exhibit], points: list[Point]
) -> None:
    """Add the conflicts of tables and figures with these points.

    A plugin's exhibits are checked only once no filter has mistakes, since its code expects filters.
    """
    if not points:
        return
    is_complete = all(None not in point.filters.values() for point in points)
    for name, exhibit in exhibits.items():
        if is_foreign(exhibit) and not is_complete:
            continue
        add_conflicts(source, (group, name), exhibit_conflicts(exhibit, points))


def check_figures(
    source: Source, settings: Settings, figures: dict[str, DrawnExhibit], points: list[Point]
) -> None:
    """Check that figures ask for no run and no component beyond the last.

    ``figures`` are by name. Their keys ``run`` and ``component`` count from 1. A class of figures names
    those of its keys that count in ``numbers``.
    """
    limits = {"run": settings.runs}
    # A component must exist at every point of the grid. Without points, as after a mistake in the
    # scenario, the number of components is unknown.
    if points:
        limits["component"] = min(len(point.scenario.components) for point in points)
    for name, figure in figures.items():
        for key in figure.numbers:
            number = getattr(figure, key)
            most = limits.get(key)
            if most is not None and number > most:
                verb = "are" if most > 1 else "is"
                message = f"{number} is more than the {most} there {verb}"
                source.add_problem(("figures", name, key), message)


def exhibit_conflicts(exhibit: Exhibit, points: Sequence[Point]) -> dict[str, str]:
    """Collect the conflicts of a table or figure; for plugins also what would stop the runner.

    They are by key of the exhibit. The empty key stands for the exhibit as a whole.
    """
    if not is_foreign(exhibit):
        return exhibit.conflicts(points)
    try:
        with plugin_code(exhibit):
            conflicts: dict[str, str] = call_hook(exhibit.conflicts, dict, points)
            check_words(*conflicts, *conflicts.values())
            if isinstance(exhibit, DrawnExhibit):
                _check_shown(exhibit)
    except PluginError as error:
        return {"": str(error)}
    return conflicts


def _check_shown(exhibit: DrawnExhibit) -> None:
    """Raise WrongReturnError unless a figure declares properly which tracks it needs."""
    runs = exhibit.shown_runs
    components = exhibit.shown_components
    # These are read only so that an error in them is reported here.
    _ = exhibit.shown_covariances
    _ = exhibit.shown_measurements
    if not isinstance(runs, int):
        raise WrongReturnError("shown_runs", f"shown_runs is {runs!r}, no whole number")
    if components is not None and not isinstance(components, tuple):
        message = f"shown_components is {components!r}, neither a tuple of numbers nor None"
        raise WrongReturnError("shown_components", message)


def missing_paths(points: Sequence[Point], **paths: str | None) -> dict[str, str]:
    """Return the mistakes of keys that name no path of the grid, by key; empty if there are none.

    ``paths`` are the keys with their values; None stands for a key that is not set.
    """
    grid = list(points[0].values)
    problems = {}
    for key, path in paths.items():
        if path is None or path in grid:
            continue
        if grid:
            problems[key] = f"{path!r} is no path of the grid; {unknown(path, grid)}"
        else:
            problems[key] = "there is no grid"
    return problems


def missing_steps(key: str, measures: Iterable[Measure], points: Sequence[Point]) -> dict[str, str]:
    """Return the mistake of the config's ``key`` if one of its measures is at a step outside the run.

    The mapping has the message under this key. It is empty without a mistake. Runs may have other steps
    at each of the grid's ``points``.
    """
    for m in measures:
        for point in points:
            steps = point.scenario.steps
            if m.step is not None and m.step not in steps:
                return {key: f"{m}: the steps are {steps[0]} to {steps[-1]}"}
    return {}


def check_named_filters(
    source: Source, settings: Settings, group: Group, exhibits: dict[str, Exhibit]
) -> None:
    """Check that tables and figures name existing filters only.

    Labels stand under the key `filters`, under the keys in ``label_keys``, and in measures such as
    ``ratio(rmse, PF)``. The filter of a measure ``controlled(...)`` must be an exact one, whose errors
    serve as control variate. A figure or table of tuning must show a filter that is tuned.
    """
    known_labels = [*settings.filters, settings.bound]
    known_labels += [exact_label(label) for label in settings.exact]
    first_tuned = next(iter(settings.tune), "")
    for name, exhibit in exhibits.items():
        named_labels: list[tuple[Keys, str]] = []
        # Step 1: labels under `filters` and under the declared keys.
        for key in ("filters", *exhibit.label_keys):
            for where, leaf in _walk_leaves(getattr(exhibit, key), (group, name, key)):
                if isinstance(leaf, str):
                    named_labels.append((where, leaf))
        # Step 2: labels in measures that compare with another filter.
        for key, value in field_values(exhibit).items():
            for where, leaf in _walk_leaves(value, (group, name, key)):
                if not isinstance(leaf, Measure) or not leaf.other:
                    continue
                named_labels.append((where, leaf.other))
                message = why_not_controlled(leaf, settings.exact)
                if message:
                    source.add_problem(where, message)
        # Step 3: the filter whose tuning is shown.
        shown_filter = getattr(exhibit, "filter", first_tuned)
        if exhibit.kind == "tuning" and shown_filter not in settings.tune:
            message = f"{shown_filter!r} is not tuned" if shown_filter else "no filter is tuned"
            source.add_problem((group, name), f"{message}; name its keys under `tune`")
        for where, label in named_labels:
            if label not in known_labels:
                add_label_problem(source, settings, where, label)


def _walk_leaves(value: object, where: Keys) -> Iterator[tuple[Keys, object]]:
    """Yield every label and measure in the ``value`` of a key, each with the keys that lead to it.

    ``where`` are the keys that lead to the value.
    """
    inner: dict[str | int, object] = {}
    if isinstance(value, dict):
        inner = value
    elif isinstance(value, tuple) and not isinstance(value, Measure):  # a Measure is a tuple, too
        inner = dict(enumerate(value))
    elif isinstance(value, Labeled):
        inner = {key: getattr(value, key) for key in value.label_keys}
    else:
        yield where, value
    for key, part in inner.items():
        yield from _walk_leaves(part, (*where, key))
