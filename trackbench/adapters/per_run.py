"""``PerRun``: what a filter of one run is, as its author writes it."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import MISSING, dataclass, fields, make_dataclass
from dataclasses import field as dataclass_field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, cast, dataclass_transform

import numpy as np
from numpy.random import SFC64, Generator, SeedSequence

from trackbench.adapters.component_order import Order, Pair, as_numbers, mistakes
from trackbench.core.arrays import Array, Mask, with_trailing
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.random_variates import NoiseGenerator
from trackbench.filters.base import Filter, WrongReturnError
from trackbench.models.base import Model
from trackbench.models.motions.irregular import Irregular
from trackbench.registry import register

_PURITY = "keeps its state in an object per run"


class Objects(NamedTuple):
    """An object per run, and the last estimate of each: mean (n, M), cov (n, n, M), own order."""

    each: tuple[Any, ...]
    order: Order
    mean: Array
    cov: Array


class Looped(Filter[Objects]):
    """Base of the filters that `looped` makes of a class of one run, which is ``one``."""

    one: ClassVar[Any]
    """the class of one run, a `trackbench.adapters.PerRun`"""
    loops_over_runs: ClassVar[bool] = True

    def __post_init__(self) -> None:
        self._made()  # what the keys have to be among themselves, its own class says

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (self.one, self._keys)

    @cached_property
    def _keys(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def _made(self) -> Any:
        return self.one(**self._keys)

    def conflicts(self, scenario: Any) -> dict[str, str]:
        """Components that are not the scenario's."""
        one = self.one
        why = mistakes(scenario.model, one.state, one.measured, one.extra_std)
        return {"": why} if why else {}

    def init(self, model: Model, prior: Distribution, rng: Generator) -> Objects:
        """An object per run, each started from the prior's moments of its run."""
        one, runs = self.one, prior.mean.shape[1]
        order = Order.of(model, one.state, one.measured, one.extra_std)
        n, given = len(order.first_cov), np.asarray(with_trailing(prior.cov, 1, leading=2))
        mean, cov = np.empty((n, runs)), np.empty((n, n, runs))
        each = tuple(self._made() for _ in range(runs))
        for m, own in enumerate(each):
            own.model, own.dt, own.rng = model, interval(model), _Stream(rng, m)
            first_cov = given[..., m % given.shape[2]]
            mean[:, m], cov[..., m] = order.started(prior.mean[:, m], first_cov)
            own.start(mean[:, m].copy(), cov[..., m].copy())
        return Objects(each, order, mean, cov)

    def step(self, model: Model, state: Objects, z: Array, k: int, rng: Generator) -> Objects:
        """Every run's own step, one after the other."""
        mean, cov, dt = np.empty_like(state.mean), np.empty_like(state.cov), interval(model, k)
        missing: Mask = np.asarray(np.isnan(z).all(axis=0))
        seen = z[state.order.rows].T.copy()
        for m, own in enumerate(state.each):
            own.k = k
            found = own.step(None if missing[m] else seen[m], dt)
            mean[:, m], cov[..., m] = _moments(found, len(mean), type(own))
        return state._replace(mean=mean, cov=cov)

    def estimate(self, state: Objects) -> Gaussian:
        """The scenario's components."""
        return state.order.reported(state.mean, state.cov)

    def diagnostics(self, state: Objects) -> dict[str, Array]:
        """What the objects note of themselves."""
        rows = [own.diagnostics() for own in state.each]
        if any(row.keys() != rows[0].keys() for row in rows):
            raise WrongReturnError(
                "diagnostics", "the names of the diagnostics differ between runs"
            )
        return {name: np.array([row[name] for row in rows]) for name in rows[0]}


class Telling(Looped):
    """The same of a class that tells what it thought of each measurement before it saw it."""

    def log_likelihood(self, state: Objects) -> Array:
        """What each object says."""
        return np.array([own.log_likelihood() for own in state.each])


def looped(one: type[Any]) -> type[Looped]:
    """The filter of a class of one run: its keys, its name, its docstring."""
    keys = [(f.name, f.type, _like(f)) for f in fields(one)]
    about = {
        "one": one,
        "__doc__": one.__doc__,
        "__module__": one.__module__,
        "__qualname__": one.__qualname__,
        "requires": one.requires,
        "summed_diagnostics": one.summed_diagnostics,
        "contract_exemptions": {"purity": _PURITY, **one.contract_exemptions},
        "presets": one.presets,
    }
    base = Telling if one.has_likelihood() else Looped
    made = make_dataclass(
        one.__name__, keys, bases=(base,), namespace=about, frozen=True, kw_only=True
    )
    one._looped = made
    return made


def _like(key: Any) -> Any:
    """The key once more: a field belongs to one class."""
    if key.default_factory is not MISSING:
        return dataclass_field(default_factory=key.default_factory)
    return dataclass_field(default=key.default)


def _again(one: Any, keys: dict[str, Any]) -> Looped:
    return one._looped(**keys)


def interval(model: Model, k: int | None = None) -> float:
    """Seconds to step k from the one before it, by default of the first step there is.

    A motion without a time goes by one.
    """
    motion: Any = model.motion
    if isinstance(motion, Irregular):
        return float(motion.intervals[0 if k is None else k - motion.first])
    return float(getattr(motion, "T", 1.0))


