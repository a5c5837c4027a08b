"""``PerRun``: what a filter of one run is, as its author writes it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, cast, dataclass_transform

from numpy.random import Generator

from trackbench.adapters.looped import looped
from trackbench.adapters.naming import Pair
from trackbench.core.arrays import Array
from trackbench.models.base import Model
from trackbench.registry import register

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
    needs: ClassVar[tuple[str, ...]] = ()
    """see `trackbench.filters.base`, as for the three that follow"""
    presets: ClassVar[dict[str, dict[str, Any]]] = {}
    counts: ClassVar[frozenset[str]] = frozenset()
    excused: ClassVar[dict[str, str]] = {"kalman": "has a model of its own"}

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
    def tells_likelihood(cls) -> bool:
        """Whether the class has a `log_likelihood` of its own."""
        return cls.log_likelihood is not PerRun.log_likelihood

    model: Model
    rng: Generator
    dt: float
    k: int
