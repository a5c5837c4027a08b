"""``PerRun``: base class of a filter for one run, and the filter of all runs made from it."""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import MISSING, Field, dataclass, fields, make_dataclass
from dataclasses import field as dataclass_field
from functools import cached_property
from inspect import getattr_static
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar, dataclass_transform

import numpy as np
from numpy.random import SFC64, Generator, SeedSequence
from numpy.typing import ArrayLike

from trackbench.adapters.filter_state_components import Order, Pair, component_mismatch
from trackbench.component_parts import field_values
from trackbench.core.arrays import Array, Mask, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.random_variates import NoiseGenerator
from trackbench.filters.base import WHOLE_FILTER, Filter, WrongReturnError
from trackbench.filters.failed_step import UnderWay
from trackbench.models.base import Model, Scene, WithJacobian
from trackbench.models.inputs import inputs_of
from trackbench.models.motions.sampling_interval import step_length
from trackbench.models.numerical_derivatives import central_differences, jacobian_at
from trackbench.registry import register

Value = TypeVar("Value")


class RunFunctions:
    """The model that the scenario lets a filter assume, as functions of one run's state.

    ``x`` is a state (n,) in the scenario's order, and every function is about the step ``k`` that the
    filter makes: x_k = f(x_{k-1}) + N(0, Q), z_k = h(x_k) + N(0, R). So f, F and Q take the state of the
    step before, h, H and R that of this step. They can be called from `step` on. ``R()`` without a state
    can be called from `start` on.

    Examples
    --------
    A step of the extended Kalman filter, in a class derived from `PerRun`::

        m = self.functions
        F = m.F(self.x, self.P)
        self.x, self.P = m.f(self.x), F @ self.P @ F.T + m.Q(self.x)
        H = m.H(self.x, self.P)
        S = H @ self.P @ H.T + m.R(self.x)
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ m.innovation(z, m.h(self.x))
    """

    def __init__(self, run: "PerRun") -> None:
        self._run = run

    def f(self, x: Array) -> Array:
        """Return the mean of the state at this step.

        Parameters
        ----------
        x : array (n,)
            State one step before, in the scenario's order and units.

        Returns
        -------
        array (n,)
            Mean of x_k given x_{k-1} = x.
        """
        next_state = self._run.model.motion.transition(_as_column(x), self._run.k)
        return _vector_of_run(next_state.mean)

    def Q(self, x: Array) -> Array:
        """Return the covariance of the process noise of this step.

        Parameters
        ----------
        x : array (n,)
            State one step before, on which the noise of some motions depends.

        Returns
        -------
        array (n, n)
            Covariance of x_k given x_{k-1} = x.
        """
        next_state = self._run.model.motion.transition(_as_column(x), self._run.k)
        return _matrix_of_run(next_state.cov)

    def F(self, x: Array, P: Array | None = None) -> Array:
        """Return the Jacobian of f at x; by central differences if the motion has none.

        Parameters
        ----------
        x : array (n,)
            State one step before.
        P : array (n, n), optional
            Covariance of x. The steps of differences follow from its standard deviations and from the
            size of x; without it, from the size of x, and they are 1e-6 at least.

        Returns
        -------
        array (n, n)
            Derivatives of the mean of x_k: row i has those of component i.
        """
        motion = self._run.model.motion

        def mean(states: Array) -> Array:
            return motion.transition(states, self._run.k).mean

        return self._jacobian(motion, mean, np.subtract, x, P)

    def h(self, x: Array) -> Array:
        """Return the mean of the measurement at this step.

        Parameters
        ----------
        x : array (n,)
            State at this step.

        Returns
        -------
        array (n_z,)
            Measurement of x without noise, in the scenario's order and units.
        """
        measurement = self._run.model.sensor.measurement(_as_column(x), self._run.k)
        return _vector_of_run(measurement.mean)

    def R(self, x: Array | None = None) -> Array:
        """Return the covariance of the measurement noise of this step.

        Parameters
        ----------
        x : array (n,), optional
            State at this step, on which the noise of some sensors depends. Without it the noise must be
            that of any state; before the first step it is that of step 1.

        Returns
        -------
        array (n_z, n_z)
            Covariance of z_k given x_k = x, in the scenario's order and units.

        Raises
        ------
        ValueError
            Without x, if the noise depends on the state.
        """
        if x is not None:
            measurement = self._run.model.sensor.measurement(_as_column(x), self._run.k)
            return _matrix_of_run(measurement.cov)
        # Entries that depend on the state are NaN at an unknown state.
        unknown_state = np.full((len(self._run.model.motion.components), 1), np.nan)
        k = vars(self._run).get("k", 1)
        with np.errstate(invalid="ignore"):
            R = _matrix_of_run(self._run.model.sensor.measurement(unknown_state, k).cov)
        if np.isnan(R).any():
            raise ValueError("R() needs a state, as the noise depends on it here: R(x)")
        return R

    def H(self, x: Array, P: Array | None = None) -> Array:
        """Return the Jacobian of h at x; by central differences if the sensor has none.

        Parameters
        ----------
        x : array (n,)
            State at this step.
        P : array (n, n), optional
            Covariance of x. The steps of differences follow from its standard deviations and from the
            size of x; without it, from the size of x, and they are 1e-6 at least.

        Returns
        -------
        array (n_z, n)
            Derivatives of the mean of z_k: row i has those of component i.
        """
        sensor = self._run.model.sensor

        def mean(states: Array) -> Array:
            return sensor.measurement(states, self._run.k).mean

        return self._jacobian(sensor, mean, sensor.innovation, x, P)

    def _jacobian(
        self,
        component: object,
        mean: Callable[[Array], Array],
        difference: Callable[[Array, Array], Array],
        x: Array,
        P: Array | None,
    ) -> Array:
        """Return the Jacobian (m, n) of a motion or sensor, or else the central differences of its mean.

        ``component`` is the motion or sensor. ``mean`` computes its m means from states (n, M).
        ``difference`` subtracts two means, with wrapped angles for a sensor. P (n, n) is the covariance
        of the state x (n,); None if it is unknown.
        """
        column = _as_column(x)
        if isinstance(component, WithJacobian) and P is None:
            J = component.jacobian(column, self._run.k)
        elif isinstance(component, WithJacobian):
            cov = np.asarray(P, dtype=float)
            J = jacobian_at(component, Gaussian(column, cov[..., None]), self._run.k)
        else:
            J = central_differences(mean, column, difference, spread=_deviations(P))
        return _matrix_of_run(J)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Subtract measurements, angles wrapped to (-pi, pi].

        Parameters
        ----------
        z : array (n_z,)
            Measurement in the scenario's order, NaN where a component is missing.
        z_pred : array (n_z,)
            Predicted measurement, such as ``h(x)``.

        Returns
        -------
        array (n_z,)
            ``z - z_pred``, NaN where a component is missing.
        """
        innovation = self._run.model.sensor.innovation(_as_column(z), _as_column(z_pred))
        return _vector_of_run(innovation)


def _as_column(x: Array) -> Array:
    """Return a vector (n,) as the only run (n, 1) of a block."""
    return np.asarray(x, dtype=float)[:, None].copy()


def _deviations(P: Array | None) -> Array | None:
    """Return the standard deviations (n, 1) of a state with the covariance P (n, n); None without P."""
    if P is None:
        return None
    return np.sqrt(np.diagonal(np.asarray(P, dtype=float)))[:, None]


def _vector_of_run(vectors: Array) -> Array:
    """Return the vector (n,) of the only run of a block, of (n, 1); it may be written to."""
    return np.array(vectors[:, 0])


def _matrix_of_run(matrix: Array) -> Array:
    """Return the matrix (m, n) of the only run of a block.

    ``matrix`` is (m, n), or (m, n, 1) with an axis over the runs.
    """
    return np.array(with_trailing(matrix, 1, leading=2)[..., 0])


class RunObjects(NamedTuple):
    """One object per run, and the last estimate of each in the filter's own order."""

    objects: tuple["PerRun", ...]
    order: Order
    mean: Array
    """means (n, M)"""
    cov: Array
    """covariances (n, n, M)"""


