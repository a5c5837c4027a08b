"""Search of a filter's keys: spread points, a Nelder-Mead simplex, then neighbors; its record.

The search depends on the ranks of trials only, so its result is the same for any number of
workers. Nelder and Mead's simplex compares ranks without computing with them: lost runs and
objectives made rough by particles do not mislead it. docs/tuning.md explains the choice. The record is
tuning.csv: every trial, a row per key, and conclusions about the keys.
"""

import csv
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
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
    """Return the part of the budget that is reserved for the neighbors of the best trial.

    It is at most a third, so that a small budget is spent on the search itself.
    """
    numeric_axes = sum(not axis.choices for axis in axes)
    return min(2 * len(_NEIGHBOR_STEPS) * numeric_axes, budget // 3)


class Search:
    """Search of at most ``budget`` values of the axes that begins at the shares ``start``."""

    def __init__(self, axes: Sequence[Axis], start: Shares, budget: int) -> None:
        """Begin at the shares ``start`` of the axes; ``budget`` is the largest number of trials."""
        self.ranks: dict[Values, Rank] = {}
        self._axes = axes
        self._start = start
        self._remaining_budget = budget
        self._places: dict[Values, Shares] = {}
        self._numeric_axes = [i for i, axis in enumerate(axes) if not axis.choices]
        self._reserved_budget = neighbor_budget(axes, budget)

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
        """Yield the values at these places without a rank, within the budget; store their ranks."""
        new_places: dict[Values, Shares] = {}
        for place in places:
            values = self._values_at(place)
            if values not in self.ranks:
                new_places.setdefault(values, place)
        requested = list(new_places)[: self._remaining_budget]
        if requested:
            self._remaining_budget -= len(requested)
            self._places |= new_places
            self.ranks |= yield requested

    def _values_at(self, place: Shares) -> Values:
        return tuple(axis.at(share) for axis, share in zip(self._axes, place, strict=True))

    def _with_each_choice(self, place: Shares) -> list[Shares]:
        """Return the place with every combination of choices.

        If these are more than half of the budget, only one choice at a time is changed.
        """
        # Step 1: the shares of each axis of choices, at the middle of each choice.
        choice_axes = [i for i, axis in enumerate(self._axes) if axis.choices]
        choice_shares = []
        for i in choice_axes:
            n = len(self._axes[i].choices)
            choice_shares.append([(k + 0.5) / n for k in range(n)])
        # Step 2: every combination, or one axis at a time.
        changes: list[dict[int, float]] = []
        if prod(len(shares) for shares in choice_shares) <= self._remaining_budget // 2:
            for combination in product(*choice_shares):
                changes.append(dict(zip(choice_axes, combination, strict=True)))
        else:
            for i, shares in zip(choice_axes, choice_shares, strict=True):
                changes += [{i: share} for share in shares]
        return [_with_shares(place, change) for change in changes]

    def _spread_places(self, place: Shares) -> list[Shares]:
        """Return the place with spread shares of the numeric axes.

        With d such axes and the generalized golden ratio g, the n-th place has the share 0.5 + n / g^j,
        modulo one, on the j-th of them.
        """
        d = len(self._numeric_axes)
        steps = np.cumprod(np.full(d, 1.0 / _GOLDEN_RATIOS[d - 1]))
        places = []
        for n in range(1, _SPREAD_POINTS * d + 1):
            places.append(self._with_numbers(place, (0.5 + n * steps) % 1.0))
        return places

    def _run_simplex(self, place: Shares) -> Requests:
        """Run Nelder and Mead's simplex over the numeric axes, beginning at ``place``.

        After each new rank the simplex is repeated from its first corner with the known ranks.
        """
        # Step 1: the corners of the first simplex: the place, and one along each axis.
        first_corner = np.array([place[i] for i in self._numeric_axes])
        corners = [first_corner]
        for n, i in enumerate(self._numeric_axes):
            corner = first_corner.copy()
            step = max(_SIMPLEX_STEP, self._axes[i].grain)
            if corner[n] < 0.5:
                corner[n] += step
            else:
                corner[n] -= step
            corners.append(corner)
        yield from self._request([self._with_numbers(place, corner) for corner in corners])
        # Step 2: one point after the other.
        while self._remaining_budget > self._reserved_budget:
            next_place = self._next_simplex_place(place, np.array(corners))
            if next_place is None:
                return
            yield from self._request([next_place])

    def _next_simplex_place(self, place: Shares, corners: Array) -> Shares | None:
        """Find the first point of the simplex whose rank is unknown; None if the simplex has converged.

        ``place`` has the shares of the choices, ``corners`` those of the numbers at the first corners.
        """
        from scipy.optimize import minimize

        def rank(numbers: Array) -> float:
            """Return the rank of these shares of the numeric axes as one number; raises if unknown."""
            place_of_numbers = self._with_numbers(place, numbers)
            values = self._values_at(place_of_numbers)
            if values not in self.ranks:
                raise _UnknownRankError(place_of_numbers)
            lost, objective = self.ranks[values]
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
        """Return the place with other shares of the numeric axes."""
        return _with_shares(place, dict(zip(self._numeric_axes, numbers.tolist(), strict=True)))

    def _vary_best(self) -> Requests:
        """Try the neighbors of the best trial in each key alone, which show the key's good range."""
        for steps in _NEIGHBOR_STEPS:
            place = self._places[self.best]
            neighbors = []
            for i, step in product(self._numeric_axes, steps):
                share = min(max(place[i] + step, 0.0), 1.0)
                neighbors.append(_with_shares(place, {i: share}))
            yield from self._request(neighbors)


def _with_shares(place: Shares, changes: Mapping[int, float]) -> Shares:
    """Return a place with other shares of some axes, by the axes' numbers."""
    return tuple(changes.get(i, share) for i, share in enumerate(place))


class _UnknownRankError(Exception):
    """Request for a place whose rank is unknown."""

    def __init__(self, place: Shares) -> None:
        super().__init__(place)
        self.place = place


HEADER = ["filter", "trial", "key", "value", "objective", "stderr", "lost"]
_DIGITS = 7
_FLAT = 0.9  # share of an axis: a key that is good on so much of it hardly matters
_END = 0.005  # share of an axis next to its end
_FAILED = 1 << 30  # number of lost runs of a failed filter: more than any filter loses


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
        return self._replace(
            objective=_round_number(self.objective), stderr=_round_number(self.stderr)
        )

    @property
    def rank(self) -> tuple[int, float]:
        """Sort key of trials: fewer lost runs first, then the smaller objective."""
        if not isfinite(self.objective):
            return self.lost, inf
        return self.lost, self.objective


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
        """Trial of the smallest rank; among equal ones the one that the config took, or the first.

        Objectives that differ may be equal after they were rounded in the file.
        """
        return min(self.trials, key=lambda trial: (trial.rank, trial.values != self.taken))

    def within(self, axis: Axis) -> list[Any]:
        """Find the choices, or the ends of the range, of a key that are at most a standard error worse.

        This is the rule of one standard error (Breiman et al. 1984, section 3.4.3). Between trials that
        have the best values of the other keys, the objective is interpolated linearly. Any other trial
        that is good enough widens the range. The range does not go beyond the trials.
        """
        # Step 1: the trials that are good enough.
        best = self.best
        limit = best.objective
        if isfinite(best.stderr):
            limit += best.stderr
        good = [t for t in self.trials if t.lost == best.lost and t.objective <= limit]
        if axis.choices:
            good_choices = {trial.values[axis.key] for trial in good}
            return [choice for choice in axis.choices if choice in good_choices]

        def share_of(trial: Trial) -> float:
            # Each value that was tried lies on its axis, so that it has a share.
            return axis.share(trial.values[axis.key]) or 0.0

        # Step 2: follow the axis from the best to both sides, as far as the objective stays good.
        # Shares below the best have a minus sign, so that they increase away from the best, too.
        best_share = share_of(best)
        below = []
        above = []
        for trial in self.beside(axis):
            share = share_of(trial)
            if share <= best_share:
                below.append((-share, trial.objective))
            if share >= best_share:
                above.append((share, trial.objective))
        low = -_follow_while_good(sorted(below), limit)
        high = _follow_while_good(sorted(above), limit)
        # Step 3: other good trials widen the range.
        good_shares = [share_of(trial) for trial in good]
        low = min([*good_shares, low])
        high = max([*good_shares, high])
        return [axis.at(low), axis.at(high)]

    def beside(self, axis: Axis) -> list[Trial]:
        """Find the trials that differ from the best in at most this key and lose as many runs."""
        best = self.best
        trials = []
        for trial in self.trials:
            differing = {a.key for a in self.axes if trial.values[a.key] != best.values[a.key]}
            if differing <= {axis.key} and trial.lost == best.lost:
                trials.append(trial)
        return trials

    def remarks(self, runs: int) -> Iterator[str]:
        """Yield remarks on lost runs, keys at an end of their range, keys without effect."""
        best = self.best
        if not isfinite(best.objective):
            if best.lost:
                yield "no value that was tried keeps a single training run"
            else:
                yield "the metric of tuning has no value in training, so nothing was tuned"
            return
        number = len(self.trials)
        # The last trials are those around the best values.
        if self.trials.index(best) >= number - neighbor_budget(self.axes, number):
            yield "the best values came last, looking around: more evaluations may find better ones"
        if best.lost:
            yield f"{best.lost} of {runs} training runs are lost with the best values"
        for axis in self.axes:
            if axis.choices:
                continue
            value = best.values[axis.key]
            low, high = self.within(axis)
            share = axis.share(value) or 0.0
            low_share = axis.share(low) or 0.0
            high_share = axis.share(high) or 0.0
            if high_share - low_share >= _FLAT:
                yield (
                    f"{axis.key} hardly matters: from {low:g} to {high:g} nothing is more than "
                    "a standard error from the best"
                )
            elif not _END < share < 1.0 - _END:
                side = "lower" if share < 0.5 else "upper"
                yield f"{axis.key} is at its {side} bound, {value:g}: let it go further"


def write_tuning(path: Path, records: Mapping[str, Record]) -> None:
    """Write the ``records`` of filters, given by label, to tuning.csv: a row for each key of a trial."""
    rows: list[list[Any]] = []
    for label, record in records.items():
        for n, trial in enumerate(record.trials):
            rounded = trial.rounded()
            lost = "" if trial.lost == _FAILED else trial.lost
            for axis in record.axes:
                value = trial.values[axis.key]
                rows.append([label, n, axis.key, value, rounded.objective, rounded.stderr, lost])
    write_csv(path, HEADER, rows)


def read_tuning(
    file: TextIO,
    tune: Mapping[str, Mapping[str, Any]],
    taken: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> dict[str, Record]:
    """Read the records of the filters that a config tunes, by label.

    ``tune`` has the keys to tune by label, as the config writes them. ``taken`` are the values of these
    keys that the tuned filters of the config have.
    """
    # Step 1: the rows of each trial, one for each key.
    rows_by_trial: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in csv.DictReader(file):
        rows_by_trial.setdefault((row["filter"], row["trial"]), []).append(row)
    # Step 2: a record for each filter, with its trials.
    records = {}
    for label, keys in tune.items():
        axes = tuple(read_axis(key, written) for key, written in keys.items())
        records[label] = Record(axes=axes, taken=taken.get(label))
    for (label, _), rows in rows_by_trial.items():
        numbers = rows[0]  # all rows of a trial have the same objective
        trial = Trial(
            values={row["key"]: scalar(row["value"]) for row in rows},
            objective=float(numbers["objective"]),
            stderr=float(numbers["stderr"]),
            lost=int(numbers["lost"]) if numbers["lost"] else _FAILED,
        )
        records[label].trials.append(trial)
    return {label: record for label, record in records.items() if record.trials}


def _follow_while_good(line: list[tuple[float, float]], limit: float) -> float:
    """Return the share at which a line of points (share, objective) first reaches the limit.

    The line is interpolated linearly between its points. If it stays below the limit, the last share is
    returned.
    """
    (share, objective), *others = line
    for next_share, next_objective in others:
        if not next_objective <= limit:  # NaN, of a failed filter, is not good either
            fraction = 0.0
            if isfinite(next_objective):
                fraction = (limit - objective) / (next_objective - objective)
            return share + (next_share - share) * fraction
        share = next_share
        objective = next_objective
    return share


def _round_number(number: float) -> float:
    """Round to the digits of tuning.csv."""
    return float(f"{number:.{_DIGITS}g}")
