"""Checks between the components of an experiment; every mistake is added to ``problems``."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
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
from trackbench.config.requested_metrics import why_not_controlled
from trackbench.errors import Problem
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.exact_errors import why_not_exact
from trackbench.evaluation.metric_expression import Measure, exact_label
from trackbench.extension_points import field_values, is_foreign, walk_parts
from trackbench.field_types import InvalidKeyError
from trackbench.filters.base import AnyFilter, Filter
from trackbench.models.components import position_velocity_names
from trackbench.models.likelihood import has_own_density
from trackbench.models.sensors.base import ScaledNoise, SensorBase
from trackbench.plugins.checks import call_hook, filter_conflicts
from trackbench.plugins.errors import PluginError, plugin_code
from trackbench.registry import Group, kinds
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Keys, Source, dotted

QUICK = "--quick"
"""Option whose number of runs may be more than there are recordings."""
_REQUIREMENTS = {
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
"""Requirements of filters in words; a message names others as they are."""


def chosen_labels(source: Source, settings: Settings) -> list[str]:
    """Return the labels of the filters to run.

    A label in `only`, `smoothed`, `exact` or `reference` that no filter has is a mistake, which is added
    to the source, and so is a bound or an exact error under the label of a filter.
    """
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


def meets_requirement(scenario: Scenario, requirement: str) -> bool:
    """Test whether a scenario has what a filter requires.

    ``requirement`` names a component and its attribute, as ``prior.first`` or ``motion.T``. Of
    ``motion.T|F`` one of the two attributes is enough.
    """
    component, _, name = requirement.partition(".")
    if component == "state":  # `state.planar`
        return scenario.components == position_velocity_names(2)
    if component == "prior":
        prior_type = scenario.prior_type
        # A field of a dataclass without a default is no attribute of the class.
        return hasattr(prior_type, name) or name in getattr(prior_type, "__dataclass_fields__", ())
    model_component = getattr(scenario.model, component)
    return any(hasattr(model_component, attribute) for attribute in name.split("|"))


def check_fit(source: Source, keys: Keys, tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that the scenario meets a filter's requirements and has no conflict with the filter.

    ``keys`` lead to the filter's entry, where the mistakes are reported.
    """
    sensor = scenario.model.sensor
    kind_mark = source.mark((*keys, "kind"))
    # Step 1: what the filter requires of the scenario.
    meets_all = True
    for requirement in tracker.all_requirements:
        if meets_requirement(scenario, requirement):
            continue
        meets_all = False
        if requirement.startswith("sensor.") and isinstance(sensor, ScaledNoise):
            message = f"`{tracker.kind}` cannot know a fault that multiplies noise"
            message += "; leave out `assume: {faults: known}`, or take ekf or ukf"
        else:
            needed = _REQUIREMENTS.get(requirement, requirement)
            message = f"`{tracker.kind}` works only with {needed}; {_remedy(scenario, requirement)}"
        source.problems.append(Problem(kind_mark, dotted(keys), message))
    # Step 2: measurements without mean and covariance.
    why = sensor.why_no_moments() if has_own_density(sensor) else ""
    if why and not tracker.density_only:
        message = f"`{tracker.kind}` uses mean and covariance of a measurement: {why}"
        message += "; take a particle filter (pf, rpf, apf) or `grid`"
        source.problems.append(Problem(kind_mark, dotted(keys), message))
    # Step 3: the filter's own checks, which may use what it requires of the scenario.
    if meets_all:
        _add_conflicts(source, keys, filter_conflicts(tracker, scenario))


def _remedy(scenario: Scenario, requirement: str) -> str:
    """Explain what to do about a requirement that a scenario does not meet."""
    component = requirement.partition(".")[0]
    if component == "sensor":
        parts = walk_parts(scenario.true_sensor)
        sensors = " and ".join(f"`{part.kind}`" for part in parts if isinstance(part, SensorBase))
        return f"this scenario has {sensors}: take another filter or sensor"
    if requirement == "motion.T":
        return "take another filter, or resample recorded data (`resample: SECONDS`)"
    key = {"state": "target", "prior": "start"}.get(component, component)
    return f"take another filter or {key}"


def check_assumed(source: Source, point: Point, label: str) -> Scenario | None:
    """Return the scenario as the filter ``label`` models it; None if there is none.

    The reason is then added to the source.
    """
    keys = ("filters", label, "assume")
    try:
        with plugin_code(point.assumed.get(label)):
            try:
                scenario = point.assumed_scenario(label)
                # Both are computed at their first use, which may raise.
                _ = scenario.model
                _ = scenario.prior_type
            except InvalidKeyError as error:
                # The key stands in the filter's entry, or, if it has no model, in the scenario.
                owner = keys[:2] if label in point.assumed else ("scenario",)
                source.add_problem((*owner, *error.path), str(error))
                return None
    except (ValueError, PluginError) as error:
        source.add_problem(keys, str(error))
        return None
    return scenario