class LoopFilter(Filter[RunObjects]):
    """Base of the filters that `loop_over_runs` makes."""

    run_class: ClassVar["type[PerRun]"]
    """the class of one run"""
    loops_over_runs: ClassVar[bool] = True

    def __post_init__(self) -> None:
        self._make()  # the class's own checks of its keys

    def __reduce__(self) -> tuple[object, ...]:
        # By its name pickle would find `run_class`, which has the same module and name.
        return _restore, (self.run_class, self._keys)

    @cached_property
    def _keys(self) -> dict[str, object]:
        return field_values(self)

    def _make(self) -> "PerRun":
        # Mark the object before its own code runs, so that none of it assigns what trackbench sets.
        run = self.run_class.__new__(self.run_class)
        vars(run)[_OF_A_FILTER] = True
        run.__init__(**self._keys)  # type: ignore[misc]
        return run

    def conflicts(self, scenario: Scene) -> dict[str, str]:
        """Explain why the components of the filter do not match the scenario's; empty if they do.

        Components of its state that the scenario lacks are no mismatch if ``extra_std`` has their
        initial standard deviations. The reason has an empty key, as it is one of the filter as a whole.
        """
        run_class = self.run_class
        why = component_mismatch(
            scenario.model, run_class.state, run_class.measured, run_class.extra_std
        )
        if not why:
            return {}
        return {WHOLE_FILTER: why}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> RunObjects:
        """Make an object per run, and start it from the moments of its run's prior."""
        run_class = self.run_class
        order = Order.from_model(model, run_class.state, run_class.measured, run_class.extra_std)
        # (n_x, n_x, M), or (n_x, n_x, 1) for one covariance of all runs.
        prior_cov = np.asarray(with_trailing(prior.cov, 1, leading=2))
        # The prior's moments in the order of the filter's own n components, in arrays of all runs.
        n = len(order.first_cov)
        runs = prior.mean.shape[1]
        mean = np.empty((n, runs))
        cov = np.empty((n, n, runs))
        objects = tuple(self._make() for _ in range(runs))
        with UnderWay() as under_way:
            for m, run in enumerate(objects):
                under_way.run = m
                # Attributes that the object may use when it starts.
                attributes = vars(run)
                attributes["model"] = model
                # The first interval; `step` gets that of each step.
                attributes["dt"] = step_length(model)
                attributes["functions"] = RunFunctions(run)
                # A run's generator is created when the object first draws: many filters draw nothing.
                attributes["rng"] = _LazyGenerator(rng, m)
                # Index m, or 0 if one covariance serves all runs.
                cov_of_run = prior_cov[..., m % prior_cov.shape[2]]
                mean[:, m], cov[..., m] = order.to_filter(prior.mean[:, m], cov_of_run)
                run.start(mean[:, m].copy(), cov[..., m].copy())
        return RunObjects(objects=objects, order=order, mean=mean, cov=cov)

    def step(self, model: Model, state: RunObjects, z: Array, k: int, rng: Generator) -> RunObjects:
        """Call every object's step, one after the other.

        ``z`` (n_z, M) has the measurements of step ``k``, NaN for missing components.
        """
        dt = step_length(model, k)
        mean = np.empty_like(state.mean)
        cov = np.empty_like(state.cov)
        inputs = inputs_of(model.motion)
        # Runs without any measurement (M,).
        is_missing: Mask = np.asarray(np.isnan(z).all(axis=0))
        # A row per run in the order of the filter's components, which the object may write to.
        measurements = z[state.order.rows].T.copy()
        inputs_of_step = {}
        if inputs is not None:
            inputs_of_step = dict(zip(inputs.names, inputs.at(k), strict=True))
        with UnderWay() as under_way:
            for m, run in enumerate(state.objects):
                under_way.run = m
                vars(run)["k"] = k
                if inputs is not None:
                    vars(run)["inputs"] = dict(inputs_of_step)
                returned = run.step(None if is_missing[m] else measurements[m], dt)
                mean[:, m], cov[..., m] = _checked_moments(returned, len(mean), type(run))
        return state._replace(mean=mean, cov=cov)

    def estimate(self, state: RunObjects) -> Gaussian:
        """Return the scenario's components."""
        return state.order.to_scenario(state.mean, state.cov)

    def diagnostics(self, state: RunObjects) -> dict[str, Array]:
        """Return the diagnostics of every run as arrays (M,) by name."""
        rows = _call_each(state.objects, lambda run: run.diagnostics())
        if any(row.keys() != rows[0].keys() for row in rows):
            message = "the names of the diagnostics differ between runs"
            raise WrongReturnError("diagnostics", message)
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}


