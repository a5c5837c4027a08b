"""Base of scenarios: simulate truth and measurements, and provide the model behind them."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution
from trackbench.core.random_streams import Streams
from trackbench.field_types import InvalidKeyError
from trackbench.metrics import joined
from trackbench.models.assume import Assume
from trackbench.models.base import Model, Scene, Sensor
from trackbench.models.delays import Late
from trackbench.models.likelihood import has_own_density


class Simulation(NamedTuple):
    """M simulated runs of T steps."""

    truth: Array
    """states (n_x, T + 1, M), the first at the prior's step"""
    measurements: Array
    """measurements (n_z, T, M) after the prior's step, NaN where there is none"""
    prior: Distribution
    """distribution of the first state, which every filter is given"""
    arrival: Index | None = None
    """step (S, T, M), from 0, at which the measurement of each of S sensors arrives, T for after the
    end; None if all arrive on time"""


class Scenario(Scene):
    """A frozen dataclass whose fields are its YAML keys; equal scenarios simulate equal data."""

    @property
    def named_errors(self) -> tuple[str, ...]:
        """Quantities of the errors that the config names, such as ``position``."""
        return ()

    @property
    @abstractmethod
    def windows(self) -> Mapping[str, Mask]:
        """Steps (T + 1,) of each window of the error metrics; ``""`` is the whole run."""

    @abstractmethod
    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Simulate the truth, the measurements and the prior.

        Parameters
        ----------
        rng : Streams
            Random numbers, a stream per run.
        runs : int
            Number M of runs.

        Returns
        -------
        Simulation
            Truth (n_x, T + 1, M), measurements (n_z, T, M) and the prior of M runs.
        """

    @abstractmethod
    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Compute the errors that metrics are made of.

        Parameters
        ----------
        mean, truth : Array (n_x, *batch)
            Estimates and true states.

        Returns
        -------
        dict[str, Array]
            Error vector (d, *batch) of each quantity, such as ``position`` for ``rmse_position``.
        """

    @property
    def components(self) -> tuple[str, ...]:
        """The truth's component names, the first of every filter's state."""
        return self.model.motion.components

    @property
    def angles(self) -> tuple[str, ...]:
        """Names of components that are angles, rad, so that whole turns are no error."""
        return ()

    @property
    def angle_rows(self) -> tuple[int, ...]:
        """Rows of the angles in the truth."""
        return tuple(i for i, name in enumerate(self.components) if name in self.angles)

    @property
    def true_sensor(self) -> Sensor:
        """Sensor that makes the measurements; default: the model's."""
        return self.model.sensor

    def with_assumptions(self, assume: Assume) -> "Scenario":
        """Return the scenario with the model that a filter assumes.

        Parameters
        ----------
        assume : Assume
            Assumptions of the filter. A key that is unset keeps the scenario's own.

        Returns
        -------
        Scenario
            Scenario whose `model` is that of the filter.

        Raises
        ------
        InvalidKeyError
            By default, as filters cannot assume anything else.
        """
        raise InvalidKeyError(f"of scenario {self.kind} filters assume what it says")

    def assumed_prior(self, runs: int) -> Distribution | None:
        """Return the prior that filters assume in place of the simulated one, if any.

        Parameters
        ----------
        runs : int
            Number M of runs.

        Returns
        -------
        Distribution or None
            Prior with mean (n_x, M). None, the default, if filters have the simulated one.
        """
        return None

    def assumed_measurements(self, z: Array) -> Array:
        """Return the measurements (n_z, T, M) as the filter's assumptions correct them.

        Parameters
        ----------
        z : array (n_z, T, M)
            Measurements after the prior's step, NaN where there is none.

        Returns
        -------
        array (n_z, T, M)
            Measurements that the filter is given. By default they are z.
        """
        return z

    @property
    def without_faults(self) -> "Scenario":
        """Scenario with equal truth and noise, and without faults; itself if it has none."""
        return self

    @property
    def longest_delay(self) -> int:
        """Number of steps that few measurements are later than; 0 if all arrive on time."""
        return 0

    @property
    def late(self) -> Late | None:
        """Treatment of late measurements by filters; None if filters get all measurements on time."""
        return None

    @property
    def without_scoring(self) -> "Scenario":
        """Scenario without what only scores estimates; filters run once for all that are equal then."""
        return self

    @property
    def has_truth(self) -> bool:
        """True if there is a truth; if there are measurements only, there are no errors."""
        return True

    @property
    def recorded_truth(self) -> Array | None:
        """Recorded true states (n_x, T + 1, M), NaN where they are unknown.

        None if there is no recorded truth, as in a simulation, where the truth is known at each step.
        """
        return None

    @property
    def recorded_runs(self) -> int | None:
        """Number of recorded runs; None for simulated scenarios."""
        return None

    @property
    def exists_always(self) -> bool:
        """True if the truth is a number at every step; else NaN stands for a target that is gone."""
        return False

    @property
    def training(self) -> "Scenario | None":
        """Scenario for tuning: the first part of recorded data; None: the scenario itself."""
        return None

    @property
    def cautions(self) -> tuple[str, ...]:
        """Notes on properties of the data that are legal and unexpected."""
        return ()

    @property
    def cautions_on_assumptions(self) -> tuple[str, ...]:
        """Notes on what a filter assumes that is legal and unexpected."""
        return ()

    @property
    def lost_beyond(self) -> float | None:
        """Error beyond which a run is lost, in the unit of the first quantity of `errors`."""
        return None

    @property
    def marginals(self) -> Mapping[str, tuple[int, ...]]:
        """Rows of each part of the state, by its name, that has a NEES beside the whole state's."""
        return {}

    def observables(self, x: Array) -> dict[str, Array]:
        """Return functions (*batch) of the state x (n_x, *batch) whose posterior means are measured.

        Parameters
        ----------
        x : array (n_x, *batch)
            States. Particles (n_x, M, N) have two axes of a batch.

        Returns
        -------
        dict of array (*batch)
            Values by name. By default there are none.
        """
        return {}

    def run_metrics(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Return further numbers per run (M,) by name, from the series (T + 1, M).

        Parameters
        ----------
        values : mapping of str to array (T + 1, M)
            Series of errors and of the filter's diagnostics, by name, such as ``squared_position``.

        Returns
        -------
        dict of array (M,)
            Number of each run by the metric's name. By default there are none.
        """
        return {}

    def bounds(self) -> dict[str, Array]:
        """Lower bounds of the errors (T + 1,) by quantity, for the key ``bound``.

        Returns
        -------
        dict of array (T + 1,)
            Bound on the RMSE of each quantity, such as ``position``, in its unit. By default there are
            none.
        """
        return {}

    def bounds_without_batch(self) -> tuple[dict[str, Array], ...]:
        """Return the bounds without each batch of simulated paths, which give their standard error.

        Returns
        -------
        tuple of dict of array (T + 1,)
            For each batch the bounds of all others, as `bounds` has them. Empty, the default, for a
            bound without simulation.
        """
        return ()

    @property
    def bound_caution(self) -> str:
        """Reason to doubt `bounds`; empty if there is none."""
        return ""

    @property
    def why_no_bound(self) -> str | None:
        """Reason why `bounds` is invalid; None if it is valid."""
        return "" if type(self).bounds is Scenario.bounds else None

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end times of stretches that a figure over time shades, s."""
        return []


def error_names(scenario: Scenario) -> list[str]:
    """Name the metrics of a scenario's errors, such as ``rmse_position``.

    Parameters
    ----------
    scenario : Scenario
        Scenario with a truth.

    Returns
    -------
    list of str
        Names. Errors that the config names come first.
    """
    # The errors of any estimate at any truth have the names of all quantities.
    nowhere = np.zeros((len(scenario.components), 1))
    quantities = list(scenario.errors(nowhere, nowhere))
    first = [quantity for quantity in scenario.named_errors if quantity in quantities]
    others = [quantity for quantity in quantities if quantity not in first]
    return [joined("rmse", quantity) for quantity in [*first, *others]]


def simulate_markov(model: Model, start: Array, steps: Index, rng: Streams) -> tuple[Array, Array]:
    """Simulate truth (n_x, T + 1, M) and measurements (n_z, T, M) from ``start``.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    start : Array (n_x, M)
        State at the first step.
    steps : Index (T + 1,)
        Numbers of the steps.
    rng : Streams
        Random numbers, a stream per run.

    Returns
    -------
    truth : Array (n_x, T + 1, M)
    measurements : Array (n_z, T, M)
    """
    n_z = len(model.sensor.components)
    truth = [start]
    measurements = []
    for step in steps[1:]:
        k = int(step)
        x = model.motion.transition(truth[-1], k).sample(rng)
        truth.append(x)
        # A sensor whose noise is not normal draws measurements itself, partly from normal numbers. It
        # draws them as this model knows them: none is missing, and none is an outlier or has a bias.
        if has_own_density(model.sensor):
            noise = rng.standard_normal((n_z, x.shape[-1]))
            measurements.append(model.sensor.draw_known(x, k, noise, rng))
        else:
            measurements.append(model.sensor.measurement(x, k).sample(rng))
    return np.stack(truth, axis=1), np.stack(measurements, axis=1)