def check_idle(source: Source, points: list[Point]) -> None:
    """Reject keys of filters that are set in the config and have no effect at any point.

    A key with the value of its default or of a preset is no mistake. Filters with other mistakes are
    left out: their methods may rely on what is mistaken.
    """
    if not points:
        return
    mistaken = [f"{problem.path}." for problem in source.problems]
    for label in points[0].filters:
        entry = f"{dotted(('filters', label))}."
        if any(path.startswith(("scenario.", entry)) for path in mistaken):
            continue
        trackers = [point.filters[label] for point in points]
        # Reasons by key, at each point. A key that is idle everywhere is so at the first point.
        idle_keys = [
            call_hook(tracker.idle_keys, dict, point.assumed_scenario(label))
            for tracker, point in zip(trackers, points, strict=True)
        ]
        for key, why in idle_keys[0].items():
            path = key.split(".")
            keys = ("filters", label, *path)
            is_idle_everywhere = all(key in idle for idle in idle_keys)
            if not source.is_set(keys) or not is_idle_everywhere:
                continue
            if not all(_has_usual_value(tracker, path) for tracker in trackers):
                source.add_problem(keys, f"has no effect {why}; leave it out")


def _has_usual_value(tracker: AnyFilter, path: list[str]) -> bool:
    """Test whether a key has its default, or the value that a preset gives it."""
    # Step 1: follow the path to the key's owner, in the filter and in each of its presets.
    *owners, name = path
    owner: object = tracker
    presets = list(tracker.presets.values())
    for owner_name in owners:
        owner = getattr(owner, owner_name, None)
        presets = [cast(dict[str, object], preset.get(owner_name, {})) for preset in presets]
    if not is_dataclass(owner):  # `assume` is no key of the class
        return False
    # Step 2: compare.
    usual_values: list[object] = [key.default for key in fields(owner) if key.name == name]
    usual_values += [preset.get(name) for preset in presets]
    return getattr(owner, name) in usual_values


def check_bound(source: Source, scenario: Scenario) -> None:
    """Check that a requested lower bound exists."""
    if source.data.get("bound") is None:
        return
    why = scenario.why_no_bound
    if why is not None:
        message = f"scenario {scenario.kind} has no lower bounds"
        if why:
            message += f": {why}"
        source.add_problem(("bound",), message)


def check_exact(source: Source, settings: Settings, point: Point) -> None:
    """Check that the filters whose exact errors are requested are linear, and so is the scenario."""
    for i, label in enumerate(settings.exact):
        if label not in point.filters:
            continue  # `only` leaves it out
        tracker = point.filters[label]
        assume = point.assumed.get(label)
        with plugin_code(tracker, point.scenario, assume):
            # Neither the seed nor the number of runs matters.
            one_run = BlockTask(
                scenario=point.scenario,
                filter=tracker,
                seed=0,
                index=0,
                width=1,
                runs_used=1,
                assume=assume,
            )
            why = why_not_exact(one_run)
        if why is not None:
            source.add_problem(("exact", i), f"{label} has no exact errors: {why}")


def _add_conflicts(source: Source, keys: Keys, conflicts: dict[str, str]) -> None:
    """Add the problems that a component reports by key; an empty key means the component."""
    for key, message in conflicts.items():
        place = (*keys, *key.split(".")) if key else keys
        source.add_problem(place, message)


def check_idle_settings(source: Source, settings: Settings, points: list[Point]) -> None:
    """Reject settings that have no effect, mostly as they need another key that is not set."""
    steps = max((len(point.scenario.steps) - 1 for point in points), default=0)
    if points and settings.hold_out is not None and settings.hold_out > steps:
        message = f"holds out none of {steps} measurements: give a number from 2 to {max(steps, 2)}"
        source.add_problem(("hold_out",), message)
    if settings.min_runs != Settings.min_runs and "until" not in source.data:
        source.add_key_problem(("min_runs",), "has no effect without `until`; leave it out")
    if settings.tuning != Settings.tuning and "tune" not in source.data:
        source.add_key_problem(("tuning",), "has no effect without `tune`; leave it out")
    has_program = any(_runs_program(entry) for entry in settings.filters.values())
    for key in ("files", "environment"):
        if getattr(settings, key) and not (settings.plugins or has_program):
            message = "is what plugins and programs read, and there are no `plugins`; leave it out"
            source.add_key_problem((key,), message)


