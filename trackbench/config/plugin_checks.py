"""Load the plugins of a config, and check what the runner takes for granted of their classes.

A mistake that these checks miss would end as a traceback, or in a wrong number.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard, TypeVar, cast

import numpy as np

from trackbench.config.build_dataclass import adapter
from trackbench.config.experiment import DrawnExhibit, Exhibit, Point
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import RunStreams
from trackbench.errors import UserError, reason
from trackbench.evaluation.error_series import per_run_metrics, series
from trackbench.extension_points import Part, foreign_parts, is_foreign, walk_parts
from trackbench.filters.base import AnyFilter, Filter, WrongReturnError
from trackbench.models.sensors.base import Measuring
from trackbench.plugins.errors import PluginError, guarded, location_of, plugin_code
from trackbench.plugins.load import Plugin, load_plugin, read_plugin
from trackbench.registry import base_of, kinds, registered
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Source

if TYPE_CHECKING:
    from trackbench.scenarios.targets.base import Target

T = TypeVar("T")

_FILES = {"per_step", "per_run", "summary"}
_PLAIN = (bool, int, float, str, type(None))


def load_plugins(source: Source, folder: Path, allowed: bool) -> tuple[Plugin, ...]:
    """Load the config's ``plugins``, paths counted from ``folder``; raises UserError.

    A config that names plugins is refused unless their code may be run.
    """
    names = source.data.get("plugins") or []
    if not isinstance(names, list):
        return ()  # said by the validation of the whole
    plugins, problems = [], []
    for i, name in enumerate(names):
        where = ("plugins", i)
        try:
            plugins.append(_loaded(folder, name, allowed))
        except PluginError as why:
            problems += [source.problem(where, what) for what in why.args]
    if problems:
        raise UserError(*problems)
    _check_apart(plugins, source)
    return tuple(plugins)


def _check_apart(plugins: list[Plugin], source: Source) -> None:
    """Reject two plugins of a config that register the same kind."""
    owners: dict[tuple[str, str], Plugin] = {}
    for i, plugin in enumerate(plugins):
        for group, kind, _ in registered(plugin.module):
            owner = owners.setdefault((group, kind), plugin)
            if owner is not plugin and owner.module != plugin.module:
                what = f"{plugin.path}: the kind {kind!r} is registered by {owner.path}, too"
                where = ("plugins", i)
                raise UserError(source.problem(where, what))


def _loaded(folder: Path, name: object, allowed: bool) -> Plugin:
    if not isinstance(name, str) or not name.endswith(".py"):
        raise PluginError(f"{name!r} is not the path of a Python file")
    if not allowed:
        raise PluginError(f"the code in {name} is run only with --allow-plugins")
    kinds("filters"), kinds("scenarios")  # first, so that a plugin cannot take their names
    try:
        plugin = read_plugin(folder / name)
        load_plugin(plugin, check_kind)
    except OSError as error:
        raise PluginError(f"{folder / name}: {reason(error)}") from None
    return plugin


def check_kind(cls: type[Part]) -> None:
    """Raise PluginError for a class that no config could make a part of."""
    for what in _mistakes(cls):
        raise PluginError(f"{location_of(WrongReturnError('', ''), cls)}{cls.__name__}: {what}")


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
        yield from _mistakes_of_exhibit(cast(type[Exhibit], cls))
    for field in fields(cls):
        default = _default(field)
        if field.init and not _is_plain(default):
            yield f"the key {field.name} is a {type(default).__name__}, which no YAML can hold"
    try:
        adapter(cls)
    except Exception as error:
        reason = str(error).split("\n", 1)[0].split(". Set `arb", 1)[0]
        yield f"has a key of a type that no YAML can hold: {reason}"


def _mistakes_of_exhibit(cls: type[Exhibit]) -> Iterator[str]:
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


def _is_plain(value: object) -> bool:
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    if isinstance(value, dict):
        return all(map(_is_plain, (*value, *value.values())))
    return isinstance(value, _PLAIN) or (is_dataclass(value) and not isinstance(value, type))


def filter_conflicts(tracker: AnyFilter, scenario: Scenario) -> dict[str, str]:
    """Return a filter's conflicts with the scenario; for plugins also what would stop the runner."""
    if not is_foreign(tracker):
        return tracker.conflicts(scenario)
    try:
        with plugin_code(tracker):
            conflicts: dict[str, str] = call_hook(tracker.conflicts, dict, scenario)
            sentences = call_hook(tracker.cautions, list, scenario)
            _check_words(*conflicts, *conflicts.values(), *sentences)
            call_hook(tracker.extra_memory, int, scenario.model)
            for key in ("N", "particle_count", "max_particle_count"):
                number = getattr(tracker, key, 1)
                if not isinstance(number, int) or number < 1:
                    raise WrongReturnError(key, f"its {key} is {number!r}, no whole number")
            hash(tracker)
    except PluginError as error:
        return {"": str(error)}
    return conflicts


