"""Base class of the filters, a frozen dataclass with three pure functions."""

from abc import abstractmethod
from collections.abc import Callable, Hashable, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.random import Generator

from trackbench.component_parts import Part
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.kalman import Innovation
from trackbench.core.posterior_scores import Posterior
from trackbench.errors import counted
from trackbench.models.base import Model, Scene

State = TypeVar("State")


class Filter(Part, Generic[State]):
    """A frozen dataclass with three pure functions of all M runs at once; a switch is a mask over runs.

    The state is any object, such as a NamedTuple of arrays whose last axis is the runs. Equal filters
    compute equal estimates and have equal hashes: keys that are lists are tuples.
    """

    requires: ClassVar[tuple[str, ...]] = ()
    """attributes of model and prior that the filter needs: ``motion.jacobian``, ``prior.first``"""
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset()
    """names of diagnostics that are summed over the steps, not averaged"""
    contract_exemptions: ClassVar[dict[str, str]] = {}
    """checks of the contract that the filter cannot pass by its nature, with reasons"""
    loops_over_runs: ClassVar[bool] = False
    """the filter loops over its runs in Python: blocks are narrow, and its times are marked"""
    density_only: ClassVar[bool] = False
    """of a measurement the filter uses the likelihood alone, which exists without a variance too"""
    mixes_runs: ClassVar[bool] = False
    """a run's last digits depend on the other runs of its block: such blocks are filtered one by one"""
    runs_program: ClassVar[bool] = False
    """a program outside of Python computes the estimates: the user must allow it to run"""
    uses_measurements: ClassVar[bool] = True
    """False for a filter that never updates: its prediction errors are those of its path"""
    deterministic: ClassVar[bool] = False
    """the filter draws no random numbers: on recorded data a published number is equal or differs"""
    is_linear: ClassVar[bool] = False
    """the gain depends on no measurement (apart from a key `gate`): errors have exact means"""

    @abstractmethod
    def init(self, model: Model, prior: Distribution, rng: Generator) -> State:
        """Return the state before the first measurement.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        prior : Distribution
            Prior of the first state: ``mean`` (n_x, M), ``cov`` (n_x, n_x) or (n_x, n_x, M).
        rng : numpy.random.Generator
            Random numbers of the block of runs, the only ones allowed.

        Returns
        -------
        State
            State that the first `step` starts from.
        """

    @abstractmethod
    def step(self, model: Model, state: State, z: Array, k: int, rng: Generator) -> State:
        """Return the state after the prediction to step k and the update with z.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : State
            State at the step before, which must stay as it is.
        z : array (n_z, M)
            Measurements of step k; NaN where one is missing.
        k : int
            Number of the step.
        rng : numpy.random.Generator
            Random numbers of the block of runs, the only ones allowed.

        Returns
        -------
        State
            State of step k, a new object.
        """

    def all_steps(self, model: Model, state: State, z: Array, k: int) -> "Steps | None":
        """Make many steps in one call, for speed in a filter that draws no random numbers.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        state : State
            State of step k - 1.
        z : array (n_z, T, M)
            Measurements of steps k to k + T - 1.
        k : int
            Number of the first step.

        Returns
        -------
        Steps or None
            Results of `step` for each measurement. None, as by default, lets the runner call `step`.
        """
        return None

    @abstractmethod
    def estimate(self, state: State) -> Gaussian:
        """Return the estimate of a state.

        Parameters
        ----------
        state : State
            State after `init` or after a step.

        Returns
        -------
        Gaussian
            Mean (n_x, M), and covariance (n_x, n_x, M), or (n_x, n_x) for all runs.
        """

    def diagnostics(self, state: State) -> dict[str, Array]:
        """Return values of the last step, which are averaged over the steps.

        Parameters
        ----------
        state : State
            State after a step.

        Returns
        -------
        dict of array (M,)
            Values by name; NaN where a run has none.
        """
        return {}

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of the diagnostics; a class without this hook is run for one step."""
        return frozenset()

    def expectation(self, state: State, g: Callable[[Array], dict[str, Array]]) -> dict[str, Array]:
        """Return posterior means of nonlinear functions g of the state, which differ from g(mean).

        Parameters
        ----------
        state : State
            State after a step.
        g : callable
            Takes states x (n_x, ...) and returns the values (...) of the functions by name.

        Returns
        -------
        dict of array (M,)
            Posterior means by name; default: none, and the functions are not scored.
        """
        return {}

    def posterior(self, state: State) -> Posterior | None:
        """Return the posterior density, if it is more than the Gaussian of the estimate.

        Parameters
        ----------
        state : State
            State after `init` or after a step.

        Returns
        -------
        Posterior or None
            Density of the state, evaluated at the truth for calibration and CRPS. None, as by default,
            stands for the Gaussian of `estimate`.
        """
        return None

    def log_likelihood(self, state: State) -> Array | None:
        """Return the predictive log-likelihood of the last measurement.

        Parameters
        ----------
        state : State
            State after a step.

        Returns
        -------
        array (M,) or None
            log p(z_k | z_1..k-1) by the filter's approximation; default: None.
        """
        return None

    def refused(self, state: State) -> Mask | None:
        """Return the measured components that a gate refused at the last step.

        Parameters
        ----------
        state : State
            State after a step.

        Returns
        -------
        array (n_z, M) or None
            True where a component was refused. None, as by default, is for a filter without a gate, and
            for one that refuses whole measurements: its diagnostic ``gated`` is 1 where it did.
        """
        return None

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Return reasons why the filter cannot run on the scenario, by key.

        Parameters
        ----------
        scenario : Scene
            Filter model, steps and prior of the scenario.

        Returns
        -------
        dict
            Reason by key (``detector.window_s``), or by ``""``, which is `WHOLE_FILTER`, for the filter
            as a whole. Each is an error before anything runs.
        """
        return {}

    def idle_keys(self, scenario: Scene) -> dict[str, str]:
        """Return the keys without effect on the scenario; a config that sets one is rejected.

        Parameters
        ----------
        scenario : Scene
            Filter model, steps and prior of the scenario.

        Returns
        -------
        dict
            Reason by key, such as "without `gate`", which ends the sentence "has no effect ...".
        """
        return {}

    def cautions(self, scenario: Scene) -> list[str]:
        """Return notes for the user on legal but unexpected settings.

        Parameters
        ----------
        scenario : Scene
            Filter model, steps and prior of the scenario.

        Returns
        -------
        list of str
            Notes, one sentence or more each; default: none.
        """
        return []

    @property
    def smooths(self) -> bool:
        """True if the filter's estimates are those of `smoothed`."""
        return False

    def smoothed(self, model: Model, states: list[State], k: int, rng: Generator) -> list[State]:
        """Return the states of every step given also later measurements.

        By default there is no smoother, and the states are returned as they are.

        Parameters
        ----------
        model : Model
            Motion and sensor that the filter assumes.
        states : list of State
            State after each step, that before the first measurement included.
        k : int
            Number of the step of the first state.
        rng : numpy.random.Generator
            Random numbers of the block of runs, after those of the filter.

        Returns
        -------
        list of State
            Smoothed state of every step.
        """
        return states

    @property
    def all_requirements(self) -> tuple[str, ...]:
        """`requires`, and what a filter within this one requires."""
        return self.requires

    @property
    def particle_count(self) -> int:
        """Number of particles per run: the key N, or 1."""
        return int(getattr(self, "N", 1))

    @property
    def max_particle_count(self) -> int:
        """Largest number of particles per run in any step."""
        return self.particle_count


