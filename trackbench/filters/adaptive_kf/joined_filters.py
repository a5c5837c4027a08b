"""Filters of variable dimension that differ in numbers only, side by side as one filter.

Each of them has ``width`` of the runs. A number that differs between them becomes an array over the
runs. Estimates have the same bytes as those of each filter alone.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, cast

import numpy as np

from trackbench.core.read_only import fixed
from trackbench.filters.adaptive_kf.algorithm import AdaptiveState, Parameters, VariableDimension
from trackbench.filters.adaptive_kf.per_axis import sampling_of
from trackbench.filters.base import Filter, JoinableFilter
from trackbench.models.base import Scene


class JoinableVariableDimension(VariableDimension, JoinableFilter[AdaptiveState]):
    """Base of the filters that `SideBySide` joins."""

    def structure(self, scenario: Scene) -> Hashable:
        """Return the choices between algorithms and the lengths of arrays.

        Filters for which these are equal can be joined.
        """
        p = self.parameters
        window = p.detector.window(sampling_of(scenario.model).T)
        choices = (p.detector.kind, p.detector.onset_rule, p.initialize)
        lengths = (window, p.exit.p)
        return (type(self), *choices, *lengths)

    def joined(self, filters: Sequence[Filter[AdaptiveState]], width: int) -> "SideBySide":
        """Join the filters side by side."""
        return SideBySide(cast("tuple[VariableDimension, ...]", tuple(filters)), width)


@dataclass(frozen=True)
class SideBySide(VariableDimension):
    """Filters of one `structure`, each for ``width`` runs."""

    filters: tuple[VariableDimension, ...]
    width: int

    @cached_property
    def parameters(self) -> Parameters:
        """Motions of the non-maneuvering (nmf) and maneuvering filter (mf), and the decisions, per run.

        The decisions are ``detector``, the decision logic window ``dlw``, and ``exit``.
        """
        parameters = [single.parameters for single in self.filters]

        def joined(name: str) -> Any:
            return _PerRun([getattr(p, name) for p in parameters], self.width)

        return Parameters(
            nmf=joined("nmf"),
            mf=joined("mf"),
            detector=joined("detector"),
            dlw=joined("dlw"),
            exit=joined("exit"),
            initialize=parameters[0].initialize,  # equal in all filters of one `structure`
        )


class _PerRun:
    """Stand-in for several objects of a class, each for ``width`` runs.

    Its attributes, and the results of its methods, are those of the objects if these are equal, else
    arrays with a value per run.
    """

    def __init__(self, parts: Sequence[Any], width: int) -> None:
        self._parts = parts
        self._width = width

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of all objects as one, or a method that does so with its results."""
        values = [getattr(part, name) for part in self._parts]
        stacked = self._method(values) if callable(values[0]) else _per_run(values, self._width)
        self.__dict__[name] = stacked  # looked up at every step
        return stacked

    def _method(self, methods: Sequence[Callable[..., Any]]) -> Callable[..., Any]:
        return cache(lambda *args: _per_run([m(*args) for m in methods], self._width))


def _per_run(values: Sequence[Any], width: int) -> Any:
    """Return the value of several filters if it is equal for all, else an array over their runs.

    Each filter has ``width`` of the M runs. Numbers become (M,), matrices (n, n, 1, M): the axis of
    length 1 is that of the axes of the plane, along which all motions are alike.
    """
    first = values[0]
    if isinstance(first, tuple):  # F and Q of a motion
        columns = (_per_run(column, width) for column in zip(*values, strict=True))
        return type(first)(*columns)
    if all(np.array_equal(value, first) for value in values):
        return first
    rows = np.repeat(np.stack(values, axis=-1), width, axis=-1)
    return fixed(rows[:, :, None] if rows.ndim == 3 else rows)
