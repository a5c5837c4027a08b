"""What a filter is: a frozen dataclass of parameters with three pure functions."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any, ClassVar, Generic, TypeVar

from numpy.random import Generator

from trackbench.core.arrays import Array
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.posteriors import Posterior
from trackbench.extension_points import Part
from trackbench.models.base import Model, Scene

State = TypeVar("State")


class Filter(Part, Generic[State]):
    """A frozen dataclass with three pure functions, of all runs at once; a switch is a mask over runs.

    Equal filters compute equal estimates and have equal hashes: keys that are lists are tuples.
    """

    requires: ClassVar[tuple[str, ...]] = ()
    """what it cannot do without of model and prior: ``motion.jacobian``, ``prior.first``"""
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset()
    """names of diagnostics that are summed over the steps, not averaged"""
    contract_exemptions: ClassVar[dict[str, str]] = {}
    """what of the contract it cannot keep by its nature, and why (trackbench/contract/)"""
    loops_over_runs: ClassVar[bool] = False
    """whether its runs are looped over in Python: then blocks are narrow, and its times are marked"""

    @abstractmethod
    def init(self, model: Model, prior: Distribution, rng: Generator) -> State:
        """The state before the first measurement; ``prior.mean`` is (n_x, M)."""

    @abstractmethod
    def step(self, model: Model, state: State, z: Array, k: int, rng: Generator) -> State:
        """Predict to step k and update with z (n_z, M), NaN where missing. Pure: a new state."""

    @abstractmethod
    def estimate(self, state: State) -> Gaussian:
        """Mean (n_x, M) and covariance (n_x, n_x, M)."""

    def diagnostics(self, state: State) -> dict[str, Array]:
        """Values per step (M,) by name, averaged over the steps."""
        return {}

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of its diagnostics; a class that has some and does not say so is asked by a step."""
        return frozenset()

    def expectation(self, state: State, g: Callable[[Array], dict[str, Array]]) -> dict[str, Array]:
        """Posterior means (M,) by name of functions ``g(x)`` of states x, where they are not g(mean)."""
        return {}

    def posterior(self, state: State) -> Posterior | None:
        """What it holds the state for, if that is more than the Gaussian of its estimate."""
        return None

    def log_likelihood(self, state: State) -> Array | None:
        """log p(z_k | z_1..k-1) (M,) of the last measurement by its own approximation, if it has one."""
        return None

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """What it cannot do there, by key (``""``: as a whole): mistakes before anything runs."""
        return {}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Return the keys without effect in the scenario, each with the reason; a set one is refused."""
        return {}

    def cautions(self, scenario: Scene) -> list[str]:
        """Sentences on what is no mistake there but should be known."""
        return []

    @property
    def all_requirements(self) -> tuple[str, ...]:
        """What it needs of the scenario: `requires`, and what a filter within it needs."""
        return self.requires

    @property
    def particle_count(self) -> int:
        """Particles per run: its key N, or 1 of a filter without any."""
        return int(getattr(self, "N", 1))

    @property
    def max_particle_count(self) -> int:
        """The same in the steps in which it has most."""
        return self.particle_count

    def extra_memory(self, model: Model) -> int:
        """Numbers alive at once per run beside its particles, for the estimate of the memory."""
        return 0


AnyFilter = Filter[Any]


def has_expectations(tracker: AnyFilter) -> bool:
    """Whether the filter knows posterior means of functions beside those of its estimate."""
    return type(tracker).expectation is not Filter.expectation


def declares_diagnostics(cls: type[AnyFilter]) -> bool:
    """Whether its `diagnostic_names` are of its own diagnostics: no class below them has others."""
    nearest = next(c for c in cls.__mro__ if {"diagnostic_names", "diagnostics"} & vars(c).keys())
    return "diagnostic_names" in vars(nearest)


def has_likelihood(tracker: AnyFilter) -> bool:
    """Whether the filter tells what it thought of each measurement before it saw it."""
    return type(tracker).log_likelihood is not Filter.log_likelihood


class WrongReturnError(ValueError):
    """What a filter's ``method`` gave back is not what it has to be."""

    def __init__(self, method: str, what: str) -> None:
        super().__init__(what)
        self.method = method


OWN_MOTION = {"assume.motion": "as this filter has a motion of its own"}
"""Idle keys of a filter that takes from the assumed motion the time between steps only."""
PLANAR_POSITION = ("state.planar", "motion.T", "sensor.per_axis")
"""What a filter needs that knows its motion itself, of a planar target seen by its position."""