class LoopFilterWithLikelihood(LoopFilter):
    """Base of the filters made from a class with `log_likelihood`."""

    def log_likelihood(self, state: RunObjects) -> Array:
        """Return the objects' log-likelihoods."""
        return np.array(_call_each(state.objects, lambda run: run.log_likelihood()))


def _call_each(objects: "Sequence[PerRun]", method: "Callable[[PerRun], Value]") -> list[Value]:
    """Call a method of the object of each run; an error gets the number of its run."""
    values = []
    with UnderWay() as under_way:
        for m, run in enumerate(objects):
            under_way.run = m
            values.append(method(run))
    return values


def loop_over_runs(run_class: "type[PerRun]") -> type[LoopFilter]:
    """Make the class of a filter of all runs from a class of one run.

    It has the keys, the name and the docstring of ``run_class``. Its `run_class` is that class.

    Parameters
    ----------
    run_class : type of PerRun
        Class of one run, a dataclass. Its attribute ``_loop_filter`` is set to the result, which a
        pickle of the filter needs.

    Returns
    -------
    type of LoopFilter
        Class with an object of ``run_class`` for each run. It has a log score if ``run_class`` defines
        `log_likelihood`.
    """
    keys = [(field.name, field.type, _copy_field(field)) for field in fields(run_class)]
    attributes: dict[str, object] = {
        "run_class": run_class,
        "contract_exemptions": {
            "purity": "keeps its state in an object per run",
            **run_class.contract_exemptions,
        },
    }
    for name in (
        "__doc__",
        "__module__",
        "__qualname__",
        "requires",
        "summed_diagnostics",
        "presets",
        "deterministic",
    ):
        attributes[name] = getattr(run_class, name)
    # Only a class with the hook has a log score.
    base = LoopFilterWithLikelihood if run_class.has_likelihood() else LoopFilter
    filter_class = make_dataclass(
        run_class.__name__, keys, bases=(base,), namespace=attributes, frozen=True, kw_only=True
    )
    # A pickle of the filter has `run_class` and the keys: `_restore` finds the filter's class here.
    run_class._loop_filter = filter_class
    return filter_class


