"""Kinds of one's own, held to what the runner takes for granted, before anything runs.

What is asked here of a class that a plugin registers, and of a filter that a config makes of it, would
else end as a traceback, or in a number.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeGuard, cast

import numpy as np

from trackbench.config.build_dataclass import adapter
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.error_series import per_run_metrics, series
from trackbench.extension_points import Part, foreign_parts, is_foreign, walk_parts
from trackbench.filters.base import AnyFilter, Filter, WrongReturnError
from trackbench.models.sensors.base import SensorBase
from trackbench.plugins.errors import BadPluginError, located_message, location_of
from trackbench.plugins.interrupts import guarded
from trackbench.registry import base_of
from trackbench.scenarios.base import Scenario

_FILES = {"per_step", "per_run", "summary"}
_PLAIN = (bool, int, float, str, type(None))


def check_kind(cls: type[Part]) -> None:
    """Raise BadPluginError for a class that no config could make a part of."""
    for what in _mistakes(cls):
        raise BadPluginError(f"{location_of(WrongReturnError('', ''), cls)}{cls.__name__}: {what}")


def _mistakes(cls: type[Part]) -> Iterator[str]:
    if cls.__hash__ is None:
        yield "is not frozen: @dataclass(frozen=True, kw_only=True)"
    if not isinstance(cls.presets, dict) or not all(
        isinstance(p, dict) for p in cls.presets.values()
    ):
        yield "presets is not a mapping of names to mappings of keys"
    if issubclass(cls, Filter):
        needs: Any = cls.requires
        if not isinstance(needs, tuple) or not all(isinstance(n, str) and "." in n for n in needs):
            yield f"requires is {needs!r}, not a tuple of names such as 'motion.F'"
        if isinstance(cls.summed_diagnostics, str):
            yield "counts is a word, not a set of words"
    if issubclass(cls, (base_of("tables"), base_of("figures"))):
        yield from _mistakes_of_exhibit(cls)
    for field in fields(cast(Any, cls)):
        default = _default(field)
        if field.init and not _is_plain(default):
            yield f"the key {field.name} is a {type(default).__name__}, which no YAML can hold"
    try:
        adapter(cls)
    except Exception as error:
        reason = str(error).split("\n", 1)[0].split(". Set `arb", 1)[0]
        yield f"has a key of a type that no YAML can hold: {reason}"


def _mistakes_of_exhibit(cls: type[Any]) -> Iterator[str]:
    needs = cls.needs
    if not isinstance(needs, dict) or not set(needs.values()) <= _FILES:
        yield f"needs is {needs!r}, not a mapping of metrics to {', '.join(sorted(_FILES))}"
    known = {field.name for field in fields(cls)}
    for name in ("label_keys", "numbers"):
        keys = getattr(cls, name, ())
        if not isinstance(keys, tuple) or not set(keys) <= known:
            yield f"{name} is {keys!r}, not a tuple of keys"


def _default(field: "Field[Any]") -> Any:
    if field.default_factory is not MISSING:
        return field.default_factory()
    return None if field.default is MISSING else field.default


def _is_plain(value: Any) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    if isinstance(value, dict):
        return all(map(_is_plain, (*value, *value.values())))
    return isinstance(value, _PLAIN) or (is_dataclass(value) and not isinstance(value, type))


def conflicts(tracker: AnyFilter, scenario: Scenario) -> dict[str, str]:
    """Return a filter's conflicts with the scenario; for plugins also what would stop the runner."""
    if not is_foreign(tracker):
        return tracker.conflicts(scenario)
    try:
        found: dict[str, str] = asked(tracker.conflicts, dict, scenario)
        sentences = asked(tracker.cautions, list, scenario)
        check_words(*found, *found.values(), *sentences)
        asked(tracker.extra_memory, int, scenario.model)
        for key in ("N", "particle_count", "max_particle_count"):
            number = getattr(tracker, key, 1)
            if not isinstance(number, int) or number < 1:
                raise WrongReturnError(key, f"its {key} is {number!r}, no whole number")
        hash(tracker)
    except Exception as error:
        return {"": located_message(error, tracker)}
    return found


def check_words(*texts: object) -> None:
    """Raise WrongReturnError for what is said in anything but words."""
    if not all(isinstance(text, str) for text in texts):
        raise WrongReturnError("conflicts", "conflicts and cautions are words, and these are not")


def asked(hook: Callable[[Any], Any], kind: type[Any], about: Any) -> Any:
    """Return a hook's value; raises its error, or WrongReturnError for a wrong type."""
    with guarded():
        found = hook(about)
    if not isinstance(found, (list, tuple) if kind is list else kind):
        what = f"{hook.__name__} gives a {type(found).__name__}, not a {kind.__name__}"
        raise WrongReturnError(hook.__name__, what)
    return found