def _runs_program(entry: object) -> bool:
    """Test whether a filter's entry names a kind that runs a program."""
    if not isinstance(entry, dict):
        return False
    kind = entry.get("kind")
    if not isinstance(kind, str):
        return False
    cls = kinds("filters").get(kind)
    return cls is not None and issubclass(cls, Filter) and cls.runs_program


def check_problem(source: Source, settings: Settings) -> None:
    """Check that a standard problem's reference is a filter or the bound."""
    if settings.problem is None:
        return
    label = settings.problem.reference
    if label is not None and label not in (*settings.filters, settings.bound):
        add_label_problem(source, settings, ("problem", "reference"), label)


def check_key_figure(source: Source, settings: Settings) -> None:
    """Check that the report's key figure is one of the experiment's."""
    name = settings.key_figure
    if name is not None and name not in settings.figures:
        hint = "there are none: leave this key out"
        if settings.figures:
            hint = unknown(name, list(settings.figures))
        source.add_problem(("key_figure",), f"{name!r} is not a figure here; {hint}")


def check_named_filters(
    source: Source, settings: Settings, group: Group, parts: dict[str, Exhibit]
) -> None:
    """Check that tables and figures name existing filters only.

    Labels stand under the key `filters`, under the keys in ``label_keys``, and in measures such as
    ``ratio(rmse, PF)``.
    """
    known_labels = [*settings.filters, settings.bound]
    known_labels += [exact_label(label) for label in settings.exact]
    first_tuned = next(iter(settings.tune), "")
    for name, part in parts.items():
        named_labels: list[tuple[Keys, str]] = []
        # Step 1: labels under `filters` and under the declared keys.
        for key in ("filters", *part.label_keys):
            for where, leaf in _walk_leaves(getattr(part, key), (group, name, key)):
                if isinstance(leaf, str):
                    named_labels.append((where, leaf))
        # Step 2: labels in measures that compare with another filter.
        for key, value in field_values(part).items():
            for where, leaf in _walk_leaves(value, (group, name, key)):
                if not isinstance(leaf, Measure) or not leaf.other:
                    continue
                named_labels.append((where, leaf.other))
                message = why_not_controlled(leaf, settings.exact)
                if message:
                    source.add_problem(where, message)
        # Step 3: the filter whose tuning is shown.
        shown_filter = getattr(part, "filter", first_tuned)
        if part.kind == "tuning" and shown_filter not in settings.tune:
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
    elif isinstance(value, tuple) and not isinstance(value, Measure):
        inner = dict(enumerate(value))
    elif isinstance(value, Labeled):
        inner = {key: getattr(value, key) for key in value.label_keys}
    else:
        yield where, value
    for key, part in inner.items():
        yield from _walk_leaves(part, (*where, key))


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

    A plugin's exhibits are checked only once no filter has mistakes, since its code expects filters.
    """
    if not points:
        return
    is_complete = all(None not in point.filters.values() for point in points)
    for name, part in parts.items():
        if is_foreign(part) and not is_complete:
            continue
        _add_conflicts(source, (group, name), exhibit_conflicts(part, points))


def check_figures(
    source: Source, settings: Settings, figures: dict[str, DrawnExhibit], points: list[Point]
) -> None:
    """Check that figures ask for no run and no component beyond the last."""
    # A component must exist at every point of the grid.
    sizes = [len(p.scenario.components) for p in points]
    limits = {"run": settings.runs, "component": min(sizes, default=1)}
    for name, figure in figures.items():
        for key in figure.numbers:
            number = getattr(figure, key)
            most = limits[key]
            if number > most:
                verb = "are" if most > 1 else "is"
                message = f"{number} is more than the {most} there {verb}"
                source.add_problem(("figures", name, key), message)


def with_recorded_runs(source: Source, settings: Settings, points: list[Point]) -> Settings:
    """Return the settings with the number of runs: all recorded runs unless the config sets fewer.

    Settings of simulated scenarios stay as they are.
    """
    counts = [p.scenario.recorded_runs for p in points]
    recorded_runs = min((count for count in counts if count is not None), default=None)
    if recorded_runs is None:
        return settings
    runs = recorded_runs
    if "runs" in source.data and settings.runs <= recorded_runs:
        runs = settings.runs
    elif "runs" in source.data and source.mark(("runs",)).file != QUICK:  # that of --quick is cut
        message = f"{settings.runs} is more than the {recorded_runs} recorded runs"
        source.add_problem(("runs",), message)
    block = settings.block
    if block is None and not settings.until:
        # There will never be more runs, and a wider block would filter runs that do not exist.
        block = "fit"
    return replace(settings, runs=runs, block=block)
