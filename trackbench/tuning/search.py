"""Search of a filter's keys: spread points, a Nelder-Mead simplex, then neighbors; its record.

The search depends on the ranks of trials only, so its result is the same for any number of
workers. Nelder and Mead's simplex compares ranks without computing with them: lost runs and
objectives made rough by particles do not mislead it. docs/tuning.md explains the choice. The record is
tuning.csv: every trial, a row per key, and conclusions about the keys.
"""

import csv
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, product, starmap
from math import inf, isfinite, nan, prod
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TextIO, TypeAlias

import numpy as np

from trackbench.atomic_files import write_csv
from trackbench.config.tuning import Axis, read_axis
from trackbench.core.arrays import Array
from trackbench.statistics.estimates import RunEstimate
from trackbench.yaml_source import scalar

Values: TypeAlias = tuple[Any, ...]
"""A value of each axis."""
Rank: TypeAlias = tuple[int, float]
"""Runs lost, and the objective of the others: the smaller, the better."""
Shares: TypeAlias = tuple[float, ...]
Asking: TypeAlias = Generator[list[Values], Mapping[Values, Rank], None]
"""Gives values to try, any of them at once, and is sent their ranks."""

_ALL_OVER = 4  # points per key before the simplex
_RATIOS = (
    *(1.618033988749895, 1.324717957244746, 1.2207440846057596),
    *(1.1673039782614187, 1.1347241384015194),
)
"""Generalized golden ratios, ``x^(d + 1) = x + 1``, of one key to five."""
_STEP = 0.1  # share of an axis between the corners of the first simplex
_SMALL = 2e-3  # share within which the simplex has come together
_AROUND = ((-0.03, 0.03), (-0.08, 0.08), (-0.2, 0.2))
"""Shares of an axis at which a key is varied around the best, near then far."""
_WORST = 1e300
_LOST = 1e12  # what a lost run counts: more than any objective