def _copy_field(key: Field[object]) -> object:
    """Return a copy of a dataclass field, as one field cannot belong to two classes.

    The default of a required key is MISSING, as that of its copy then is.
    """
    if key.default_factory is not MISSING:
        return dataclass_field(default_factory=key.default_factory)
    return dataclass_field(default=key.default)


def _restore(run_class: "type[PerRun]", keys: dict[str, object]) -> LoopFilter:
    """Make the filter of a class of one run again, from a pickle."""
    return run_class._loop_filter(**keys)


def _checked_moments(returned: object, n: int, run_class: type) -> tuple[Array, Array]:
    """Return the mean (n,) and the covariance (n, n) that the step of one run ``returned``.

    A filter without covariance returns the mean alone, as an array, or None beside it: its covariance is
    NaN. ``run_class`` is the class of the run. Raises WrongReturnError for other values.
    """
    # The method that the class defines: the step of PerRun returns the value of `update`.
    method = "step" if "step" in vars(run_class) else "update"
    if isinstance(returned, np.ndarray) and returned.ndim == 1:
        returned = (returned, None)
    if not isinstance(returned, tuple | list) or len(returned) != 2:
        message = (
            f"{run_class.__name__} returns a {type(returned).__name__}, not a mean and a covariance; "
            "a filter without covariance returns the mean alone, as an array"
        )
        raise WrongReturnError(method, message)
    returned_mean, returned_cov = returned
    mean = _checked_array(method, "mean", returned_mean, (n,))
    if returned_cov is None:
        return mean, np.full((n, n), np.nan)
    cov = _checked_array(method, "covariance", returned_cov, (n, n))
    return mean, cov


