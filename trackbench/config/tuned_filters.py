"""Tuned filters in a config: each beside its original, with the values that tuning found or tries."""

import copy
from collections.abc import Mapping
from dataclasses import dataclass

from trackbench.component_parts import Part
from trackbench.config.added_tables_and_figures import add_tuning_exhibit, figure_name
from trackbench.config.build_components import build_kind
from trackbench.config.chosen_filters import add_tuned_to_only
from trackbench.config.experiment import Point
from trackbench.config.filter_copies import is_entry, put_after_originals
from trackbench.config.filter_model import check_assumed, copy_model, drop_true_keys, read_assumed
from trackbench.config.filter_requirements import check_fit, check_late
from trackbench.config.overrides import MissingItemError, override, split_path
from trackbench.config.tuning import tuned_label
from trackbench.errors import Problem, UserError
from trackbench.filters.base import AnyFilter
from trackbench.models.assume import Assume
from trackbench.registry import of_kind
from trackbench.yaml_source import Source, put

Chosen = Mapping[str, object]
"""Values of a filter's keys by their path within its entry: ``{assume.motion.q: 0.3}``."""


def add_tuned(source: Source, tuned_values: Mapping[str, Chosen]) -> None:
    """Add a tuned copy beside each tuned filter, with the values that tuning found or its own.

    An existing entry, as in the config of a results folder, stays unless tuning found values. A table
    and a figure per filter show what tuning did.
    """
    tune = source.data.get("tune")
    if not isinstance(tune, dict):
        return
    labels = [label for label in tune if is_entry(source, label)]
    if not labels:
        return
    # Step 1: an entry per tuned filter, with the values found.
    for label in labels:
        _check_tuned_label(source, label)
        if label in tuned_values or not is_entry(source, tuned_label(label)):
            filters = source.data["filters"]
            entry = copy.deepcopy(filters[label])
            mark = source.mark(("filters", label))
            put(filters, tuned_label(label), entry, mark, source.key_mark(("filters", label)))
        # Before tuning there are no values, and the copy keeps those of its original.
        values = tuned_values.get(label, {})
        _set_values(source, tuned_label(label), original_label=label, values=values)
    # Step 2: each after its original; tables and figures of those that are run.
    put_after_originals(source, {label: tuned_label(label) for label in labels})
    add_tuned_to_only(source, labels)  # if the key `only` lists the originals
    add_tuning_exhibit(source, "tables", "tuning", {"kind": "tuning"})
    for label in labels:
        if _is_tuned_run(source, label):
            name = figure_name(label)
            add_tuning_exhibit(source, "figures", name, {"kind": "tuning", "filter": label})


def _check_tuned_label(source: Source, label: str) -> None:
    """Reject an entry under the tuned filter's label that is another filter.

    The two entries may differ in the tuned keys only.
    """
    keys = source.value_at(("tune", label))
    if not isinstance(keys, dict) or not is_entry(source, tuned_label(label)):
        return
    entries = []
    for filter_label in (label, tuned_label(label)):
        # The entry with null for every tuned key.
        without_values = with_values(source, filter_label, dict.fromkeys(keys))
        entry = without_values.value_at(("filters", filter_label))
        # Keys of true measurements, such as `detection` and `bias`, which no filter models. A copy of
        # the true sensor lacks them, and a config of results has them at their defaults: compare
        # without.
        if isinstance(entry.get("assume"), dict):
            drop_true_keys(entry["assume"].get("sensor"))
        entries.append(entry)
    original, tuned = entries
    if original != tuned:
        message = f"tuning gives this label to the tuned {label}: give this filter another label"
        source.add_key_problem(("filters", tuned_label(label)), message)


def with_values(source: Source, label: str, values: Chosen) -> Source:
    """Return a config in which the filter ``label`` has these values of its tuned keys.

    Parts other than the filter's entry are shared with ``source``.
    """
    keys = ("filters", label)
    changed = source.replaced(keys, copy.deepcopy(source.value_at(keys)))
    _set_values(changed, label, original_label=label, values=values)
    return changed


def _set_values(source: Source, label: str, original_label: str, values: Chosen) -> None:
    """Set the values of keys in the entry of the filter ``label``.

    The filter is the one that is tuned, or its tuned copy. Mistakes in the values are reported where the
    config has the keys: under ``tune``, by ``original_label``.
    """
    for path, value in values.items():
        mark = source.mark(("tune", original_label, path))
        # The key may be one of the scenario's model, or of a default component. The filter first gets
        # its own copy of this component: other filters keep theirs, and `split_path` finds lists in it.
        copy_model(source, label, path)
        _write_default_kind(source, label, path)
        try:
            keys = split_path(source, f"filters.{label}.{path}")
        except MissingItemError as error:
            # A key of a list is that of one of its items, which the path names by number.
            place = ("tune", original_label, path)
            message = "part of the path is a list: name one of its items by number, from 0"
            if error.is_number:
                has = f"it has {error.length}, numbered from 0"
                message = f"the list has no item {error.key}: {has}"
            if path.startswith("assume.sensor."):
                message += f", as assume.sensor.0.{path.rpartition('.')[2]}"
            raise UserError(source.problem(place, message)) from None
        override(source, keys, value, mark)


def _write_default_kind(source: Source, label: str, path: str) -> None:
    """Write the default component into a filter's entry before a key within the component is set.

    ``path`` is that of the tuned key in the entry. For ``filter.gate``, an entry without ``filter`` gets
    the kind of the class's default.
    """
    name, _, inner_path = path.partition(".")
    place = ("filters", label, name)
    kind = source.value_at(("filters", label)).get("kind")
    cls = of_kind("filters", kind) if isinstance(kind, str) else None
    if not inner_path or cls is None or source.has(place):
        return
    default = getattr(cls, name, None)
    if isinstance(default, Part):
        override(source, place, {"kind": default.kind}, source.mark(("filters", label)))


def _is_tuned_run(source: Source, label: str) -> bool:
    """Test whether the tuned copy of the filter ``label`` is run: `only` lists it or is not given."""
    only = source.data.get("only")
    if not isinstance(only, list) or not only:
        return True
    return tuned_label(label) in only


@dataclass(frozen=True)
class Trial:
    """A filter with the values of a trial, and its filter model."""

    filter: AnyFilter
    assume: Assume | None


def make_trial(source: Source, point: Point, label: str, values: Chosen) -> Trial | list[Problem]:
    """Build the filter ``label`` and its filter model with these values of tuned keys.

    Both are checked as those of the config are. Return the mistakes if there are any. ``point`` has the
    scenario.
    """
    changed = with_values(source, label, values)
    tracker = build_kind("filters", changed, ("filters", label))
    assume = read_assumed(changed, label)
    if tracker is not None and not changed.problems:
        trial_point = Point(
            values=point.values,
            scenario=point.scenario,
            filters={label: tracker},
            assumed={} if assume is None else {label: assume},
        )
        scenario = check_assumed(changed, trial_point, label)
        if scenario is not None:
            check_fit(changed, ("filters", label), tracker, scenario)
            check_late(changed, ("filters", label), tracker, scenario)
    if changed.problems:
        return changed.problems
    return Trial(filter=tracker, assume=assume)