AnyFilter = Filter[Any]


class Steps(NamedTuple):
    """Estimates, diagnostics and states of T steps, from one call of `Filter.all_steps`."""

    estimate: Gaussian
    """after each: mean (n_x, T, M); covariance (n_x, n_x, T, M), or (n_x, n_x, T, 1) for all runs"""
    diagnostics: dict[str, Array]
    """arrays (T, M) by name"""
    state: Callable[[int], Any]
    """returns the state after the measurement of this index: 0 is the first of the T, -1 the last"""
    together: Callable[[], Any] | None = None
    """returns one state of all T steps with its `prediction`, each step and run an entry (T, M)"""
    before: Callable[[Index], Any] | None = None
    """returns one state before the steps of these indices, each step's runs in turn, for any step"""


class JoinableFilter(Filter[State]):
    """Base of the filters that can be joined to one filter, with the same bytes as each alone.

    Such a filter draws no random numbers and uses the prior's mean and covariance only.
    """

    @abstractmethod
    def structure(self, scenario: Scene) -> Hashable:
        """Return a value that is equal for filters which differ in parameter values only.

        Parameters
        ----------
        scenario : Scene
            Scenario that the filters run on.

        Returns
        -------
        hashable
            Choices between algorithms, and lengths of arrays.
        """

    @abstractmethod
    def joined(self, filters: Sequence[Filter[State]], width: int) -> Filter[State]:
        """Return one filter, whose first ``width`` runs are the first filter's, and so on.

        Parameters
        ----------
        filters : sequence of Filter
            Filters of one `structure`.
        width : int
            Number of runs of each filter.

        Returns
        -------
        Filter
            Filter of ``len(filters) * width`` runs.
        """


