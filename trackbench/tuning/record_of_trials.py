"""Record of tuning, which is tuning.csv: every trial of a filter, and the good range of each key."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TextIO

from trackbench.config.tuned_values import Axis, read_axis
from trackbench.csv_writer import write_csv
from trackbench.statistics.estimates import RunEstimate
from trackbench.yaml_scalars import scalar

HEADER = ["filter", "trial", "key", "value", "objective", "stderr", "lost"]
_DIGITS = 7
_FAILED = 1 << 30  # number of lost runs of a failed filter: more than any filter loses


class Trial(NamedTuple):
    """Values by key, objective with standard error, lost runs.

    If the filter failed, objective and standard error are NaN, and ``lost`` is `_FAILED`.
    """

    values: Mapping[str, Any]
    objective: float
    stderr: float
    lost: int

    @classmethod
    def of(cls, values: Mapping[str, Any], score: RunEstimate | None) -> "Trial":
        """Return the trial of these values, given by key; without a score the filter failed.

        The score is the objective over the training runs with its standard error and lost runs.
        """
        if score is None:
            return cls(values, nan, nan, _FAILED)
        return cls(values, score.value, score.stderr, score.lost)

    def rounded(self) -> "Trial":
        """Return the trial with the objective and its standard error rounded as in tuning.csv."""
        return self._replace(
            objective=_round_number(self.objective), stderr=_round_number(self.stderr)
        )

    @property
    def has_failed(self) -> bool:
        """True if the filter failed in a run: then it has no objective, and no number of lost runs."""
        return self.lost == _FAILED

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
    first_failure: str = field(default="", compare=False)
    """reason why the first failed trial failed; empty if none has, or if it is unknown"""
    cpu_s: float = field(default=0.0, compare=False)
    """CPU time of the training runs, s; zero if read back"""

    @property
    def best(self) -> Trial:
        """Trial of the smallest rank; among equal ones the one that the config took, or the first.

        Objectives that differ may be equal after they were rounded in the file.
        """
        return min(self.trials, key=lambda trial: (trial.rank, trial.values != self.taken))

    @property
    def failed_trials(self) -> list[Trial]:
        """Trials whose filter failed, in their order."""
        return [trial for trial in self.trials if trial.has_failed]

    @property
    def keys_without_effect(self) -> dict[str, int]:
        """Number of values that were tried of each key on which the numbers of no trial depend.

        Trials are compared that differ in this key alone. Their objective, its standard error and their
        lost runs are equal to the digits of tuning.csv.
        """
        numbers_by_key = {}
        for axis in self.axes:
            # The trials that agree in all other keys, by the values of these.
            alike: dict[tuple[Any, ...], list[Trial]] = {}
            for trial in self.trials:
                others = tuple(value for key, value in trial.values.items() if key != axis.key)
                alike.setdefault(others, []).append(trial.rounded())
            compared = [trials for trials in alike.values() if len(trials) > 1]
            # As texts, since NaN equals no number.
            outcomes = [{repr(trial[1:]) for trial in trials} for trials in compared]
            if compared and all(len(different) == 1 for different in outcomes):
                numbers_by_key[axis.key] = sum(len(trials) for trials in compared)
        return numbers_by_key

    def values_within_stderr(self, axis: Axis) -> list[Any]:
        """Find the values of a key at which the objective is at most a standard error above the best.

        For a key with choices these are the good choices, otherwise both ends of the good range. This is
        the rule of one standard error (Breiman et al. 1984, section 3.4.3). Between trials that have the
        best values of the other keys, the objective is interpolated linearly. Any other trial that is
        good enough widens the range. The range does not go beyond the trials.
        """
        # Step 1: the trials that are good enough. A smaller objective is better.
        best = self.best
        limit = best.objective
        if isfinite(best.stderr):
            limit += best.stderr
        good = [t for t in self.trials if t.lost == best.lost and t.objective <= limit]
        if axis.choices:
            good_choices = {trial.values[axis.key] for trial in good}
            return [choice for choice in axis.choices if choice in good_choices]

        def share_of(trial: Trial) -> float:
            """Return the place of a trial on the axis, from 0 at its low end to 1 at its high end."""
            # Each value that was tried lies on its axis, so that it has a share.
            return axis.share(trial.values[axis.key]) or 0.0

        # Step 2: follow the axis from the best to both sides, as far as the objective stays good.
        # Shares below the best have a minus sign, so that they increase away from the best, too.
        best_share = share_of(best)
        below = []
        above = []
        for trial in self.trials_along(axis):
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

    def trials_along(self, axis: Axis) -> list[Trial]:
        """Find the trials that differ from the best in at most this key and lose as many runs.

        The best trial itself is among them.
        """
        best = self.best
        trials = []
        for trial in self.trials:
            differing = {a.key for a in self.axes if trial.values[a.key] != best.values[a.key]}
            if differing <= {axis.key} and trial.lost == best.lost:
                trials.append(trial)
        return trials


def write_tuning(path: Path, records: Mapping[str, Record]) -> None:
    """Write the ``records`` of filters, given by label, to tuning.csv: a row for each key of a trial."""
    rows: list[list[Any]] = []
    for label, record in records.items():
        for n, trial in enumerate(record.trials):
            rounded = trial.rounded()
            # A failed filter has no number of lost runs: its cell is empty.
            lost = "" if trial.has_failed else trial.lost
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

    A share is a place on a key's axis. The points are sorted by it, and the objective of the first one
    is within the limit. The line is interpolated linearly between its points. If it stays below the
    limit, the last share is returned.
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
