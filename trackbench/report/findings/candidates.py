"""Filters to be ranked: each with the values that the grid gives it, and its number in every run."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.filter_setting_labels import own_values, setting_text
from trackbench.report.findings.phrases import named
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.comparison import Sample
from trackbench.statistics.sample_statistics import Estimate


@dataclass(frozen=True, eq=False)
class Candidate:
    """A filter with the values that the grid gives it, and the point at which it has them."""

    label: str
    point: GridPoint
    """first point of the grid with these values at which the filter did not fail"""
    lost: Array
    """why each run (M,) is lost, 0 if it is not"""
    sample: Sample
    """the metric of each run (M,), NaN where it is lost, and the statistic that decides"""
    varied: GridPoint = field(default_factory=dict)
    """values that the grid gives the filter, by path"""

    @cached_property
    def name(self) -> str:
        """Name for a sentence, with the grid's values."""
        if not self.varied:
            return named(self.label)
        return f"{named(self.label)} at {self.setting}"

    @property
    def setting(self) -> str:
        """Grid's values; several in parentheses."""
        return setting_text(self.varied)

    @cached_property
    def overall(self) -> Estimate:
        """Statistic over the runs that are not lost."""
        return self.sample.overall.estimate

    def has_error(self, untested: bool) -> bool:
        """Return whether the filter has enough runs for a standard error of its number.

        Two runs are enough if ``untested``, that is if no difference is tested. Otherwise there must be
        enough runs for a test. The one run of a recording is enough, as it is compared step by step.
        """
        needed_runs = 2 if untested else rules.FEWEST_RUNS
        runs = np.isfinite(self.sample.values).sum()
        return self.sample.steps is not None or runs >= needed_runs

    @cached_property
    def losses(self) -> int:
        """Number of runs that are lost."""
        return int(np.count_nonzero(self.lost))


def candidates_of(
    results: Results, points: Sequence[GridPoint], metric: str, statistic: str
) -> Iterator[Candidate]:
    """Yield each filter once with each set of values that the grid gives it at any of the ``points``.

    Its sample has the values of the ``metric`` per run, compared by their ``statistic``. For the only
    run of a recording it also has what each step adds to the value: filters are then compared by steps.
    """
    for label in results.filters:
        known_values = set()
        for point in points:
            runs = results.runs(point)
            varied = own_values(results, point, label)
            # Each set of values counts once, at the first point that has it and at which the filter did
            # not fail.
            if str(varied) in known_values or (label, "lost") not in runs:
                continue
            known_values.add(str(varied))
            lost = runs[label, "lost"]
            values = runs.get((label, metric), np.full(len(lost), np.nan))
            # What each step (T,) adds to the metric; None unless the results are of one recorded run.
            steps = results.judged_steps(point).get((label, metric))
            yield Candidate(
                label=label,
                point=point,
                lost=lost,
                sample=Sample.from_values(values, statistic, steps),
                varied=varied,
            )
