"""Keys that have no effect: those of filters, and settings that need another key."""

from dataclasses import fields, is_dataclass
from typing import cast

from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.filters.base import AnyFilter
from trackbench.plugins.checked_hook_calls import call_hook
from trackbench.yaml_source import Keys, Source, dotted


def check_idle(source: Source, points: list[Point]) -> None:
    """Reject keys of filters that are set in the config and have no effect at any point.

    A key with the value of its default or of a preset is no mistake. Filters with other mistakes are
    left out: their methods may rely on what is mistaken.
    """
    if not points:
        return
    # With a point at the end a path begins only with whole keys: `filters.KF.` is no `filters.KF2.`.
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


def check_idle_settings(source: Source, settings: Settings, points: list[Point]) -> None:
    """Reject settings that have no effect, mostly as they need another key that is not set."""
    # The first step is that of the prior, and has no measurement.
    steps = max((len(point.scenario.steps) - 1 for point in points), default=0)
    # With `hold_out: n` every n-th measurement is held out, and there is no n-th one in a shorter run.
    if points and settings.hold_out is not None and settings.hold_out > steps:
        message = f"holds out none of {steps} measurements: give a number from 2 to {max(steps, 2)}"
        source.add_problem(("hold_out",), message)
    # An attribute of the class `Settings` is the default of the key.
    if settings.min_runs != Settings.min_runs and "until" not in source.data:
        source.add_key_problem(("min_runs",), "has no effect without `until`; leave it out")
    if settings.tuning != Settings.tuning and "tune" not in source.data:
        source.add_key_problem(("tuning",), "has no effect without `tune`; leave it out")


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
