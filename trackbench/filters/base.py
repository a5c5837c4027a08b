"""What a filter is: a frozen dataclass of parameters with three pure functions.

Optional attributes of a filter class:

``needs``        what it cannot do without of model and prior: ``motion.jacobian``, ``prior.first``
``presets``      named sets of keys, chosen in a config by ``preset: NAME``
``expectation``  posterior means of functions of the state, which may differ from their values at
                 the mean: ``expectation(state, g) -> {name: (M,)}`` for ``g(x) -> {name: (...)}``
``diagnostics``  a method of the state: per-step values (M,) by name, averaged over the steps
``held``         a method of the model: numbers alive at once per run beside a cloud of N particles,
                 if there are many; for the runner's estimate of the memory
``counts``       names of diagnostics that are summed over the steps instead
``conflicts``    a method of the scenario: what it cannot do there, by key (``""``: as a whole); each is
                 a mistake with its line before anything runs
``cautions``     a method of the scenario: sentences on what is no mistake there but should be known
``explain``      a class method: further lines for ``trackbench describe``
``excused``      what of the contract it cannot keep by its nature, and why (trackbench/contract/)
"""

from typing import Any, Protocol, TypeVar

from numpy.random import Generator

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.models.base import Model

State = TypeVar("State")


class Filter(Protocol[State]):
    """Init, step, estimate. All runs of a block at once; a switch is a mask over runs."""

    def __hash__(self) -> int:
        """Equal filters compute equal estimates: keys that are lists are tuples."""

    def init(self, model: Model, prior: Distribution, rng: Generator) -> State:
        """The state before the first measurement; ``prior.mean`` is (n_x, M)."""

    def step(self, model: Model, state: State, z: Array, k: int, rng: Generator) -> State:
        """Predict to step k and update with z (n_z, M), NaN where missing. Pure: a new state."""

    def estimate(self, state: State) -> Gaussian:
        """Mean (n_x, M) and covariance (n_x, n_x, M)."""


AnyFilter = Filter[Any]

PLANAR_POSITION = ("state.planar", "motion.T", "sensor.per_axis")
"""What a filter needs that knows its motion itself, of a planar target seen by its position."""


def prior_kind(scenario: Any) -> type[Distribution]:
    """The class of a scenario's prior; moments are all that is known of one that does not say."""
    kind: type[Distribution] = getattr(scenario, "prior_kind", Gaussian)
    return kind