class HasInnovation(Protocol):
    """State of a filter with one innovation per measurement."""

    @property
    def nis(self) -> Array:
        """Normalized innovation squared (M,), NaN before the first measurement."""

    @property
    def innovation(self) -> Innovation | None:
        """Innovation of the last measurement."""


InnovationState = TypeVar("InnovationState", bound=HasInnovation)


class InnovationFilter(Filter[InnovationState]):
    """Base of the filters with one innovation: its likelihood and its NIS."""

    def log_likelihood(self, state: InnovationState) -> Array:
        """Return log N(innovation; 0, S) (M,) of the last measurement."""
        if state.innovation is None:
            return np.full(state.nis.shape, np.nan)
        return state.innovation.log_likelihood

    @property
    def diagnostic_names(self) -> frozenset[str]:
        """Names of `diagnostics`."""
        return frozenset({"nis"})

    def diagnostics(self, state: InnovationState) -> dict[str, Array]:
        """Return ``nis``: normalized innovation squared, expected n_z."""
        return {"nis": state.nis}


def has_expectations(tracker: AnyFilter) -> bool:
    """Return whether the filter has the hook `expectation`."""
    return type(tracker).expectation is not Filter.expectation


def declares_diagnostics(cls: type[AnyFilter]) -> bool:
    """Return whether `diagnostic_names` belongs to the class that defines `diagnostics`.

    The names of a base class may lack those that the `diagnostics` of a subclass adds.
    """
    nearest = next(c for c in cls.__mro__ if {"diagnostic_names", "diagnostics"} & vars(c).keys())
    return "diagnostic_names" in vars(nearest)


def has_likelihood(tracker: AnyFilter) -> bool:
    """Return whether the filter has the hook `log_likelihood`."""
    return type(tracker).log_likelihood is not Filter.log_likelihood


class WrongReturnError(ValueError):
    """Return value of the ``method`` of a filter, table or figure that breaks the interface."""

    def __init__(self, method: str, message: str) -> None:
        super().__init__(message)
        self.method = method


WHOLE_FILTER = ""
"""Key of a conflict that concerns the filter as a whole and none of its keys."""
PLANAR_POSITION = ("state.planar", "motion.T", "sensor.per_axis")
"""Requirements of a filter with its own motion, of a planar target with measured positions."""


def filter_many(tracker: AnyFilter, model: Model, state: Any, z: Array, k: int) -> Steps | None:
    """Filter the measurements of several steps in one call of `Filter.all_steps`.

    Parameters
    ----------
    tracker : Filter
        The filter.
    model : Model
        Motion and sensor that the filter assumes.
    state : State
        State of step k - 1.
    z : array (n_z, T, M)
        Measurements of steps k to k + T - 1; NaN where one is missing.
    k : int
        Number of the first of these steps.

    Returns
    -------
    Steps or None
        Estimates, diagnostics and states of the T steps. None if the filter has no `all_steps`, or
        leaves these steps to `step`.

    Raises
    ------
    WrongReturnError
        If the estimates are not those of T steps and M runs.
    """
    steps = tracker.all_steps(model, state, z, k)
    if steps is not None and steps.estimate.mean.shape[1:] != z.shape[1:]:
        states = counted(steps.estimate.mean.shape[1], "state")
        message = f"gives {states} for {counted(z.shape[1], 'measurement')}"
        raise WrongReturnError("all_steps", message)
    return steps
