"""Measures of a results folder: `mean(rmse)`, `rmse@20`, `gain(rms(rmse), PF)`, evaluated.

A measure's error comes as one influence per run where it can, so that a difference between two
filters on common runs is paired and the runs without a batch have a number. Times have none.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trackbench.config.bound_and_exact_errors import exact_label
from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import total
from trackbench.evaluation.metric_expression import Measure, measured
from trackbench.evaluation.run_contributions import statistic_of
from trackbench.field_types import is_number
from trackbench.metrics import in_window
from trackbench.report.tables_and_figures import Results
from trackbench.results.points_json import GridPoint
from trackbench.statistics.cpu_time_ratio import ratio_of_repeats, repeats_of
from trackbench.statistics.efficiency_with_control_variate import efficiency_over_runs
from trackbench.statistics.estimate_of_recording import OfSteps
from trackbench.statistics.estimates import (
    MISSING,
    RunEstimate,
    difference_of_measures,
    estimate_over_runs,
    estimate_share,
    ignore_float_errors,
)
from trackbench.statistics.ratios import gain, quotient
from trackbench.statistics.win_rate import win_rate


class _OverRuns(NamedTuple):
    """A statistic over the runs of a metric of per_run.csv, whose values are first divided."""

    statistic: str
    """statistic over the runs, such as mean"""
    name: str
    """metric of per_run.csv, such as nees"""
    divisor: float = 1.0
    """number of components of the state for ANEES, which is stored as the NEES of each run"""


@dataclass(frozen=True)
class Evaluator:
    """Measures over one results folder at one point of its grid.

    ``Evaluator(results, point).term(measure("mean(rmse)").of("EKF"))`` is a number with its error.
    """

    results: Results
    point: GridPoint
    """values of the grid's paths, one of ``results.points()``"""

    def term(self, m: Measure, common: Mask | bool = True) -> RunEstimate:
        """Return a filter's measure, evaluated.

        Parameters
        ----------
        m
            measure of a filter, such as ``measure("mean(rmse)").of("EKF")``
        common
            mask (M,) of the runs that count; True means all. It has no effect on a number without values
            per run

        Returns
        -------
        RunEstimate
            number with its standard error, in the unit of the measure, and one influence per run (M,)
            where the measure has them. NaN if the results do not have the measure
        """
        if m.relation:  # of this filter's measure to that of another filter
            return self._related(m, m.plain, m.plain.of(m.other), common)
        if m.is_efficiency:
            return self._efficiency(m, common)
        over_runs = self._statistic_over_runs(m)
        # Without values per run only the number over all runs is stored, without influences.
        if over_runs is None:
            if m.steps is None:
                return self._plain(m)
            return self._at_step(m)
        if (m.filter, over_runs.name) not in self.runs:
            # A bound and exact errors have no values per run, but a number in summary.csv.
            if m.filter in self.results.labels_without_runs:
                return self.stored.get((m.filter, str(m)), MISSING)
            return MISSING
        # The divisor turns the NEES into the ANEES; it is 1 for other metrics.
        values = self.runs[m.filter, over_runs.name] / over_runs.divisor
        if not m.is_share:
            return estimate_over_runs(over_runs.statistic, values, self._is_lost(m.filter), common)
        share = estimate_share(values, self._is_lost(m.filter), common)
        # A lost run is an event of the share of lost runs: none is left out of that.
        if m.metric == "lost":
            return share._replace(lost=0)
        return share

    def stored_or_evaluated(self, m: Measure) -> RunEstimate:
        """Return a filter's measure: its row of summary.csv, or without one its evaluation."""
        # A share is evaluated, as its interval needs the number of runs with the event.
        stored = None if m.is_share else self.stored.get((m.filter, str(m)))
        return stored or self.term(m)

    def estimate_of_steps(self, m: Measure) -> OfSteps | None:
        """Return a measure of one recording with what each step adds to it.

        Parameters
        ----------
        m
            measure of a filter

        Returns
        -------
        OfSteps or None
            number with the contributions (T,) of the steps, whose mean it is. None if the results have
            several runs, or if the measure is no mean or rms of a stored series
        """
        key = (m.filter, m.name)
        if not m.is_over_runs or m.statistic not in ("mean", "rms") or key not in self._steps:
            return None
        # Over one run its value is the mean as well as the rms.
        value_of_run = float(self.runs[key][0])
        return OfSteps.from_contributions(value_of_run, self._steps[key])

    @cached_property
    def _steps(self) -> dict[tuple[str, str], Array]:
        """Contribution of each step (T,) of one recorded run to a number, by (filter, metric).

        The mean of the contributions is the number. The mapping is empty if there are several runs.
        """
        if any(len(values) > 1 for values in self.runs.values()):
            return {}
        return self.results.judged_steps(self.point)

    def per_run(self, m: Measure) -> tuple[str, Array] | None:
        """Return the values of the runs from which a measure is computed.

        Parameters
        ----------
        m
            measure of a filter

        Returns
        -------
        tuple of str and array (M,), or None
            name of the statistic, and the values of the runs, NaN where a run is lost. The values of a
            share of runs are 1 in a run with the event and 0 in one without it. None for a measure that
            is no statistic over runs, or not in the results
        """
        over_runs = self._statistic_over_runs(m)
        if over_runs is None or (m.filter, over_runs.name) not in self.runs:
            return None
        # The divisor turns the NEES into the ANEES; it is 1 for other metrics.
        values = self.runs[m.filter, over_runs.name] / over_runs.divisor
        if m.is_share:
            values = np.where(np.isnan(values), np.nan, values > 0)
        return over_runs.statistic, values

    def at_each_step(self, m: Measure) -> list[Measure]:
        """Split a measure of many steps into one for each step at which the filter has a value.

        Parameters
        ----------
        m
            measure of a filter, such as ``rmse@10..20``

        Returns
        -------
        list of Measure
            measures at single steps, in ascending order; ``m`` alone if it is of one step or of none
        """
        if not m.is_many:
            return [m]
        # Steps of the metric's series in per_step.csv.
        per_step = self.results.columns("per_step", self.point)
        series = per_step.where(filter=m.filter, metric=m.metric)
        steps = {int(step) for step in series["step"]}
        # Steps of which per_run.csv has each run's value, under a name such as rmse@20.
        for label, name in self.runs:
            if label == m.filter:
                stored_measure = measured(name)
                if stored_measure.step is not None and stored_measure.metric == m.metric:
                    steps.add(stored_measure.step)
        return m.at_each(sorted(steps))

    @ignore_float_errors
    def difference(
        self, left: Measure, right: Measure, factor: float = 1.0, among: Mask | bool = True
    ) -> RunEstimate:
        """Return the difference of two measures, paired on common runs or on the steps of a recording.

        Parameters
        ----------
        left, right
            measures of a filter each, or of two, such as ``gain(rms(rmse), PF)``. The common runs are
            those that all of these filters have
        factor
            multiple of the right side that is subtracted
        among
            mask (M,) of the runs among which the common runs are; True means all. It has no effect on a
            recording, which has one run

        Returns
        -------
        RunEstimate
            ``left - factor * right`` with its standard error
        """
        left_of_steps = self.estimate_of_steps(left)
        right_of_steps = self.estimate_of_steps(right)
        if left_of_steps is not None and right_of_steps is not None:
            return left_of_steps.minus(right_of_steps, factor)
        common = among & self._common_runs(left, right)
        a = self.term(left, common)
        b = self.term(right, common)
        # Two variances over the runs, neither of them a gain or a ratio to another filter. Their
        # difference is tested by the confidence limits of both, as a variance is far from normal.
        are_variances = all(m.statistic == "variance" and not m.relation for m in (left, right))
        return difference_of_measures(a, b, factor, are_variances)

    def _related(
        self, m: Measure, mine: Measure, other: Measure, among: Mask | bool
    ) -> RunEstimate:
        """Evaluate a relation such as a ratio of one filter's measure, ``mine``, to another's.

        ``m`` is the measure with the relation; ``other`` is the other filter's measure. The runs that
        both filters have count, of those in ``among`` (M,).

        The relations are ``minus``, ``ratio``, ``gain`` (percent below the other filter), ``win_rate``
        (share of the runs in which it is better) and ``controlled`` (with the other filter, of which the
        exact error is known, as a control variate).
        """
        if m.relation == "minus":
            return self.difference(mine, other, among=among)
        if m.relation == "win_rate":
            return self._win_rate(mine, other, among)
        if m.relation == "controlled":
            return self._controlled(mine, other, among)
        # A score is a logarithm: a ratio of two depends on the unit and means nothing.
        if m.definition.is_score:
            return MISSING
        common = among & self._common_runs(mine, other)
        terms = []
        for side in (mine, other):
            term = self.term(side, common)
            # The number of an exact bound has no error of its own.
            if side.filter in self.results.labels_without_runs and np.isnan(term.stderr):
                term = term._replace(stderr=0.0)
            terms.append(term)
        ratio = quotient(*terms)
        if m.is_cpu_time:
            # Both filters are timed in turn in each repeat, so that their times vary together. The ratio
            # of each repeat is more precise. Without repeats the ratio of both times stays.
            ratio = self._paired_times(mine, other) or ratio
        if m.relation == "ratio":
            return ratio
        return gain(ratio)  # how many percent the ratio is below one

    @ignore_float_errors
    def _controlled(self, mine: Measure, other: Measure, among: Mask | bool) -> RunEstimate:
        """Estimate the measure a, ``mine``, with the measure b, ``other``, as a control variate.

        The estimate is a - beta (b - E b) with the exact E b (Hammersley & Handscomb 1964, section 5.5).
        The runs that both have count, of those in ``among`` (M,).
        """
        exact = self.exact(other)
        common = among & self._common_runs(mine, other)
        # Influences are centered on zero, so that sums of their products are covariances.
        a = self.term(mine, common).influences
        b = self.term(other, common).influences
        if exact is None or a is None or b is None:
            return MISSING
        # beta = cov(a, b) / var(b)
        beta = float(total(np.nan_to_num(a * b)) / total(np.nan_to_num(b * b)))
        # The difference is a - beta b, so beta E b is to be added. It is exact and adds no error.
        term = self.difference(mine, other, beta, among)
        return term._replace(value=term.value + beta * exact)

    def exact(self, m: Measure) -> float | None:
        """Return the exact value of a linear filter's measure.

        It is computed from the covariance of the errors, without Monte Carlo runs. The results have it
        as a number of a filter with a label of its own, such as "KF, exact".

        Parameters
        ----------
        m
            measure of the filter at one step or, in summary.csv, over all steps

        Returns
        -------
        float or None
            value in the unit of the measure; None if the results do not have it
        """
        exact_measure = m.of(exact_label(m.filter))
        if m.steps:
            term = self._at_step(exact_measure)
        else:
            term = self.stored.get((exact_measure.filter, str(exact_measure)), MISSING)
        if exact_measure.filter not in self.results.exact or np.isnan(term.value):
            return None
        return term.value

    @cached_property
    def runs(self) -> dict[tuple[str, str], Array]:
        """Values (M,) of the runs by (filter, metric), NaN where a run has none."""
        return self.results.runs(self.point)

    @cached_property
    def stored(self) -> dict[tuple[str, str], RunEstimate]:
        """Rows of summary.csv and CPU times of timing.csv as estimates, by (filter, metric)."""
        estimates = {}
        for row in self.results.columns("summary", self.point).records():
            estimates[row["filter"], row["metric"]] = RunEstimate(
                value=row["value"],
                stderr=row["stderr"],
                influences=None,
                runs=row["runs"],
                lost=row["lost"],
            )
        for row in self.results.columns("timing", self.point).records():
            estimates[row["filter"], "cpu_s_per_run"] = RunEstimate(
                value=row["cpu_s_per_run"],
                stderr=row["stderr"],
                influences=None,
                runs=row["runs"],
            )
        return estimates

    def _paired_times(self, mine: Measure, other: Measure) -> RunEstimate | None:
        """Return the ratio of the CPU times of ``mine`` and ``other``: the median over the repeats.

        None unless both have equally many repeats, at least two.
        """
        rows = self.results.columns("timing", self.point).records()
        repeats = {row["filter"]: repeats_of(row) for row in rows}
        a = repeats.get(mine.filter, np.empty(0))
        b = repeats.get(other.filter, np.empty(0))
        return ratio_of_repeats(a, b)

    def _statistic_over_runs(self, m: Measure) -> _OverRuns | None:
        """Find the metric of per_run.csv and the statistic over its values that make the measure.

        None if per_run.csv has no such values, as for CPU times.
        """
        # Case 1: a statistic of a metric, such as mean(rmse). Of a metric at a step, such as
        # mean(rmse@20), per_run.csv has values only if the config asks for them; without values the
        # number is read from per_step.csv.
        if m.is_over_runs and (m.steps is None or (m.filter, m.name) in self.runs):
            return _OverRuns(statistic=m.statistic, name=m.name)
        # Case 2: a metric with a statistic of its own, of which each run has a value.
        own_statistic = statistic_of(m)
        if own_statistic and (m.filter, str(m)) in self.runs:
            return _OverRuns(statistic=own_statistic, name=str(m))
        # Case 3: ANEES, which is the mean of each run's NEES over the number of components. It is named
        # alone, without statistic and step (`is_row`).
        nees = in_window(m.base, m.window)
        if m.is_row and m.definition.per_component and (m.filter, nees) in self.runs:
            mean_nees = self.stored.get((m.filter, f"mean({nees})"))
            anees = self.stored.get((m.filter, str(m)))
            # The mean NEES divided by ANEES is the number of components, if both are usable.
            if mean_nees is not None and anees is not None and 0.0 < anees.value < np.inf:
                components = round(mean_nees.value / anees.value)
                return _OverRuns(statistic="mean", name=nees, divisor=components)
        return None

    def _common_runs(self, *sides: Measure) -> Mask | bool:
        """Return a mask (M,) of the runs that have a value of every side's measure.

        It is True, for all runs, if no side has values per run.
        """
        common: Mask | bool = True
        for side in sides:
            # A side that relates two filters needs both of them.
            measures = [side]
            if side.other:
                measures = [side.plain, side.plain.of(side.other)]
            for m in measures:
                values = self._values_of(m)
                if values is not None:
                    common = common & ~np.isnan(values)
        return common

    def _values_of(self, m: Measure) -> Array | None:
        """Return values (M,) that are NaN in the runs without a value of the measure.

        Only where they are NaN counts: an efficiency has no value in a single run. None if the measure
        is not made of values per run.
        """
        if m.is_efficiency:
            floor, distance = self.reference_and_rmsd(m)
            if floor is None or distance is None:
                return None
            return floor + distance  # NaN if either is NaN
        over_runs = self._statistic_over_runs(m)
        # There is no statistic in a share of won runs, as win_rate(rmse, PF), which compares the values
        # of the metric itself.
        name = over_runs.name if over_runs else str(m)
        return self.runs.get((m.filter, name))

    @ignore_float_errors
    def _win_rate(self, mine: Measure, other: Measure, among: Mask | bool) -> RunEstimate:
        """Estimate the share of the common runs in which a filter's metric is better than another's.

        `win_rate` says which value is better. Only runs in ``among`` (M,) count.
        """
        a = self.runs.get((mine.filter, str(mine)))
        b = self.runs.get((other.filter, str(other)))
        if a is None or b is None:
            return MISSING
        return win_rate(a, b, mine.definition.better, self._is_lost(mine.filter), among)

    def _is_lost(self, label: str) -> Mask | None:
        """Return a mask (M,) of the runs that the filter ``label`` lost; None if it is not stored."""
        # The metric ``lost`` is the code of the reason, and 0 in a run that is kept.
        codes = self.runs.get((label, "lost"))
        return None if codes is None else codes > 0

    def _efficiency(self, m: Measure, common: Mask | bool) -> RunEstimate:
        """Estimate the efficiency over the runs that neither the filter nor the reference lost.

        Only runs in ``common`` (M,) count.
        """
        # In each run the RMSE of the reference, and the RMS difference of the filter from it.
        floor, distance = self.reference_and_rmsd(m)
        if floor is None or distance is None:
            return MISSING
        return efficiency_over_runs(floor, distance, common)

    def reference_and_rmsd(self, m: Measure) -> tuple[Array | None, Array | None]:
        """Return each run's RMSE of the reference, and its RMS difference of the filter from it.

        Parameters
        ----------
        m
            efficiency of a filter

        Returns
        -------
        floor : array (M,) or None
            RMSE of the reference
        distance : array (M,) or None
            RMS difference of the filter's estimates from those of the reference, in the unit of the
            RMSE; zero for the reference itself

            Both are NaN in lost runs, and None if the results lack them.
        """
        rmse, distance = m.made_of()
        reference = self.results.config.get("reference")
        floor = self.runs.get((str(reference), str(rmse)))
        if m.filter == reference and floor is not None:
            return floor, 0.0 * floor  # NaN stays in lost runs
        return floor, self.runs.get((m.filter, str(distance)))

    def _at_step(self, m: Measure) -> RunEstimate:
        """Read a measure at its step, or at the last step if it names none, from per_step.csv."""
        series = str(m._replace(steps=None))
        step = m.steps.first if m.steps else "last"
        per_step = self.results.columns("per_step", self.point)
        rows = per_step.where(filter=m.filter, metric=series)
        if not len(rows):
            return MISSING
        number = rows["step"].max() if step == "last" else int(step)
        rows = rows.where(step=number)
        if not len(rows):
            return MISSING
        row = next(rows.records())
        return RunEstimate(
            value=float(row["value"]),
            stderr=float(row["stderr"]),
            influences=None,
            runs=int(row["runs"]),
        )

    def _plain(self, m: Measure) -> RunEstimate:
        """Read a row of summary.csv or timing.csv, or a number that the config gives the filter.

        A number of the config, such as the number of particles, has no error.
        """
        label = m.filter
        name = str(m)
        if (label, name) in self.stored:
            return self.stored[label, name]
        if label not in self.results.filters:
            return MISSING
        number = self.results.facts(self.point).filters[label].get(name)
        if not is_number(number):
            return MISSING
        return RunEstimate(value=float(number), stderr=0.0, influences=None, runs=1)

    def values(self, m: Measure) -> Array | None:
        """Return the values that a statistic over runs is computed from, without lost runs.

        Parameters
        ----------
        m
            measure of a filter, such as ``measure("mean(rmse)").of("EKF")``

        Returns
        -------
        array (M',) or None
            values of the M' runs that are not lost, some of which may be infinite. None for a measure
            that is no statistic over runs, or not in the results
        """
        if not m.is_over_runs:
            return None
        values = self.runs.get((m.filter, m.name))
        if values is None:
            return None
        return values[~np.isnan(values)]