def _moments(found: Any, n: int, one: type[Any]) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) that a step gave."""
    method = "step" if "step" in vars(one) or not hasattr(one, "update") else "update"
    if not isinstance(found, tuple | list) or len(found) != 2:
        what = f"{one.__name__} gives a {type(found).__name__}, not a mean and a covariance"
        raise WrongReturnError(method, what)
    kept = []
    for what, given, shape in (("mean", found[0], (n,)), ("covariance", found[1], (n, n))):
        array = as_numbers(given, shape)
        if array is None:
            text = f"the {what} of a run is {_described(given)}, not {shape} real numbers"
            raise WrongReturnError(method, text)
        kept.append(array)
    return kept[0], kept[1]


def _described(given: Any) -> str:
    shape, kind = getattr(given, "shape", None), getattr(given, "dtype", "")
    return f"a {type(given).__name__}" if shape is None else f"an array {shape} of {kind}"


class _Stream:
    """Stands for a run's own generator until it is first asked for anything."""

    def __init__(self, block: Generator, run: int) -> None:
        self._block, self._run = block, run

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # asked by whoever copies or pickles it
            raise AttributeError(name)
        return getattr(self._own, name)

    def __deepcopy__(self, memo: dict[int, Any]) -> "_Stream":
        other = _Stream(self._block, self._run)
        if "_own" in vars(self):
            vars(other)["_own"] = deepcopy(self._own, memo)
        return other

    @cached_property
    def _own(self) -> Generator:
        # A word of the block's own stream, so that whoever looks sees that there was noise.
        self._block.bit_generator.random_raw()
        seed = self._block.bit_generator.seed_seq
        assert isinstance(seed, SeedSequence)
        return NoiseGenerator(
            SFC64(SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, self._run)))
        )


_GIVEN = ("model", "rng", "dt", "k")


@dataclass_transform(eq_default=False, kw_only_default=True)
class PerRun:
    """A filter of one run: ``class MyFilter(PerRun, kind="my-filter")`` is all that registers it.

    Annotated attributes are the keys of the YAML, the docstring under each its help. An object is made
    for every run. Before ``start`` it is given ``model`` (what the scenario lets a filter assume),
    ``dt`` (seconds to the first step), ``rng`` (a generator of its own) and, before every step, ``k``
    (the step's number). Arrays that it is given are its own to write to.

    The state and the measurement have the scenario's components in the scenario's order, or those
    that ``state`` and ``measured`` name. A measurement without any number comes as None; a component
    that is missing is NaN.
    """

    state: ClassVar[tuple[str, ...]] = ()
    """names of the state's components in the filter's order: ``("px", "py", "vx", "vy")``"""
    measured: ClassVar[tuple[str, ...]] = ()
    """names of the measurement's components in the filter's order: ``("azimuth", "range")``"""
    extra_std: ClassVar[Mapping[str, float]] = {}
    """components of ``state`` that the scenario's has not: deviation at the start, from zero"""
    requires: ClassVar[tuple[str, ...]] = ()
    """see `trackbench.filters.base`, as for the three that follow"""
    presets: ClassVar[dict[str, dict[str, Any]]] = {}
    summed_diagnostics: ClassVar[frozenset[str]] = frozenset()
    contract_exemptions: ClassVar[dict[str, str]] = {"kalman": "has a model of its own"}

    def __init_subclass__(cls, *, kind: str | None = None, **others: Any) -> None:
        super().__init_subclass__(**others)
        dataclass(eq=False, kw_only=True)(cls)
        names = [field.name for field in fields(cast(Any, cls))]
        hidden = [name for name in names if name in _GIVEN or hasattr(PerRun, name)]
        if hidden:
            raise TypeError(f"a key cannot be called {hidden[0]!r}, which the filter is given")
        if kind is not None:
            if cls.step is PerRun.step and cls.predict is PerRun.predict:
                raise TypeError(f"{cls.__name__} has no step(z, dt), and no predict(dt)")
            register("filters", kind)(looped(cls))

    def start(self, mean: Array, cov: Array) -> None:
        """Take over the first state: mean (n,) and covariance (n, n)."""
        raise NotImplementedError(f"{type(self).__name__} has no start(mean, cov)")

    def step(self, z: Array | None, dt: float) -> Pair:
        """Predict over dt seconds, update with z (n_z,); mean and covariance after it."""
        predicted = self.predict(dt)
        return predicted if z is None else self.update(z)

    def predict(self, dt: float) -> Pair:
        """Predict over dt seconds; mean and covariance after it."""
        raise NotImplementedError(f"{type(self).__name__} has no predict(dt)")

    def update(self, z: Array) -> Pair:
        """Update with z (n_z,); mean and covariance after it."""
        raise NotImplementedError(f"{type(self).__name__} has no update(z)")

    def diagnostics(self) -> dict[str, float]:
        """Numbers that go to the tables, averaged over the steps: NaN where there is none."""
        return {}

    def log_likelihood(self) -> float:
        """Logarithm of the density that it gave the last z before it saw it: its log score.

        NaN where it tells none. A class without the method has no log score.
        """
        return float("nan")

    @classmethod
    def has_likelihood(cls) -> bool:
        """Whether the class has a `log_likelihood` of its own."""
        return cls.log_likelihood is not PerRun.log_likelihood

    model: Model
    rng: Generator
    dt: float
    k: int
