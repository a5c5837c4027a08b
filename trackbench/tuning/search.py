"""Search of a filter's keys: spread points, a Nelder-Mead simplex, then neighbors.

The search depends on the ranks of trials only, so its result is the same for any number of
workers. Nelder and Mead's simplex compares ranks without computing with them: lost runs and
objectives made rough by particles do not mislead it. docs/tuning.md explains the choice.
"""

from collections.abc import Generator, Iterable, Mapping, Sequence
from itertools import product
from typing import Any, TypeAlias

import numpy as np

from trackbench.config.tuning import Axis
from trackbench.core.arrays import Array

Values: TypeAlias = tuple[Any, ...]
"""A value of each axis."""
Rank: TypeAlias = tuple[int, float]
"""Runs lost, and the objective of the others: the smaller, the better."""
Shares: TypeAlias = tuple[float, ...]
Asking: TypeAlias = Generator[list[Values], Mapping[Values, Rank], None]
"""Gives values to try, any of them at once, and is sent their ranks."""

_ALL_OVER = 4  # points per key before the simplex
_RATIOS = (
    1.618033988749895,
    1.324717957244746,
    1.2207440846057596,
    1.1673039782614187,
    1.1347241384015194,
)
"""Generalised golden ratios, ``x^(d + 1) = x + 1``, of one key to five."""
_STEP = 0.1  # share of an axis between the corners of the first simplex
_SMALL = 2e-3  # share within which the simplex has come together
_AROUND = (-0.2, -0.08, -0.03, 0.03, 0.08, 0.2)
"""Shares of an axis at which a key is looked at from the best."""
_WORST = 1e300
_LOST = 1e12  # what a lost run counts: more than any objective


def looked_around(axes: Sequence[Axis], budget: int) -> int:
    """Return the part of the budget that is reserved for the neighbors of the best trial."""
    return min(len(_AROUND) * sum(not axis.choices for axis in axes), budget // 3)


class Search:
    """Search of at most ``budget`` values of the axes that begins at the shares ``start``."""

    def __init__(self, axes: Sequence[Axis], start: Shares, budget: int) -> None:
        self.ranks: dict[Values, Rank] = {}
        self._axes, self._start, self._left = axes, start, budget
        self._places: dict[Values, Shares] = {}
        self._numbers = [i for i, axis in enumerate(axes) if not axis.choices]
        self._kept_back = looked_around(axes, budget)

    @property
    def best(self) -> Values:
        """Return the values of the smallest rank; among equal ones the first."""
        return min(self.ranks, key=lambda values: self.ranks[values])

    def run(self) -> Asking:
        """Try choices at the start's numbers, numbers at the best choice, neighbors, choices."""
        yield from self._ask([self._start, *self._with_each_choice(self._start)])
        if self._numbers:
            yield from self._ask(self._all_over(self._places[self.best]))
            yield from self._simplex(self._places[self.best])
            yield from self._look_around()
            yield from self._ask(self._with_each_choice(self._places[self.best]))

    def _ask(self, places: Iterable[Shares]) -> Asking:
        """Yield the unknown values at these places within the budget."""
        new: dict[Values, Shares] = {}
        for place in places:
            values = self._values(place)
            if values not in self.ranks:
                new.setdefault(values, place)
        wanted = list(new)[: self._left]
        if wanted:
            self._left -= len(wanted)
            self._places |= {values: new[values] for values in wanted}
            self.ranks |= yield wanted

    def _values(self, place: Shares) -> Values:
        return tuple(axis.at(share) for axis, share in zip(self._axes, place, strict=True))

    def _with_each_choice(self, place: Shares) -> list[Shares]:
        """Return the place with every combination of choices; with many, each changed alone."""
        axes = [(i, len(axis.choices)) for i, axis in enumerate(self._axes) if axis.choices]
        combinations = int(np.prod([n for _, n in axes]))
        each = [{i: (k + 0.5) / n} for i, n in axes for k in range(n)]
        if combinations <= self._left // 2:
            ranges = [[(i, (k + 0.5) / n) for k in range(n)] for i, n in axes]
            each = [dict(chosen) for chosen in product(*ranges)]
        return [tuple(c.get(i, s) for i, s in enumerate(place)) for c in each]

    def _all_over(self, place: Shares) -> list[Shares]:
        """Return spread points: multiples of powers of the generalized golden ratio, modulo one."""
        d = len(self._numbers)
        steps = np.cumprod(np.full(d, 1.0 / _RATIOS[d - 1]))
        return [self._at(place, (0.5 + n * steps) % 1.0) for n in range(1, _ALL_OVER * d + 1)]

    def _simplex(self, place: Shares) -> Asking:
        """Run the simplex, replayed from its first corner after each answer."""
        corners = [np.array([place[i] for i in self._numbers])]
        for n, i in enumerate(self._numbers):
            corner = corners[0].copy()
            step = max(_STEP, self._axes[i].grain)
            corner[n] += step if corner[n] < 0.5 else -step
            corners.append(corner)
        yield from self._ask([self._at(place, corner) for corner in corners])
        while self._left > self._kept_back:
            wanted = self._next_corner(place, np.array(corners))
            if wanted is None:
                return
            yield from self._ask([wanted])

    def _next_corner(self, place: Shares, corners: Array) -> Shares | None:
        """Return the next unknown point of the simplex, or None if it has converged."""
        from scipy.optimize import minimize

        def rank(x: Array) -> float:
            values = self._values(self._at(place, x))
            if values not in self.ranks:
                raise _UnknownError(self._at(place, x))
            lost, objective = self.ranks[values]
            return min(_LOST * lost + objective, _WORST)

        options = {"initial_simplex": corners, "xatol": _SMALL, "fatol": np.inf}
        bounds = [(0.0, 1.0)] * len(self._numbers)
        try:
            minimize(rank, corners[0], method="Nelder-Mead", bounds=bounds, options=options)
        except _UnknownError as unknown:
            return unknown.place
        return None

    def _at(self, place: Shares, numbers: Array) -> Shares:
        """Return the place with other shares of the numeric axes."""
        changed = dict(zip(self._numbers, numbers.tolist(), strict=True))
        return tuple(changed.get(i, share) for i, share in enumerate(place))

    def _look_around(self) -> Asking:
        """Vary each key alone around the best, near then far, to find its good range."""
        near = sorted(_AROUND, key=abs)
        for pair in zip(near[::2], near[1::2], strict=True):
            place, places = self._places[self.best], []
            for i in self._numbers:
                for step in pair:
                    share = min(max(place[i] + step, 0.0), 1.0)
                    places.append((*place[:i], share, *place[i + 1 :]))
            yield from self._ask(places)


class _UnknownError(Exception):
    """Request for a point whose rank is unknown."""

    def __init__(self, place: Shares) -> None:
        super().__init__()
        self.place = place