if TYPE_CHECKING:
    from trackbench.scenarios.targets.base import Target


def mistake_of(scenario: Scenario, bounded: bool) -> str | None:
    """Return what would stop the runner in the plugin components of a scenario.

    ``bounded`` if its lower bounds are wanted.
    """
    own = foreign_parts(scenario)
    for part in own:
        try:
            with guarded(), np.errstate(all="ignore"):
                _ask_part(part, scenario)
        except Exception as error:
            return located_message(error, part, *own)
    try:
        with guarded(), np.errstate(all="ignore"):
            if own:
                _ask(scenario, bounded)
    except Exception as error:
        method = error.method if isinstance(error, WrongReturnError) else ""
        return located_message(error, *sorted(own, key=lambda part: not _gives(part, method)))
    return None


def _gives(part: Any, method: str) -> bool:
    """Return whether a method is of the part's own code."""
    return any(method in vars(cls) for cls in type(part).__mro__ if is_foreign(cls))


def mistaken_sensor(made: Sequence[Any]) -> str | None:
    """Return the mistake of a plugin's sensor with one of these targets.

    Asked before a scenario is made of them, which may look at its measurements.
    """
    sensors = [part for part in foreign_parts(tuple(made)) if isinstance(part, SensorBase)]
    targets = [*filter(_is_target, walk_parts(tuple(made)))] if sensors else []
    for target in targets:
        for sensor in sensors:
            try:
                with guarded(), np.errstate(all="ignore"):
                    _ask_sensor(sensor, len(target.components))
            except Exception as error:
                return located_message(error, sensor, target)
    return None


def _ask_part(part: Any, scenario: Scenario) -> None:
    if isinstance(part, SensorBase):
        _ask_sensor(part, len(scenario.components))
    if _is_target(part):
        scored = np.ones(len(scenario.steps), dtype=bool)
        _check_windows(part.windows(scenario.times, scored), len(scored))


def _is_target(part: Any) -> "TypeGuard[Target]":
    from trackbench.scenarios.targets.base import Target

    return isinstance(part, Target)


def _ask_sensor(sensor: SensorBase, n_x: int) -> None:
    """Raise WrongReturnError for what is no distribution of a measurement of two states."""
    n = len(sensor.components)
    x = np.add.outer(np.arange(1.0, n_x + 1.0), np.zeros(2))
    found: object = sensor.measurement(x, 1)
    if not isinstance(found, Gaussian):
        what = f"measurement gives a {type(found).__name__}, not a Gaussian"
        raise WrongReturnError("measurement", what)
    _check_shape("measurement", "its mean", found.mean, (n, 2))
    _check_shape("measurement", "its covariance", found.cov, (n, n), (n, n, 1), (n, n, 2))


@lru_cache(maxsize=4)
def _ask(scenario: Scenario, bounded: bool) -> None:
    """Ask what a run and its report ask of a scenario; once of equal ones."""
    runs, steps = min(2, scenario.recorded_runs or 2), len(scenario.steps)
    _check_shape("times", "times", scenario.times, (steps,))
    _check_windows(scenario.windows, steps)
    _ = scenario.spans, scenario.cautions, scenario.marginals, scenario.lost_beyond
    truth, seen, prior = scenario.simulate(RunStreams(0, range(runs)), runs)
    n_x, n_z = len(scenario.components), len(scenario.true_sensor.components)
    _check_shape("simulate", "the truth", truth, (n_x, steps, runs))
    _check_shape("simulate", "what is measured", seen, (n_z, steps - 1, runs))
    _check_shape("prior", "the prior's mean", prior.mean, (n_x, runs))
    _check_shape("prior", "the prior's covariance", prior.cov, (n_x, n_x), (n_x, n_x, runs))
    for name, error in scenario.errors(truth, truth).items():
        _check_shape("errors", f"the error {name!r}", error, (len(error), steps, runs))
    scenario.observables(truth)
    values = series(scenario, truth, truth, np.zeros((steps, runs)), None)
    per_run_metrics(scenario, values, (), np.ones(runs, dtype=bool))
    if bounded:
        scenario.bounds()


def _check_windows(windows: Mapping[str, object], steps: int) -> None:
    for name, mask in windows.items():
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (steps,):
            what = f"the window {name!r} is {_describe(mask)}, not an array ({steps},) of bool"
            raise WrongReturnError("windows", what)


def _check_shape(method: str, what: str, found: object, *shapes: tuple[int, ...]) -> None:
    if not isinstance(found, np.ndarray) or found.shape not in shapes:
        raise WrongReturnError(method, f"{what} is {_describe(found)}, not an array {shapes[0]}")


def _describe(found: object) -> str:
    if isinstance(found, np.ndarray):
        return f"an array {found.shape} of {found.dtype}"
    return f"a {type(found).__name__}"
