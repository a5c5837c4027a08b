"""Search of a filter's keys: spread points, a Nelder-Mead simplex, then neighbors.

The search depends on the ranks of trials only, so its result is the same for any number of
workers. Nelder and Mead's simplex compares ranks without computing with them: lost runs and
objectives made rough by particles do not mislead it. docs/tuning.md explains the choice.
"""

from collections.abc import Generator, Iterable, Mapping, Sequence
from itertools import product
from math import prod
from typing import Any, TypeAlias

import numpy as np

from trackbench.config.tuning_axes import Axis
from trackbench.core.arrays import Array

Values: TypeAlias = tuple[Any, ...]
"""A value of each axis."""
Rank: TypeAlias = tuple[int, float]
"""Runs lost, and the objective of the others: the smaller, the better."""
Shares: TypeAlias = tuple[float, ...]
"""A place: the share of each axis, from 0 at its lower end to 1 at its upper end."""
Requests: TypeAlias = Generator[list[Values], Mapping[Values, Rank], None]
"""Yields values to try, any of them at once, and receives their ranks."""

_SPREAD_POINTS = 4  # points per key before the simplex
_GOLDEN_RATIOS = (
    1.618033988749895,
    1.324717957244746,
    1.2207440846057596,
    1.1673039782614187,
    1.1347241384015194,
)
"""Generalized golden ratios, ``x^(d + 1) = x + 1``, of one key to five."""
_SIMPLEX_STEP = 0.1  # share of an axis between the corners of the first simplex
_SIMPLEX_TOLERANCE = 2e-3  # share of an axis: a smaller simplex has converged
_NEIGHBOR_STEPS = ((-0.03, 0.03), (-0.08, 0.08), (-0.2, 0.2))
"""Shares of an axis by which a key is varied around the best, near then far."""
_WORST_OBJECTIVE = 1e300
_LOST_RUN = 1e12  # weight of a lost run in the simplex: more than any objective


