"""Checks between the components of an experiment; every mistake is added to ``problems``."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from itertools import repeat
from typing import cast

from trackbench.config.experiment import (
    DrawnExhibit,
    Exhibit,
    Labeled,
    Point,
    Settings,
    labels_to_run,
)
from trackbench.config.mistakes import unknown
from trackbench.config.plugin_checks import exhibit_conflicts
from trackbench.errors import Problem
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.exact_errors import why_not_exact
from trackbench.evaluation.metric_expression import Measure, exact_label
from trackbench.evaluation.summary import is_exact
from trackbench.extension_points import field_values, is_foreign, walk_parts
from trackbench.field_types import InvalidKeyError
from trackbench.filters.base import AnyFilter, Filter
from trackbench.models.base import has_density, position_velocity_names
from trackbench.models.sensors.base import ScaledNoise, SensorBase
from trackbench.plugins.checks import call_hook, filter_conflicts
from trackbench.plugins.errors import PluginError, plugin_code
from trackbench.registry import Group, kinds
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Keys, Source, dotted

QUICK = "--quick"
"""Option whose number of runs may be more than there are recordings."""
_NEEDS = {
    "state.planar": "a target in the plane",
    "motion.jacobian": "a motion with a Jacobian",
    "motion.alike_axes": "a motion of constant velocity, alike along x and y (cv, cwna; of any other "
    "motion try rpf or gpf), and steps of equal length",
    "motion.F": "a linear motion and steps of equal length",
    "motion.F|linear": "a linear motion",
    "motion.Q": "a linear motion",
    "motion.T": "steps of equal length",
    "motion.T|intervals": "a motion with a sampling time",
    **dict.fromkeys(["sensor.H", "sensor.H|linear"], "a linear sensor"),
    "sensor.jacobian": "a sensor with a Jacobian",
    "sensor.per_axis": "a sensor of planar positions, as it works axis by axis (try imm, or cmkf)",
    "sensor.reading": "a sensor of range and azimuth",
    **dict.fromkeys(
        ["prior.first", "prior.gaussian", "prior.positions", "prior.azimuths"],
        "a start from two scans of a radar at the origin",
    ),
}
"""What a filter needs, in words (other needs are named as they are)."""


def chosen_labels(source: Source, settings: Settings) -> list[str]:
    """Choose the labels of the filters to run; labels named at the top level must exist."""
    known = list(settings.filters)
    if not known:
        source.add_problem(("filters",), "name at least one filter")
    for i, label in enumerate(settings.only):
        if label not in known:
            add_label_problem(source, settings, ("only", i), label)
    if settings.bound in known:
        source.add_problem(("bound",), f"{settings.bound!r} is already the label of a filter")
    for i, label in enumerate(settings.smoothed):
        if label not in known:
            add_label_problem(source, settings, ("smoothed", i), label)
    for i, label in enumerate(settings.exact):
        if label not in known:
            add_label_problem(source, settings, ("exact", i), label)
        if exact_label(label) in (*known, settings.bound):
            source.add_problem(("exact", i), f"{exact_label(label)!r} is already a label")
    if settings.reference is not None and settings.reference not in known:
        add_label_problem(source, settings, ("reference",), settings.reference)
    return labels_to_run(known, settings.only, settings.reference)


def has(scenario: Scenario, need: str) -> bool:
    """Test whether a scenario has what a filter needs: ``prior.first``, ``motion.T|F``."""
    part, _, name = need.partition(".")
    if part == "state":
        return scenario.components == position_velocity_names(2)
    if part == "prior":
        kind = scenario.prior_type
        return hasattr(kind, name) or name in getattr(kind, "__dataclass_fields__", ())
    return any(hasattr(getattr(scenario.model, part), either) for either in name.split("|"))


def check_fit(source: Source, keys: Keys, tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that the scenario meets a filter's requirements and conflicts."""
    unmet = False
    for need in tracker.all_requirements:
        if not has(scenario, need):
            limit = f"`{tracker.kind}` works only with {_NEEDS.get(need, need)}"
            what = f"{limit}; {_remedy(scenario, need)}"
            if need.startswith("sensor.") and isinstance(scenario.model.sensor, ScaledNoise):
                what = f"`{tracker.kind}` cannot know a fault that multiplies noise"
                what += "; leave out `assume: {faults: known}`, or take ekf or ukf"
            source.problems.append(Problem(source.mark((*keys, "kind")), dotted(keys), what))
            unmet = True
    sensor = scenario.model.sensor
    why = sensor.why_no_moments() if has_density(sensor) else ""
    if why and not tracker.density_only:
        what = f"`{tracker.kind}` uses mean and covariance of a measurement: {why}"
        what += "; take a particle filter (pf, rpf, apf) or `grid`"
        source.problems.append(Problem(source.mark((*keys, "kind")), dotted(keys), what))
    # A filter's own checks may use what it requires of the scenario.
    if not unmet:
        _add_conflicts(source, keys, filter_conflicts(tracker, scenario))


