"""Keys of every filter's entry: the filter model, and the treatment of late measurements."""

from dataclasses import replace

from trackbench.config.build_components import ENTRY_KEYS, build
from trackbench.config.experiment import (
    Point,
)
from trackbench.field_types import InvalidKeyError
from trackbench.filters.base import AnyFilter
from trackbench.models.assume import Assume
from trackbench.plugins.plugin_errors import PluginError, plugin_code
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Keys, Source, dotted

_KEYS_WITH_TRUE_MODEL = {"faults", "delay", "late"}
"""Keys of ``assume`` that leave the true model, so that the reference filter may have them."""


def read_assumed(source: Source, label: str) -> Assume | None:
    """Read the filter model of a filter's entry, from `assume` and `late`; None without these keys."""
    entry = source.data["filters"][label]
    if not isinstance(entry, dict):
        return None
    entry_place = ("filters", label)
    # Step 1: the filter model under `assume`.
    assume = None
    if entry.get("assume") is not None:
        keys = (*entry_place, "assume")
        is_mapping = isinstance(entry["assume"], dict)
        is_true_model = is_mapping and set(entry["assume"]) <= _KEYS_WITH_TRUE_MODEL
        if label == source.data.get("reference") and not is_true_model:
            message = "the reference filter uses the true model; leave this key out"
            source.add_key_problem(keys, message)
        if not is_mapping:
            source.add_problem(keys, "is not a mapping")
            return None
        assume = build(Assume, source, keys)
    # Step 2: the treatment of late measurements, if it stands beside `assume`.
    if entry.get("late") is None:
        return assume
    with_late = build(Assume, source, entry_place, {"late": entry["late"]})
    if with_late is None or assume is None:
        return with_late
    # `assume` itself has a treatment of late measurements, or (`delay: none`) none arrives late.
    if assume.delay or assume.late:
        source.add_key_problem(
            (*entry_place, "late"), "has no effect beside `assume`; leave one out"
        )
        return assume
    return replace(assume, late=with_late.late)


def check_late(source: Source, keys: Keys, tracker: AnyFilter, scenario: Scenario) -> None:
    """Check that a filter has a treatment of late measurements, and that it can apply it.

    ``keys`` lead to the filter's entry, where mistakes are reported.
    """
    # With mistakes in these keys, the scenario's treatment is unknown.
    entry_paths = tuple(dotted((*keys, key)) for key in ENTRY_KEYS)
    if any(problem.path.startswith(entry_paths) for problem in source.problems):
        return
    try:
        late = scenario.late
    except InvalidKeyError as error:
        message = str(error)
        is_added = not source.mark(keys).line
        if is_added:  # the entry of a filter of --filter stands in no file
            message += f"; write --set {dotted(keys)}.late=drop"
        source.add_problem(keys, message)
        return
    # None: all measurements arrive on time.
    if late is not None and late.kind == "refilter" and tracker.smooths:
        message = "a smoother goes back through all states at the end; take `drop` or `apply`"
        source.add_problem((*keys, "late"), f"{message}, or a filter without `smooth`")


def check_idle_late(source: Source, points: list[Point]) -> None:
    """Reject the keys `delay` and `late` of filter models if all measurements arrive on time."""
    if not points or any(point.scenario.longest_delay for point in points):
        return
    # Step 1: the places of these keys, in each filter's entry and in each filter model.
    entries: list[Keys] = [("filters", label) for label in points[0].filters]
    places = [(*entry, "late") for entry in entries]
    for owner in [("scenario",), *entries]:
        places.append((*owner, "assume", "delay"))
        places.append((*owner, "assume", "late"))
    # Step 2: keys that are set there.
    for keys in places:
        if source.is_set(keys):
            message = "has no effect: all measurements arrive on time; add a `delay` to a sensor"
            source.add_key_problem(keys, message)


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