def exhibit_conflicts(part: Exhibit, points: Sequence[Point]) -> dict[str, str]:
    """Return the conflicts of a table or figure; for plugins also what would stop the runner."""
    if not is_foreign(part):
        return part.conflicts(points)
    try:
        with plugin_code(part):
            conflicts: dict[str, str] = call_hook(part.conflicts, dict, points)
            _check_words(*conflicts, *conflicts.values())
            if isinstance(part, DrawnExhibit):
                _check_shown(part)
    except PluginError as error:
        return {"": str(error)}
    return conflicts


def _check_shown(part: DrawnExhibit) -> None:
    """Raise WrongReturnError unless a figure declares properly which tracks it needs."""
    runs, components = part.shown_runs, part.shown_components
    _ = part.shown_covariances, part.shown_measurements
    if not isinstance(runs, int):
        raise WrongReturnError("shown_runs", f"shown_runs is {runs!r}, no whole number")
    if components is not None and not isinstance(components, tuple):
        what = f"shown_components is {components!r}, neither a tuple of numbers nor None"
        raise WrongReturnError("shown_components", what)


def _check_words(*texts: object) -> None:
    """Raise WrongReturnError unless all of these are words."""
    if not all(isinstance(text, str) for text in texts):
        raise WrongReturnError("conflicts", "conflicts and cautions are words, and these are not")


def call_hook(hook: Callable[[Any], T], kind: type, about: object) -> T:
    """Return a hook's value; raises its error, or WrongReturnError for a wrong type."""
    with guarded():
        value = hook(about)
    if not isinstance(value, (list, tuple) if kind is list else kind):
        what = f"{hook.__name__} gives a {type(value).__name__}, not a {kind.__name__}"
        raise WrongReturnError(hook.__name__, what)
    return value


def check_scenario(scenario: Scenario, bounded: bool) -> None:
    """Raise PluginError for what would stop the runner in the plugin components of a scenario.

    ``bounded`` if its lower bounds are wanted.
    """
    plugins = foreign_parts(scenario)
    for part in plugins:
        with plugin_code(part, *plugins), np.errstate(all="ignore"):
            _check_part(part, scenario)
    if plugins:
        with plugin_code(*plugins), np.errstate(all="ignore"):
            _simulate_and_score(scenario, bounded)


def check_sensors(parts: Sequence[object]) -> None:
    """Raise PluginError for a plugin's sensor that cannot measure one of these targets.

    It is checked before a scenario is made of them, which may use its measurements.
    """
    sensors = [part for part in foreign_parts(tuple(parts)) if isinstance(part, Measuring)]
    targets = [*filter(_is_target, walk_parts(tuple(parts)))] if sensors else []
    for target in targets:
        for sensor in sensors:
            with plugin_code(sensor, target), np.errstate(all="ignore"):
                _check_sensor(sensor, len(target.components))


def _check_part(part: object, scenario: Scenario) -> None:
    if isinstance(part, Measuring):
        _check_sensor(part, len(scenario.components))
    if _is_target(part):
        scored = np.ones(len(scenario.steps), dtype=bool)
        _check_windows(part.windows(scenario.times, scored), len(scored))


def _is_target(part: object) -> "TypeGuard[Target]":
    from trackbench.scenarios.targets.base import Target

    return isinstance(part, Target)


def _check_sensor(sensor: Measuring, n_x: int) -> None:
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
def _simulate_and_score(scenario: Scenario, bounded: bool) -> None:
    """Call every hook that a run and its report call; once for equal scenarios."""
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