def looked_around(axes: Sequence[Axis], budget: int) -> int:
    """Reserve a part of the budget for the neighbors of the best trial."""
    return min(2 * len(_AROUND) * sum(not axis.choices for axis in axes), budget // 3)


class Search:
    """Search of at most ``budget`` values of the axes that begins at the shares ``start``."""

    def __init__(self, axes: Sequence[Axis], start: Shares, budget: int) -> None:
        self.ranks: dict[Values, Rank] = {}
        self._axes, self._start, self._left = axes, start, budget
        self._places: dict[Values, Shares] = {}
        self._numbers = [i for i, axis in enumerate(axes) if not axis.choices]
        self._reserved = looked_around(axes, budget)

    @property
    def best(self) -> Values:
        """Values of the smallest rank; among equal ones the first."""
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
            self._places |= new
            self.ranks |= yield wanted

    def _values(self, place: Shares) -> Values:
        return tuple(axis.at(share) for axis, share in zip(self._axes, place, strict=True))

    def _with_each_choice(self, place: Shares) -> list[Shares]:
        """Try every combination of choices at the place; of many, each changed alone."""
        choices = []
        for i, n in enumerate(len(axis.choices) for axis in self._axes):
            choices += [[(i, (k + 0.5) / n) for k in range(n)]] if n else []
        changes: Iterable[tuple[tuple[int, float], ...]] = product(*choices)
        if prod(map(len, choices)) > self._left // 2:
            changes = zip(chain.from_iterable(choices), strict=True)
        shares = dict(enumerate(place))
        return [tuple((shares | dict(change)).values()) for change in changes]

    def _all_over(self, place: Shares) -> list[Shares]:
        """Spread points: multiples of powers of the generalized golden ratio, modulo one."""
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
        while self._left > self._reserved:
            wanted = self._next_corner(place, np.array(corners))
            if wanted is None:
                return
            yield from self._ask([wanted])

    def _next_corner(self, place: Shares, corners: Array) -> Shares | None:
        """Find the next unknown point of the simplex; None if it has converged."""
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
            wanted: Shares = unknown.args[0]
            return wanted
        return None

    def _at(self, place: Shares, numbers: Array) -> Shares:
        """Return the place with other shares of the numeric axes."""
        changed = dict(zip(self._numbers, numbers.tolist(), strict=True))
        return tuple(changed.get(i, share) for i, share in enumerate(place))

    def _look_around(self) -> Asking:
        """Vary each key alone around the best to find its good range."""
        for pair in _AROUND:
            place, places = self._places[self.best], []
            for i, step in product(self._numbers, pair):
                share = min(max(place[i] + step, 0.0), 1.0)
                places.append((*place[:i], share, *place[i + 1 :]))
            yield from self._ask(places)


class _UnknownError(Exception):
    """Request for a place whose rank is unknown."""


HEADER = ["filter", "trial", "key", "value", "objective", "stderr", "lost"]
_DIGITS = 7
_FLAT = 0.9  # share of an axis: what lies within a standard error on so much of it hangs on nothing
_END = 0.005  # share of an axis next to its end
_FAILED = 1 << 30  # as if so many runs were lost: more than any filter loses


class Trial(NamedTuple):
    """Values by key, objective with standard error, lost runs; NaN if the filter failed."""

    values: Mapping[str, Any]
    objective: float
    stderr: float
    lost: int

    @classmethod
    def of(cls, values: Mapping[str, Any], score: RunEstimate | None) -> "Trial":
        """Return the trial of these values; without a score the filter failed."""
        if score is None:
            return cls(values, nan, nan, _FAILED)
        return cls(values, score.value, score.stderr, score.lost)

    def rounded(self) -> "Trial":
        """Return the trial rounded as in tuning.csv."""
        return self._replace(objective=_rounded(self.objective), stderr=_rounded(self.stderr))

    @property
    def rank(self) -> tuple[int, float]:
        """Sort key of trials: fewer lost runs first, then the smaller objective."""
        return self.lost, self.objective if isfinite(self.objective) else inf


@dataclass
class Record:
    """The trials of a filter in their order."""

    axes: tuple[Axis, ...]
    trials: list[Trial] = field(default_factory=list)
    taken: Mapping[str, Any] | None = None
    """values of the tuned filter in the config, where that is known"""
    cpu_s: float = field(default=0.0, compare=False)
    """CPU time of the training runs, s; zero if read back"""

    @property
    def best(self) -> Trial:
        """Trial of the smallest rank; among equal ones the adopted trial, or the first.

        Objectives that differed before rounding may be equal after reading them from the file.
        """
        return min(self.trials, key=lambda trial: (trial.rank, trial.values != self.taken))

    def within(self, axis: Axis) -> list[Any]:
        """Find the range of a key, or the choices, at most one standard error worse.

        The rule of one standard error (Breiman et al. 1984, section 3.4.3). With the other keys at
        their best, the objective is interpolated linearly between trials; any other trial as good
        widens the range. Values outside the trials are left out.
        """
        best = self.best
        limit = best.objective + (best.stderr if isfinite(best.stderr) else 0.0)
        line = [(axis.share(t.values[axis.key]) or 0.0, t) for t in self.beside(axis)]
        good = [t for t in self.trials if t.lost == best.lost and t.objective <= limit]
        if axis.choices:
            accepted = {t.values[axis.key] for t in good}
            return [choice for choice in axis.choices if choice in accepted]
        middle = axis.share(best.values[axis.key]) or 0.0
        below = sorted((-x, t.objective) for x, t in line if x <= middle)
        above = sorted((x, t.objective) for x, t in line if x >= middle)
        shares = [axis.share(t.values[axis.key]) or 0.0 for t in good]
        low = min([*shares, -_reach(below, limit)])
        high = max([*shares, _reach(above, limit)])
        return [axis.at(low), axis.at(high)]

    def beside(self, axis: Axis) -> list[Trial]:
        """Find the trials that differ from the best in at most this key and lose as many runs."""
        best = self.best
        out = []
        for trial in self.trials:
            differing = {a.key for a in self.axes if trial.values[a.key] != best.values[a.key]}
            if differing <= {axis.key} and trial.lost == best.lost:
                out.append(trial)
        return out

    def remarks(self, runs: int) -> Iterator[str]:
        """Yield remarks on lost runs, keys at an end of their range, keys without effect."""
        best = self.best
        if not isfinite(best.objective):
            yield "no value that was tried keeps a single training run"
            return
        number = len(self.trials)
        if self.trials.index(best) >= number - looked_around(self.axes, number):
            yield "the best values came last, looking around: more evaluations may find better ones"
        if best.lost:
            yield f"{best.lost} of {runs} training runs are lost with the best values"
        for axis in (axis for axis in self.axes if not axis.choices):
            value, (low, high) = best.values[axis.key], self.within(axis)
            share, first, last = (axis.share(x) or 0.0 for x in (value, low, high))
            if last - first >= _FLAT:
                yield (
                    f"{axis.key} hardly matters: from {low:g} to {high:g} nothing is more than "
                    "a standard error from the best"
                )
            elif not _END < share < 1.0 - _END:
                side = "lower" if share < 0.5 else "upper"
                yield f"{axis.key} is at its {side} bound, {value:g}: let it go further"


def write_tuning(path: Path, records: Mapping[str, Record]) -> None:
    """Write tuning.csv."""
    rows: list[list[Any]] = []
    for label, record in records.items():
        for n, trial in enumerate(record.trials):
            _, objective, stderr, lost = trial.rounded()
            numbers = [objective, stderr, "" if lost == _FAILED else lost]
            for axis in record.axes:
                rows.append([label, n, axis.key, trial.values[axis.key], *numbers])
    write_csv(path, HEADER, rows)


def read_tuning(
    file: TextIO,
    tune: Mapping[str, Mapping[str, Any]],
    taken: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> dict[str, Record]:
    """Read the records of the filters that a config tunes, by label.

    ``taken`` are the values of these keys that the config's tuned filters have.
    """
    trials: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in csv.DictReader(file):
        trials.setdefault((row["filter"], row["trial"]), []).append(row)
    out = {
        label: Record(tuple(starmap(read_axis, keys.items())), taken=taken.get(label))
        for label, keys in tune.items()
    }
    for (label, _), rows in trials.items():
        values = {row["key"]: scalar(row["value"]) for row in rows}
        objective, stderr = (float(rows[0][name]) for name in ("objective", "stderr"))
        lost = int(rows[0]["lost"]) if rows[0]["lost"] else _FAILED
        out[label].trials.append(Trial(values, objective, stderr, lost))
    return {label: record for label, record in out.items() if record.trials}


def _reach(line: list[tuple[float, float]], limit: float) -> float:
    """Follow a line (share, objective) from its first point as far as it stays below the limit."""
    reached, height = line[0]
    for x, y in line[1:]:
        if not y <= limit:
            share = (limit - height) / (y - height) if isfinite(y) else 0.0
            return reached + (x - reached) * share
        reached, height = x, y
    return reached


def _rounded(x: float) -> float:
    return float(f"{x:.{_DIGITS}g}")
