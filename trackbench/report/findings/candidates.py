"""Filters to be ranked: each with its values of the grid and its number in every run; which are out."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import isfinite

import numpy as np

from trackbench.core.arrays import Array
from trackbench.evaluation.metric_expression import Measure
from trackbench.report.expressions import Evaluator
from trackbench.report.filter_setting_labels import own_values, setting_text
from trackbench.report.findings.phrases import named
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics import significance_rules as rules
from trackbench.statistics.comparison import Sample
from trackbench.statistics.sample_statistics import STATISTICS, Estimate


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


def sort_key(candidate: Candidate, sign: float) -> tuple[bool, float]:
    """Return a key that sorts the best value first, candidates without a finite value last.

    ``sign`` is -1 if more is better, else 1.
    """
    value = candidate.overall.value
    if not isfinite(value):
        return True, 0.0
    return False, sign * value


def best_setting_of_each(candidates: Sequence[Candidate], sign: float) -> list[Candidate]:
    """Choose for each filter the setting with the best number.

    A candidate is a filter with one setting, the values that the grid gives its keys. ``sign`` is -1 if
    a larger number is better, else 1.
    """
    best = []
    for label in dict.fromkeys(c.label for c in candidates):
        settings = [c for c in candidates if c.label == label]
        # A setting is out if the filter loses significantly more runs with it than with another one.
        losing = losing_candidates(settings)
        eligible = [c for c in settings if c not in losing] or settings
        best.append(min(eligible, key=lambda c: sort_key(c, sign)))
    return best


def losing_candidates(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Find the candidates that lose significantly more of the same runs than another candidate."""
    losing = []
    for a in candidates:
        if not a.losses:
            continue
        lost_by_others = (b.lost for b in candidates if b is not a and len(b.lost) == len(a.lost))
        if any(rules.loses_more(a.lost, lost, len(candidates)) for lost in lost_by_others):
            losing.append(a)
    return losing


def candidate_of(evaluator: Evaluator, m: Measure) -> Candidate | None:
    """Return a measure's filter with the values of its runs, to be ranked.

    None if the runs have no values, or if filters are not ranked by the statistic.
    """
    column = evaluator.per_run(m)
    if column is None:
        return None
    statistic, values = column  # of the M runs
    if statistic not in STATISTICS:
        return None
    return Candidate(
        label=m.filter,
        point=evaluator.point,
        lost=evaluator.runs.get((m.filter, "lost"), np.zeros(len(values))),
        # For the one run of a recording ``steps`` is the measure with the contribution of each step, by
        # which filters are compared. It is None for several runs.
        sample=Sample(values, statistic, steps=evaluator.estimate_of_steps(m)),
    )
