"""Targets, sensors, starts and scenarios of one's own: two runs of them, before anything runs."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from trackbench.core.distributions import Gaussian
from trackbench.core.streams import RunStreams
from trackbench.evaluation.metrics import per_run_metrics, series
from trackbench.experiment.blame import blamed
from trackbench.experiment.interrupts import guarded
from trackbench.filters.base import ReturnedError
from trackbench.hooks import foreign_within, is_foreign, parts_within
from trackbench.models.sensing import Measuring
from trackbench.scenarios.base import Scenario

if TYPE_CHECKING:
    from trackbench.scenarios.targets.base import Target


def mistake_of(scenario: Scenario, bounded: bool) -> str | None:
    """What would stop the runner in those parts of a scenario that are not the package's own.

    ``bounded`` if its lower bounds are wanted.
    """
    own = foreign_within(scenario)
    for part in own:
        try:
            with guarded(), np.errstate(all="ignore"):
                _ask_part(part, scenario)
        except Exception as error:
            return blamed(error, part, *own)
    try:
        with guarded(), np.errstate(all="ignore"):
            if own:
                _ask(scenario, bounded)
    except Exception as error:
        method = error.method if isinstance(error, ReturnedError) else ""
        return blamed(error, *sorted(own, key=lambda part: not _gives(part, method)))
    return None


def _gives(part: Any, method: str) -> bool:
    """Whether a method is of the part's own code."""
    return any(method in vars(cls) for cls in type(part).__mro__ if is_foreign(cls))


def mistaken_sensor(made: Sequence[Any]) -> str | None:
    """What is wrong with a sensor of one's own that is to see one of these targets.

    Asked before a scenario is made of them, which may look at its measurements.
    """
    sensors = [part for part in foreign_within(tuple(made)) if isinstance(part, Measuring)]
    targets = [*filter(_is_target, parts_within(tuple(made)))] if sensors else []
    for target in targets:
        for sensor in sensors:
            try:
                with guarded(), np.errstate(all="ignore"):
                    _ask_sensor(sensor, len(target.components))
            except Exception as error:
                return blamed(error, sensor, target)
    return None


def _ask_part(part: Any, scenario: Scenario) -> None:
    if isinstance(part, Measuring):
        _ask_sensor(part, len(scenario.components))
    if _is_target(part):
        scored = np.ones(len(scenario.steps), dtype=bool)
        _check_windows(part.windows(scenario.times, scored), len(scored))


def _is_target(part: Any) -> "TypeGuard[Target]":
    from trackbench.scenarios.targets.base import Target

    return isinstance(part, Target)


def _ask_sensor(sensor: Measuring, n_x: int) -> None:
    """Raise ReturnedError for what is no distribution of a measurement of two states."""
    n = len(sensor.components)
    x = np.add.outer(np.arange(1.0, n_x + 1.0), np.zeros(2))
    found: object = sensor.measurement(x, 1)
    if not isinstance(found, Gaussian):
        what = f"measurement gives a {type(found).__name__}, not a Gaussian"
        raise ReturnedError("measurement", what)
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
            what = f"the window {name!r} is {_told(mask)}, not an array ({steps},) of bool"
            raise ReturnedError("windows", what)


def _check_shape(method: str, what: str, found: object, *shapes: tuple[int, ...]) -> None:
    if not isinstance(found, np.ndarray) or found.shape not in shapes:
        raise ReturnedError(method, f"{what} is {_told(found)}, not an array {shapes[0]}")


def _told(found: object) -> str:
    if isinstance(found, np.ndarray):
        return f"an array {found.shape} of {found.dtype}"
    return f"a {type(found).__name__}"