def _remedy(scenario: Scenario, need: str) -> str:
    """Explain what to do about a requirement that a scenario does not meet."""
    component = need.partition(".")[0]
    if component == "sensor":
        parts = walk_parts(scenario.true_sensor)
        sensors = " and ".join(f"`{part.kind}`" for part in parts if isinstance(part, SensorBase))
        return f"this scenario has {sensors}: take another filter or sensor"
    if need == "motion.T":
        return "take another filter, or resample recorded data (`resample: SECONDS`)"
    key = {"state": "target", "prior": "start"}.get(component, component)
    return f"take another filter or {key}"


def check_assumed(source: Source, point: Point, label: str) -> Scenario | None:
    """Check the scenario as this filter models it; None, with a problem added, if impossible."""
    keys = ("filters", label, "assume")
    try:
        with plugin_code(point.assumed.get(label)):
            try:
                scenario = point.assumed_scenario(label)
                _ = scenario.model, scenario.prior_type
            except InvalidKeyError as error:
                owner = keys[:2] if label in point.assumed else ("scenario",)
                source.add_problem((*owner, *error.path), str(error))
                return None
    except (ValueError, PluginError) as error:
        source.add_problem(keys, str(error))
        return None
    return scenario


def check_idle(source: Source, points: list[Point]) -> None:
    """Reject a set key that changes nothing at any point, unless default or preset set it.

    Filters with other mistakes are left out: their methods may rely on what is mistaken.
    """
    mistaken = [f"{problem.path}." for problem in source.problems]
    for label in points[0].filters if points else ():
        entries = "scenario.", f"{dotted(('filters', label))}."
        if any(path.startswith(entries) for path in mistaken):
            continue
        trackers = [point.filters[label] for point in points]
        every = [
            call_hook(tracker.idle_keys, dict, point.assumed_scenario(label))
            for tracker, point in zip(trackers, points, strict=True)
        ]
        for key, why in every[0].items():
            path = key.split(".")
            keys = ("filters", label, *path)
            is_set = source.has(keys) and source.at(keys) is not None
            if not is_set or not all(key in idle for idle in every):
                continue
            if not all(map(_is_usual, trackers, repeat(path))):
                source.add_problem(keys, f"has no effect {why}; leave it out")


def _is_usual(tracker: AnyFilter, path: list[str]) -> bool:
    """Test whether a key has its default, or what a preset gives it."""
    # Step down the path, in the filter and in each of its presets.
    part: object = tracker
    usual = list(tracker.presets.values())
    for name in path[:-1]:
        part = getattr(part, name, None)
        usual = [cast(dict[str, object], preset.get(name, {})) for preset in usual]
    if not is_dataclass(part):  # `assume` is no key of the class
        return False
    defaults = [key.default for key in fields(part) if key.name == path[-1]]
    return getattr(part, path[-1]) in (*defaults, *(preset.get(path[-1]) for preset in usual))


def check_bound(source: Source, scenario: Scenario) -> None:
    """Check that a requested lower bound exists."""
    if source.data.get("bound") is not None and (why := scenario.why_no_bound) is not None:
        what = f"scenario {scenario.kind} has no lower bounds" + (f": {why}" if why else "")
        source.add_problem(("bound",), what)


def check_exact(source: Source, settings: Settings, point: Point) -> None:
    """Check that the filters whose exact errors are requested are linear, and so is the scenario."""
    for i, label in enumerate(settings.exact):
        if label not in point.filters:
            continue  # `only` leaves it out
        tracker, assume = point.filters[label], point.assumed.get(label)
        with plugin_code(tracker, point.scenario, assume):
            why = why_not_exact(BlockTask(point.scenario, tracker, 0, 0, 1, 1, assume=assume))
        if why is not None:
            source.add_problem(("exact", i), f"{label} has no exact errors: {why}")


def _add_conflicts(source: Source, keys: Keys, conflicts: dict[str, str]) -> None:
    """Add the problems that a component reports by key; an empty key means the component."""
    for key, what in conflicts.items():
        source.add_problem((*keys, *key.split(".")) if key else keys, what)


def check_idle_settings(source: Source, settings: Settings, points: list[Point]) -> None:
    """Reject settings without an effect: by a key that is unset, or as nothing is held out."""
    steps = max((len(point.scenario.steps) - 1 for point in points), default=0)
    if points and settings.hold_out is not None and settings.hold_out > steps:
        what = f"holds out none of {steps} measurements: give a number from 2 to {max(steps, 2)}"
        source.add_problem(("hold_out",), what)
    if settings.min_runs != Settings.min_runs and "until" not in source.data:
        source.add_key_problem(("min_runs",), "has no effect without `until`; leave it out")
    if settings.tuning != Settings.tuning and "tune" not in source.data:
        source.add_key_problem(("tuning",), "has no effect without `tune`; leave it out")
    has_program = any(map(_is_program, settings.filters.values()))
    for key in ("files", "environment"):
        if getattr(settings, key) and not (settings.plugins or has_program):
            what = "is what plugins and programs read, and there are no `plugins`; leave it out"
            source.add_key_problem((key,), what)


