"""Trial of a scenario that has plugin components: a simulated run, scored, before anything runs."""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np

from trackbench.component_parts import foreign_parts, walk_parts
from trackbench.core.distributions import Gaussian
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.error_series import series
from trackbench.evaluation.per_run_metrics import per_run_metrics
from trackbench.evaluation.series_sums import SeriesSums
from trackbench.filters.base import WrongReturnError
from trackbench.metrics import NAME_OF_PREDICTION, is_of_prediction
from trackbench.models.sensors.base import SensorBase
from trackbench.plugins.plugin_errors import plugin_code
from trackbench.scenarios.base import Scenario


def check_scenario(scenario: Scenario, bounded: bool) -> None:
    """Raise PluginError for mistakes in the plugin components of a scenario that would stop a run.

    ``bounded`` is true if the config requests lower bounds by the key `bound`. They are then computed.
    """
    plugins = foreign_parts(scenario)
    if not plugins:
        return
    from trackbench.scenarios.targets.base import Target

    for part in plugins:
        # An error has the line of this part, if its code raised it, or else of another one.
        with plugin_code(part, *plugins), np.errstate(all="ignore"):
            if isinstance(part, SensorBase):
                _check_sensor(part, len(scenario.components))
            if isinstance(part, Target):
                scored = np.ones(len(scenario.steps), dtype=bool)  # as if all steps were scored
                _check_windows(part.windows(scenario.times, scored), len(scored))
    with plugin_code(*plugins), np.errstate(all="ignore"):
        _simulate_and_score(scenario, bounded)


def check_sensors(parts: Sequence[object]) -> None:
    """Raise PluginError for a plugin's sensor that cannot measure one of these targets.

    It is checked before a scenario is made of them, which may use its measurements.
    """
    sensors = [part for part in foreign_parts(tuple(parts)) if isinstance(part, SensorBase)]
    if not sensors:
        return
    from trackbench.scenarios.targets.base import Target

    targets = [part for part in walk_parts(tuple(parts)) if isinstance(part, Target)]
    for target in targets:
        for sensor in sensors:
            with plugin_code(sensor, target), np.errstate(all="ignore"):
                _check_sensor(sensor, len(target.components))


def _check_sensor(sensor: SensorBase, n_x: int) -> None:
    """Raise WrongReturnError unless a sensor returns the distribution of a measurement of two states.

    ``n_x`` is the number of the state's components.
    """
    n = len(sensor.components)
    # Two equal states (n_x, 2).
    x = np.add.outer(np.arange(1.0, n_x + 1.0), np.zeros(2))
    distribution: object = sensor.measurement(x, 1)  # at step 1
    if not isinstance(distribution, Gaussian):
        message = f"measurement gives a {type(distribution).__name__}, not a Gaussian"
        raise WrongReturnError("measurement", message)
    _check_shape("measurement", "its mean", distribution.mean, (n, 2))
    _check_shape("measurement", "its covariance", distribution.cov, (n, n), (n, n, 1), (n, n, 2))


@lru_cache(maxsize=4)
def _simulate_and_score(scenario: Scenario, bounded: bool) -> None:
    """Call every hook that a run and its report call, and check shapes; once for equal scenarios.

    Raises WrongReturnError. With ``bounded`` it also computes the lower bounds.
    """
    runs = min(2, scenario.recorded_runs or 2)
    steps = len(scenario.steps)
    # Step 1: properties. Those without a check are read so that an error in them is reported here.
    _check_shape("times", "times", scenario.times, (steps,))
    _check_windows(scenario.windows, steps)
    _ = scenario.spans
    _ = scenario.cautions
    _ = scenario.marginals
    _ = scenario.lost_beyond
    # Step 2: simulate, and check the shapes.
    truth, measurements, prior, *_ = scenario.simulate(RunStreams(0, range(runs)), runs)
    n_x = len(scenario.components)
    n_z = len(scenario.true_sensor.components)
    _check_shape("simulate", "the truth", truth, (n_x, steps, runs))
    # The first step is that of the prior, and has no measurement.
    _check_shape("simulate", "what is measured", measurements, (n_z, steps - 1, runs))
    _check_shape("prior", "the prior's mean", prior.mean, (n_x, runs))
    _check_shape("prior", "the prior's covariance", prior.cov, (n_x, n_x), (n_x, n_x, runs))
    # Step 3: score estimates that equal the truth, without a reference (``exact``), without diagnostics
    # that are summed over the steps (``counts``), and as if no run were lost.
    for name, error in scenario.errors(truth, truth).items():
        _check_shape("errors", f"the error {name!r}", error, (len(error), steps, runs))
        if is_of_prediction(name):
            message = f"an error cannot be named {name!r}, {NAME_OF_PREDICTION}"
            raise WrongReturnError("errors", message)
    scenario.observables(truth)
    nees = np.zeros((steps, runs))
    values = series(scenario, truth=truth, mean=truth, nees=nees, exact=None)
    sums = SeriesSums.from_series(values, scenario.windows, counts=())
    per_run_metrics(scenario, values, sums, np.ones(runs, dtype=bool))
    if bounded:
        scenario.bounds()


def _check_windows(windows: Mapping[str, object], steps: int) -> None:
    """Raise WrongReturnError unless each window is an array (steps,) of bool."""
    for name, mask in windows.items():
        if not isinstance(mask, np.ndarray) or mask.dtype != bool or mask.shape != (steps,):
            message = f"the window {name!r} is {_describe(mask)}, not an array ({steps},) of bool"
            raise WrongReturnError("windows", message)


def _check_shape(method: str, name: str, value: object, *shapes: tuple[int, ...]) -> None:
    """Raise WrongReturnError unless a method's value is an array of one of the shapes."""
    if not isinstance(value, np.ndarray) or value.shape not in shapes:
        message = f"{name} is {_describe(value)}, not an array {shapes[0]}"
        raise WrongReturnError(method, message)


def _describe(value: object) -> str:
    """Name a value's type, with the shape of an array."""
    if isinstance(value, np.ndarray):
        return f"an array {value.shape} of {value.dtype}"
    return f"a {type(value).__name__}"