def neighbor_budget(axes: Sequence[Axis], budget: int) -> int:
    """Return the number of trials, of ``budget``, that are reserved for the neighbors of the best trial.

    Each numeric key has two neighbors at each distance. The number is at most a third, so that a small
    budget is spent on the search itself.
    """
    numeric_axes = sum(not axis.choices for axis in axes)
    return min(2 * len(_NEIGHBOR_STEPS) * numeric_axes, budget // 3)


def first_place(axes: Sequence[Axis], configured: Mapping[str, Any]) -> Shares:
    """Return the place at which a search starts: for each axis the share, 0 to 1, of the config's value.

    ``configured`` has the values of the config by key. A value outside its axis is replaced with the
    middle of the axis.
    """
    shares = []
    for axis in axes:
        share = axis.share(configured.get(axis.key))
        if share is None:
            share = 0.5
        shares.append(share)
    return tuple(shares)


class Search:
    """Search of at most ``budget`` values of the axes that begins at the shares ``start``."""

    def __init__(self, axes: Sequence[Axis], start: Shares, budget: int) -> None:
        """Begin at the place ``start``; ``budget`` is the largest number of trials.

        There is an axis for each tuned key. A place has a share for each axis, from 0 at its lower end
        to 1 at its upper end.
        """
        self.ranks: dict[Values, Rank] = {}
        """rank of each trial so far, by the values of its keys"""
        self._axes = axes
        self._start = start
        self._remaining_budget = budget
        self._places: dict[Values, Shares] = {}
        """place of these values on the axes; values are rounded, so several places may share them"""
        self._numeric_axes = [i for i, axis in enumerate(axes) if not axis.choices]
        self._reserved_budget = neighbor_budget(axes, budget)
        """number of trials that the simplex leaves for the neighbors of the best trial"""

    @property
    def best(self) -> Values:
        """Values of the smallest rank; among equal ones the first."""
        return min(self.ranks, key=lambda values: self.ranks[values])

    def run(self) -> Requests:
        """Run the search: yield the values to try next, and receive their ranks.

        The choices are tried with the numbers of the start, then numbers with the best choices. The
        neighbors of the best trial follow, and last the choices again, with the best numbers.
        """
        yield from self._request([self._start, *self._with_each_choice(self._start)])
        if self._numeric_axes:
            yield from self._request(self._spread_places(self._places[self.best]))
            yield from self._run_simplex(self._places[self.best])
            yield from self._vary_best()
            yield from self._request(self._with_each_choice(self._places[self.best]))

    def _request(self, places: Iterable[Shares]) -> Requests:
        """Yield the values at these places that have no rank yet, and store the ranks that are sent.

        Values beyond the remaining budget are left out. Places that share their values count once.
        """
        new_places: dict[Values, Shares] = {}
        for place in places:
            values = self._values_at(place)
            if values not in self.ranks:
                new_places.setdefault(values, place)
        requested = list(new_places)[: self._remaining_budget]
        if requested:
            self._remaining_budget -= len(requested)
            self._places |= new_places  # more than are requested: nobody looks up the others
            self.ranks |= yield requested  # the caller sends a mapping of values to ranks

    def _values_at(self, place: Shares) -> Values:
        return tuple(axis.at(share) for axis, share in zip(self._axes, place, strict=True))

    def _with_each_choice(self, place: Shares) -> list[Shares]:
        """Return places that differ from ``place`` in their choices: one for every combination.

        If these are more than half of the remaining budget, only one choice at a time is changed. A
        place has a share, from 0 to 1, for each tuned key.
        """
        # Step 1: the shares of each axis of choices, at the middle of each choice.
        choice_axes = [i for i, axis in enumerate(self._axes) if axis.choices]
        choice_shares = []
        for i in choice_axes:
            n = len(self._axes[i].choices)
            # Each of the n choices has an equal part of the axis.
            choice_shares.append([(k + 0.5) / n for k in range(n)])
        # Step 2: every combination, or one axis at a time.
        changes: list[dict[int, float]] = []  # new shares by the axes' numbers
        if prod(len(shares) for shares in choice_shares) <= self._remaining_budget // 2:
            for combination in product(*choice_shares):
                changes.append(dict(zip(choice_axes, combination, strict=True)))
        else:
            for i, shares in zip(choice_axes, choice_shares, strict=True):
                changes += [{i: share} for share in shares]
        return [_with_shares(place, change) for change in changes]

    def _spread_places(self, place: Shares) -> list[Shares]:
        """Return places that spread evenly over the numeric axes, with the choices of ``place``.

        This is a low-discrepancy sequence: with d such axes and the generalized golden ratio g, the n-th
        place has the share 0.5 + n / g^j, modulo one, on the j-th of them. A share is a position from 0
        to 1 on the axis of a tuned key.
        """
        d = len(self._numeric_axes)
        steps = np.cumprod(np.full(d, 1.0 / _GOLDEN_RATIOS[d - 1]))  # 1 / g, 1 / g^2, ...
        places = []
        for n in range(1, _SPREAD_POINTS * d + 1):
            places.append(self._with_numbers(place, (0.5 + n * steps) % 1.0))
        return places

    def _run_simplex(self, place: Shares) -> Requests:
        """Run Nelder and Mead's simplex over the numeric axes, beginning at ``place``.

        Yield the values to try, and receive their ranks. scipy's simplex cannot wait for a rank. So
        after each new rank it is repeated from its first corner, with the known ranks, up to the next
        point whose rank is unknown. ``place`` has a share, from 0 to 1, for each axis.
        """
        # Step 1: the corners of the first simplex: the place, and one along each axis.
        first_corner = np.array([place[i] for i in self._numeric_axes])
        corners = [first_corner]
        for n, i in enumerate(self._numeric_axes):
            corner = first_corner.copy()
            # An axis of few whole numbers needs a step that reaches the next of them.
            step = max(_SIMPLEX_STEP, self._axes[i].grain)
            # Step toward the middle of the axis, so that the corner lies on it.
            if corner[n] < 0.5:
                corner[n] += step
            else:
                corner[n] -= step
            corners.append(corner)
        yield from self._request([self._with_numbers(place, corner) for corner in corners])
        # Step 2: one point after the other, until the budget for neighbors of the best is reached.
        while self._remaining_budget > self._reserved_budget:
            next_place = self._next_simplex_place(place, np.array(corners))
            if next_place is None:
                return
            yield from self._request([next_place])

    def _next_simplex_place(self, place: Shares, corners: Array) -> Shares | None:
        """Find the first point of the simplex whose rank is unknown; None if the simplex has converged.

        The simplex runs over the d numeric axes. ``corners`` (d + 1, d) has the shares, from 0 to 1, of
        these axes at its first corners. The shares of the other axes are those of ``place``.
        """
        from scipy.optimize import minimize

        def rank(numbers: Array) -> float:
            """Return the rank of these shares of the numeric axes as one number; raises if unknown."""
            place_of_numbers = self._with_numbers(place, numbers)
            values = self._values_at(place_of_numbers)
            if values not in self.ranks:
                raise _UnknownRankError(place_of_numbers)
            lost, objective = self.ranks[values]
            # One number for scipy: fewer lost runs first, then the objective. It is finite even for inf.
            return min(_LOST_RUN * lost + objective, _WORST_OBJECTIVE)

        # Only the size of the simplex ends it, not the differences of its ranks.
        options = {"initial_simplex": corners, "xatol": _SIMPLEX_TOLERANCE, "fatol": np.inf}
        bounds = [(0.0, 1.0)] * len(self._numeric_axes)
        try:
            minimize(rank, corners[0], method="Nelder-Mead", bounds=bounds, options=options)
        except _UnknownRankError as error:
            return error.place
        return None

    def _with_numbers(self, place: Shares, numbers: Array) -> Shares:
        """Return the place with the shares ``numbers`` (d,) of its d numeric axes."""
        return _with_shares(place, dict(zip(self._numeric_axes, numbers.tolist(), strict=True)))

    def _vary_best(self) -> Requests:
        """Try the neighbors of the best trial in each key alone, which show the key's good range.

        Yield their values, and receive their ranks.
        """
        for steps in _NEIGHBOR_STEPS:
            # The near neighbors may be better, so the far ones are those of the new best trial.
            place = self._places[self.best]
            neighbors = []
            for i, step in product(self._numeric_axes, steps):
                share = min(max(place[i] + step, 0.0), 1.0)
                neighbors.append(_with_shares(place, {i: share}))
            yield from self._request(neighbors)


def _with_shares(place: Shares, changes: Mapping[int, float]) -> Shares:
    """Return a place with other shares of some axes; ``changes`` has the shares by the axes' numbers."""
    return tuple(changes.get(i, share) for i, share in enumerate(place))


class _UnknownRankError(Exception):
    """Request for a place whose rank is unknown."""

    def __init__(self, place: Shares) -> None:
        super().__init__(place)
        self.place = place