def _is_program(entry: object) -> bool:
    """Test whether a filter's entry names a kind that runs a program."""
    kind = entry.get("kind") if isinstance(entry, dict) else None
    cls = kinds("filters").get(kind) if isinstance(kind, str) else None
    return cls is not None and issubclass(cls, Filter) and cls.runs_program


def check_problem(source: Source, settings: Settings) -> None:
    """Check that a standard problem's reference is a filter or the bound."""
    label = settings.problem.reference if settings.problem else None
    if label not in (None, *settings.filters, settings.bound):
        add_label_problem(source, settings, ("problem", "reference"), str(label))


def check_key_figure(source: Source, settings: Settings) -> None:
    """Check that the report's key figure is one of the experiment's."""
    name = settings.key_figure
    if name is not None and name not in settings.figures:
        figures = [*settings.figures]
        hint = unknown(name, figures) if figures else "there are none: leave this key out"
        source.add_problem(("key_figure",), f"{name!r} is not a figure here; {hint}")


def check_named_filters(
    source: Source, settings: Settings, group: Group, parts: dict[str, Exhibit]
) -> None:
    """Check that tables and figures name existing filters only.

    They do under ``filters``, under what they declare as ``label_keys``, and in measures that compare.
    """
    for name, part in parts.items():
        named: list[tuple[Keys, str]] = []
        for key in ("filters", *part.label_keys):
            leaves = _leaves(getattr(part, key), (group, name, key))
            named += [(where, leaf) for where, leaf in leaves if isinstance(leaf, str)]
        for key, value in field_values(part).items():
            for where, leaf in _leaves(value, (group, name, key)):
                if isinstance(leaf, Measure) and leaf.other:
                    named.append((where, leaf.other))
                    known = leaf.other in settings.exact and is_exact(leaf)
                    if leaf.relation == "controlled" and not known:
                        what = f"'{leaf}' needs a filter of `exact` and a mean of squares"
                        source.add_problem(where, f"{what}, such as rms(rmse) or anees")
        shown = getattr(part, "filter", next(iter(settings.tune), ""))
        if part.kind == "tuning" and shown not in settings.tune:
            what = f"{shown!r} is not tuned" if shown else "no filter is tuned"
            source.add_problem((group, name), f"{what}; name its keys under `tune`")
        for where, label in named:
            if label not in (*settings.filters, settings.bound, *map(exact_label, settings.exact)):
                add_label_problem(source, settings, where, label)


def _leaves(value: object, where: Keys) -> Iterator[tuple[Keys, object]]:
    """Yield every label and measure in what a key holds, and where it stands."""
    inner: dict[str | int, object] = {}
    if isinstance(value, dict):
        inner = value
    elif isinstance(value, tuple) and not isinstance(value, Measure):
        inner = dict(enumerate(value))
    elif isinstance(value, Labeled):
        inner = {key: getattr(value, key) for key in value.label_keys}
    else:
        yield where, value
    for key, part in inner.items():
        yield from _leaves(part, (*where, key))


def add_label_problem(source: Source, settings: Settings, where: Keys, label: str) -> None:
    """Add the problem of a label that no filter has."""
    hint = unknown(label, list(settings.filters))
    parts = [part.strip() for part in label.split(",")]
    if len(parts) > 1 and all(part in settings.filters for part in parts):
        hint = "write several as a list, [A, B], or as several options: --only A --only B"
    source.add_problem(where, f"{label!r} is not a filter here; {hint}")


def check_drawable(
    source: Source, group: Group, parts: dict[str, Exhibit], points: list[Point]
) -> None:
    """Add the conflicts of tables and figures with these points.

    Those of a plugin wait until all filters are without mistakes, since its code expects filters.
    """
    is_complete = all(None not in point.filters.values() for point in points)
    for name, part in parts.items() if points else ():
        if is_foreign(part) and not is_complete:
            continue
        _add_conflicts(source, (group, name), exhibit_conflicts(part, points))


def check_figures(
    source: Source, settings: Settings, figures: dict[str, DrawnExhibit], points: list[Point]
) -> None:
    """Check that figures show existing runs and components only."""
    sizes = [len(p.scenario.components) for p in points]
    limits = {"run": settings.runs, "component": min(sizes, default=1)}
    for name, figure in figures.items():
        for key in figure.numbers:
            number, most = getattr(figure, key), limits[key]
            if number > most:
                what = f"{number} is more than the {most} there {'are' if most > 1 else 'is'}"
                source.add_problem(("figures", name, key), what)


def with_recorded_runs(source: Source, settings: Settings, points: list[Point]) -> Settings:
    """Choose the number of runs: all recorded ones unless the config asks for fewer."""
    counts = [p.scenario.recorded_runs for p in points]
    most = min((count for count in counts if count is not None), default=None)
    if most is None:
        return settings
    if "runs" in source.data and settings.runs <= most:
        most = settings.runs
    elif "runs" in source.data and source.mark(("runs",)).file != QUICK:
        source.add_problem(("runs",), f"{settings.runs} is more than the {most} recorded runs")
    # There will never be more: a wider block would filter runs that are not there.
    block = settings.block or (None if settings.until else "fit")
    return replace(settings, runs=most, block=block)
