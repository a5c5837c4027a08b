"""What a sweep found: its metrics over the swept paths, one tidy table, the best points."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.measure import measured
from trackbench.evaluation.statistics import paired_difference, relative_gain
from trackbench.experiment.files import write_csv
from trackbench.experiment.reading.points import single_paths
from trackbench.report import style
from trackbench.report.results import Results

if TYPE_CHECKING:
    import pandas as pd

Values: TypeAlias = tuple[Any, ...]
"""The values of the swept paths at one point, in their order."""


class SweepScore(NamedTuple):
    """A filter's metric at one point."""

    point: Values
    value: float
    stderr: float


@dataclass(frozen=True)
class Sweep:
    """A results folder whose experiment has a grid."""

    results: Results

    @property
    def paths(self) -> list[str]:
        """The swept paths."""
        return self.results.grid

    @cached_property
    def rows(self) -> "pd.DataFrame":
        """One statistic of each metric: rms of errors, ANEES, mean of the rest."""
        frame = self.results.summary
        wanted = frame["metric"].map(_is_headline).astype(bool)  # also without rows
        return frame[wanted].reset_index(drop=True)

    @property
    def metrics(self) -> list[str]:
        """The metrics, the error first."""
        return list(dict.fromkeys(self.rows["metric"]))

    @cached_property
    def varying(self) -> list[str]:
        """Filters with a path of their own in the grid; all of them if only the scenario varies."""
        own = [
            label
            for label in self.results.labels
            if any(
                single.startswith(f"filters.{label}.")
                for path in self.paths
                for single in single_paths(path)
            )
        ]
        return own or self.results.labels

    def axis(self, path: str) -> list[Any]:
        """The values of a path in the grid's order."""
        return list(dict.fromkeys(self.rows[path]))

    def scores(self, label: str, metric: str) -> list[SweepScore]:
        """The metric of a filter at every point that has it."""
        chosen = (self.rows["filter"] == label) & (self.rows["metric"] == metric)
        columns = [*self.paths, "value", "stderr"]
        return [
            SweepScore(tuple(row[:-2]), row[-2], row[-1])
            for row in self.rows.loc[chosen, columns].itertuples(index=False, name=None)
        ]

    def per_run(self, label: str, metric: str, point: Values) -> Array:
        """Values of every run (M,) of a metric of per_run.csv."""
        return self.results.runs(dict(zip(self.paths, point, strict=True)))[label, metric]


class Best(NamedTuple):
    """A filter's best point, its value there, and how far the next best one is behind."""

    filter: str
    point: dict[str, Any]
    """the swept paths and their values"""
    metric: str
    value: float
    stderr: float
    next: dict[str, Any]
    """the next best point"""
    gain: float
    """share of the next best point's mean that is saved on common runs; of a score the difference"""
    gain_stderr: float

    @property
    def differs(self) -> bool:
        """Whether the gain is more than two standard errors."""
        return self.gain > 2 * self.gain_stderr

    def __str__(self) -> str:
        found = f"{self.metric} {self.value:.4g} ± {self.stderr:.2g}"
        if measured(self.metric).family[0].is_score:
            gain = f"{self.gain:.2g} ± {self.gain_stderr:.2g} above"
        else:
            gain = f"{100 * self.gain:.2g} ± {100 * self.gain_stderr:.2g} % below"
        text = f"{self.filter} at {_at(self.point)}: {found}, {gain} {_at(self.next)}"
        return text if self.differs else f"{text}, which is no difference"


def write_sweep(sweep: Sweep) -> None:
    """Write ``sweep.csv``."""
    rows = sweep.rows
    write_csv(sweep.results.target / "sweep.csv", list(rows.columns), rows.to_numpy().tolist())


def best_points(sweep: Sweep) -> Iterator[Best]:
    """The point with the smallest error of each filter that varies, in each scenario.

    Without a truth that with the highest log score, if there is one, held out or not. Points of a filter
    share their data and noise, so their difference is taken run by run.
    """
    if not sweep.metrics:  # every filter failed
        return
    metric, told = sweep.metrics[0], ("mean(held_log_score)", "mean(log_score)")
    if not any(measured(name).is_error for name in sweep.metrics):
        metric = next((name for name in told if name in sweep.metrics), metric)
    fixed = [i for i, path in enumerate(sweep.paths) if path.startswith("scenario.")]
    for label in sweep.varying:
        groups: dict[Values, list[SweepScore]] = {}
        for score in sweep.scores(label, metric):
            if np.isfinite(score.value):
                groups.setdefault(tuple(score.point[i] for i in fixed), []).append(score)
        for scores in groups.values():
            if len(scores) > 1:
                sign = -1.0 if measured(metric).family[0].more_is_better else 1.0
                ranked = sorted(scores, key=lambda s: sign * s.value)
                yield _best(sweep, label, metric, ranked)


def _best(sweep: Sweep, label: str, metric: str, ranked: list[SweepScore]) -> Best:
    first, second = ranked[:2]
    a, b = (sweep.per_run(label, measured(metric).name, s.point) for s in (first, second))
    both = np.isfinite(a) & np.isfinite(b)
    ahead = paired_difference if measured(metric).family[0].is_score else relative_gain
    points = [dict(zip(sweep.paths, s.point, strict=True)) for s in (first, second)]
    gain = ahead(a[both], b[both])
    return Best(label, points[0], metric, first.value, first.stderr, points[1], *gain)


def _at(point: dict[str, Any]) -> str:
    return ", ".join(f"{style.name(path)} = {value}" for path, value in point.items())


def _is_headline(metric: str) -> bool:
    m = measured(metric)
    if m.family[0].over_steps == "rms":
        return m.statistic == "rms"
    return m.family[0].per_component or (m.statistic == "mean" and m.family[0].name != "nees")
