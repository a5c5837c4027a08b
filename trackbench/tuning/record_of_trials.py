"""Record of tuning, which is tuning.csv: every trial of a filter."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, nan
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TextIO

from trackbench.config.overrides import split_path
from trackbench.config.tuning import tuned_label
from trackbench.config.tuning_axes import Axis, read_axis
from trackbench.csv_writer import write_csv
from trackbench.statistics.estimates import RunEstimate
from trackbench.yaml_scalars import scalar
from trackbench.yaml_source import Source

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

        These numbers are the objective, its standard error and the lost runs, to the digits of
        tuning.csv. If all trials are equal, no key has an effect. Otherwise only the parameters of a
        program are tested, which it need not read: one has no effect if all trials are equal that differ
        in it alone. Any other key is read by the filter, and may have an effect beside other values of
        the rest.
        """
        if len(self.trials) < 2:
            return {}
        if len({_outcome(trial) for trial in self.trials}) == 1:
            return {axis.key: len(self.trials) for axis in self.axes}
        numbers_by_key = {}
        for axis in self.axes:
            if not axis.key.startswith("parameters."):
                continue
            # The trials that agree in all other keys, by the values of these.
            alike: dict[tuple[Any, ...], list[Trial]] = {}
            for trial in self.trials:
                others = tuple(value for key, value in trial.values.items() if key != axis.key)
                alike.setdefault(others, []).append(trial)
            compared = [trials for trials in alike.values() if len(trials) > 1]
            if compared and all(len(set(map(_outcome, trials))) == 1 for trials in compared):
                numbers_by_key[axis.key] = sum(len(trials) for trials in compared)
        return numbers_by_key

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


def _outcome(trial: Trial) -> str:
    """Write the numbers of a trial as tuning.csv has them; a text, since NaN equals no number."""
    return repr(trial.rounded()[1:])


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


def chosen_values(source: Source) -> dict[str, dict[str, Any]]:
    """Return the tuned keys of a resolved config with their values, by the label of the tuned filter.

    The config has the values of the chosen trials in full, and tuning.csv rounds them. They decide which
    one was chosen of several trials whose rounded values are equal.
    """
    config = source.data
    assert isinstance(config, dict)
    values = {}
    for label, keys in config.get("tune", {}).items():
        prefix = f"filters.{tuned_label(label)}"
        values[label] = {key: _value_at(source, f"{prefix}.{key}") for key in keys}
    return values


def _value_at(source: Source, path: str) -> Any:
    """Return the value at a dotted path of the config; None if the config lacks it."""
    value: Any = source.data
    for key in split_path(source, path):
        if not isinstance(value, dict):  # a list: its keys are the items' indices
            value = dict(enumerate(value or ()))
        value = value.get(key)
    return value


def _round_number(number: float) -> float:
    """Round to the digits of tuning.csv."""
    return float(f"{number:.{_DIGITS}g}")