def _checked_array(method: str, name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return a value as an array of this shape; raises WrongReturnError for other values.

    ``method`` returned it, and ``name`` is what it is.
    """
    array = as_numbers(value, shape)
    if array is None:
        description = f"a {type(value).__name__}"
        value_shape = getattr(value, "shape", None)
        if value_shape is not None:
            description = f"an array {value_shape} of {getattr(value, 'dtype', '')}"
        message = f"the {name} of a run is {description}, not {shape} real numbers"
        raise WrongReturnError(method, message)
    return array


class _LazyGenerator:
    """Generator of one run, created when it is first used."""

    def __init__(self, block: Generator, run: int) -> None:
        self._block = block
        self._run = run

    def __getattr__(self, name: str) -> object:
        if name.startswith("__"):  # looked up by copy and pickle
            raise AttributeError(name)
        return getattr(self._generator, name)

    def __deepcopy__(self, memo: dict[int, object]) -> "_LazyGenerator":
        """Copy the run's stream in its state, if it was used; the block's stream stays shared."""
        other = _LazyGenerator(self._block, self._run)
        if "_generator" in vars(self):  # the cached property has been computed
            vars(other)["_generator"] = deepcopy(self._generator, memo)
        return other

    @cached_property
    def _generator(self) -> Generator:
        """Return the run's own stream of random numbers."""
        # One word of the block's stream is drawn, so that the runner notices that the filter is random.
        self._block.bit_generator.random_raw()
        block_seed = self._block.bit_generator.seed_seq
        assert isinstance(block_seed, SeedSequence)
        run_seed = SeedSequence(block_seed.entropy, spawn_key=(*block_seed.spawn_key, self._run))
        return NoiseGenerator(SFC64(run_seed))


_SET_BY_THE_LOOP = ("model", "functions", "rng", "dt", "k", "inputs")
"""Attributes of `PerRun` that `LoopFilter` sets and that a class reads."""
_OF_A_FILTER = "_trackbench_of_a_filter"
"""Mark of an object that `LoopFilter` made: its class may not assign the attributes above."""


class _SetByTheLoop:
    """Attribute of `PerRun` that `LoopFilter` sets; an assignment in the class's own code is an error.

    The value is in the object's ``__dict__``. An object that no `LoopFilter` made, as in a test of the
    class alone, may be given any value.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def __get__(self, run: object, run_class: type) -> Any:
        if run is None:
            return self
        try:
            return vars(run)[self._name]
        except KeyError:
            message = f"{type(run).__name__}: self.{self._name} is not set yet"
            raise AttributeError(message) from None

    def __set__(self, run: object, value: object) -> None:
        if _OF_A_FILTER in vars(run):
            message = f"self.{self._name} cannot be assigned, as trackbench sets it"
            raise AttributeError(f"{message}; use another name for a value of your own")
        vars(run)[self._name] = value


@dataclass_transform(eq_default=False, kw_only_default=True)
class PerRun:
    """A filter for one run, registered by ``class MyFilter(PerRun, kind="my-filter")``.

    trackbench makes an object for every run and calls ``start``, then ``step`` for each
    measurement. Write ``start`` and ``step``, or ``start``, ``predict`` and ``update``. Annotated
    attributes are the keys of the YAML, the docstring under each its help. The object may write to
    the arrays that it gets. trackbench sets the attributes below; the class may not assign them.

    Attributes
    ----------
    model : Model
        Motion and sensor that the scenario lets a filter assume, set before ``start``.
    dt : float
        Seconds to the first step, set before ``start``.
    rng : numpy.random.Generator
        Random numbers of this run, the only ones allowed, set before ``start``.
    functions : RunFunctions
        The same model as functions f, F, Q, h, H, R of this run's state, set before ``start``.
    k : int
        Number of the step, set before every ``step``.
    inputs : dict of str to float
        Known inputs that hold since the step before, such as a robot's speed, by the names that the
        motion gives them; set before every ``step`` if the motion has inputs.
    """

    _loop_filter: ClassVar[type[LoopFilter]]
    if TYPE_CHECKING:  # every subclass is a dataclass
        __dataclass_fields__: ClassVar[dict[str, Field[object]]]

    state: ClassVar[tuple[str, ...]] = ()
    """names of the state's components in the filter's order, ``("px", "py", "vx", "vy")``; default:
    the scenario's"""
    measured: ClassVar[tuple[str, ...]] = ()
    """names of the measurement's components in the filter's order, ``("azimuth", "range")``; default:
    the scenario's"""
    extra_std: ClassVar[Mapping[str, float]] = {}
    """components of ``state`` that the scenario lacks: initial standard deviation, about zero"""
    requires: ClassVar[tuple[str, ...]] = ()
    """see `trackbench.filters.base.Filter`, also for the four that follow"""
    presets: ClassVar[dict[str, dict[str, object]]] = {}
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset()
    contract_exemptions: ClassVar[dict[str, str]] = {}
    deterministic: ClassVar[bool] = False

    def __init_subclass__(cls, *, kind: str | None = None, **others: object) -> None:
        """Make the subclass a dataclass, and register the filter of it if there is a ``kind``.

        A subclass without a ``kind`` is a base of others. The keywords ``others`` are those of further
        base classes.
        """
        super().__init_subclass__(**others)
        dataclass(eq=False, kw_only=True)(cls)
        # Mistakes in the class that would surface late, in the middle of a run.
        for field in fields(cls):
            if hasattr(PerRun, field.name):
                message = (
                    f"a key cannot be called {field.name!r}: PerRun has an attribute of that name"
                )
                raise TypeError(message)
        for name in _SET_BY_THE_LOOP:
            if getattr_static(cls, name) is not vars(PerRun)[name]:
                message = f"an attribute of the class cannot be called {name!r}"
                raise TypeError(f"{message}: trackbench sets self.{name}")
        if kind is not None:
            if cls.step is PerRun.step and cls.predict is PerRun.predict:
                raise TypeError(f"{cls.__name__} has no step(z, dt), and no predict(dt)")
            register("filters", kind)(loop_over_runs(cls))

    def start(self, mean: Array, cov: Array) -> None:
        """Set the first state.

        Parameters
        ----------
        mean : array (n,)
            Mean of the prior, in the order of ``state``.
        cov : array (n, n)
            Covariance of the prior.
        """
        raise NotImplementedError(f"{type(self).__name__} has no start(mean, cov)")

    def step(self, z: Array | None, dt: float) -> Pair:
        """Predict over dt seconds and update with z.

        Parameters
        ----------
        z : array (n_z,) or None
            Measurement in the order of ``measured``, NaN where a component is missing; None without any.
        dt : float
            Seconds since the step before.

        Returns
        -------
        tuple
            Mean (n,) and covariance (n, n) after the update; the mean alone of a filter without
            covariance.
        """
        predicted = self.predict(dt)
        if z is None:
            return predicted
        return self.update(z)

    def predict(self, dt: float) -> Pair:
        """Predict over dt seconds.

        Parameters
        ----------
        dt : float
            Seconds since the step before.

        Returns
        -------
        tuple
            Mean (n,) and covariance (n, n) before the update.
        """
        raise NotImplementedError(f"{type(self).__name__} has no predict(dt)")

    def update(self, z: Array) -> Pair:
        """Update with z; it is called only if a component is measured.

        Parameters
        ----------
        z : array (n_z,)
            Measurement in the order of ``measured``, NaN where a component is missing.

        Returns
        -------
        tuple
            Mean (n,) and covariance (n, n) after the update.
        """
        raise NotImplementedError(f"{type(self).__name__} has no update(z)")

    def diagnostics(self) -> dict[str, float]:
        """Return numbers for the tables, which average them over the steps.

        Returns
        -------
        dict
            Numbers of the last step by their names; NaN for none. The names are those of every run.
        """
        return {}

    def log_likelihood(self) -> float:
        """Return the log-density of the last z before its update, for the log score.

        A class without this method has no log score.

        Returns
        -------
        float
            The log-density; NaN for none.
        """
        return float("nan")

    @classmethod
    def has_likelihood(cls) -> bool:
        """Test whether the class defines `log_likelihood`."""
        return cls.log_likelihood is not PerRun.log_likelihood

    model: Model
    functions: RunFunctions
    rng: Generator
    dt: float
    k: int
    inputs: dict[str, float]


# Assigned here, so that the body of the class has the attributes' types alone.
for _name in _SET_BY_THE_LOOP:
    setattr(PerRun, _name, _SetByTheLoop(_name))


def as_numbers(value: ArrayLike, shape: tuple[int, ...]) -> Array | None:
    """Read real numbers of a shape.

    Parameters
    ----------
    value : array_like
        Value that a class of one run returns.
    shape : tuple of int
        Shape that the value must have. A value with one more axis of length 1 at its end is allowed,
        such as a column (n, 1) for a vector (n,).

    Returns
    -------
    array or None
        The numbers in this shape, which may be whole numbers or booleans. None for any other value.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        return None
    if array.shape != shape and array.shape == (*shape, 1):
        array = array[..., 0]
    # Floats, whole numbers with and without a sign, and booleans.
    if array.shape != shape or array.dtype.kind not in "fiub":
        return None
    return array
