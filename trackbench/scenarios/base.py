"""What a scenario is: it simulates truth and measurements, and knows the model behind them.

Optional attributes of a scenario class:

``lost_beyond``  error beyond which a run counts as lost, in the unit of the first quantity of ``errors``
``run_metrics``  a method of the series (T + 1, M) by name: further numbers per run (M,) by name
``contents``     digests of the data files that were read, by path; else the files are hashed anew
``bounds``       a method: lower bounds of the errors (T + 1,) by quantity, for the key ``bound``
``observables``  a method of the state: functions of it by name, whose posterior means are measured
``marginals``    components by name of a part of the state: its own NEES beside the whole state's
``has_truth``    False if there are measurements only, and so no errors
``components``   names of the truth's components, if the model that filters assume has more
``believing``    a method of `trackbench.models.assumed.Assume`: the scenario as a filter sees it that
                 assumes this
``prior_kind``   the class of the prior, for filters that ask it for more than moments
``no_bound``     why ``bounds`` would be no bound, or None
``recorded_runs``  how many runs there are, if one cannot have as many as one likes
``spans``        start and end times of stretches that a figure over time shades
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution
from trackbench.core.streams import Streams
from trackbench.models.base import Model


class Simulation(NamedTuple):
    """M simulated runs.

    ``truth`` (n_x, T + 1, M) starts with the prior's step; ``measurements`` (n_z, T, M) follow it, NaN
    where there is none; ``prior`` is the distribution of the first state, given to every filter.
    """

    truth: Array
    measurements: Array
    prior: Distribution


class Scenario(Protocol):
    """A frozen dataclass whose fields are its YAML keys."""

    def __hash__(self) -> int:
        """Equal scenarios simulate equal data."""

    @property
    def model(self) -> Model:
        """Motion and sensor of the truth, which filters assume unless told otherwise."""

    @property
    def steps(self) -> Index:
        """Step numbers k (T + 1,), the prior's first."""

    @property
    def times(self) -> Array:
        """Times of the steps (T + 1,), s."""

    @property
    def windows(self) -> Mapping[str, Mask]:
        """Which steps (T + 1,) each named window of the error metrics covers; ``""`` is the whole."""

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Truth, measurements and prior of so many runs; ``rng`` has one stream per run."""

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Error vectors (d, *batch) by name of the quantity, from estimate and truth (n_x, *batch)."""


def truth_components(scenario: Scenario) -> tuple[str, ...]:
    """Names of the truth's components, which are also the first of every filter's state.

    Those of the model unless the scenario has ``components`` of its own.
    """
    own: tuple[str, ...] | None = getattr(scenario, "components", None)
    return own or scenario.model.motion.components


def in_window(name: str, window: str) -> str:
    """``name[window]``: a metric over a window of steps; the name alone over the whole time."""
    return f"{name}[{window}]" if window else name


def simulate_markov(model: Model, start: Array, steps: Index, rng: Streams) -> tuple[Array, Array]:
    """Truth (n_x, T + 1, M) and measurements (n_z, T, M) of the model itself from ``start``."""
    truth, seen = [start], []
    for k in steps[1:]:
        truth.append(model.motion.transition(truth[-1], int(k)).sample(rng))
        seen.append(model.sensor.measurement(truth[-1], int(k)).sample(rng))
    return np.stack(truth, axis=1), np.stack(seen, axis=1)
