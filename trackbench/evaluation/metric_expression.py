"""Expressions of measured numbers, such as ``mean(rmse_position)[turn]``, and their parser.

=============================  ==================================================================
``mean(rmse[turns])``          a statistic over the runs of a metric, here over a window of steps
``rmse@20``, ``rmse@last``     a metric at a step
``rmse@3..last``               at each of these steps
``efficiency``                 the reference's RMSE over the filter's, from its distance to it
``anees``, ``cpu_s_per_run``   a number of that name in summary.csv or timing.csv; a filter's key
``gain(mean(rmse), PF)``       percent below the filter PF; ``ratio`` to it, ``minus`` it
``win_rate(rmse, PF)``         share of the runs in which the metric is better than PF's
``controlled(rms(rmse), KF)``  with KF, of which the exact error is known, as control variate
=============================  ==================================================================
"""

import re
from collections.abc import Iterable
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias, cast

from trackbench.metrics import (
    Metric,
    in_window,
    is_of_prediction,
    joined,
    metric_of,
    stored_metric,
)
from trackbench.statistics.sample_statistics import STATISTICS

TIME_MEAN = "time-mean"
"""Statistic: the mean over a window's steps of the RMSE over runs."""
_NAME = r"[\w.-]*[A-Za-z_][\w.-]*"
_STEPS = r"(?:\d+(?:\.\.(?:\d+|last))?|last)"
_GRAMMAR = re.compile(
    r"(?:(?P<relation>gain|ratio|minus|win_rate|controlled)\()?"
    rf"(?:(?P<statistic>[a-z-]+)\()?(?P<metric>{_NAME})"
    rf"(?:\[(?P<window>.+?)\]|@(?P<at>{_STEPS}))?(?(statistic)\)(?:@(?P<step>{_STEPS}))?)"
    r"(?(relation), (?P<other>.+)\))"
)
Relation: TypeAlias = Literal["gain", "ratio", "minus", "win_rate", "controlled", ""]
"""How an expression compares a filter with another; nothing if there is no other."""


class Steps(NamedTuple):
    """Step numbers from first to last; only first if last is empty. ``last`` is the run's last step."""

    first: str
    last: str = ""

    def __str__(self) -> str:
        if self.last:
            return f"@{self.first}..{self.last}"
        return f"@{self.first}"

    def among(self, steps: Iterable[int]) -> list[int]:
        """Select the steps of the expression among the steps of a run."""
        end = float("inf") if self.last == "last" else int(self.last)
        return [k for k in steps if int(self.first) <= k <= end]


class Measure(NamedTuple):
    """Parsed expression: metric, filter, runs, steps, and the filter it is compared with."""

    metric: str
    """``rmse_position``; a row of a file, or a filter's key"""
    window: str = ""
    statistic: str = ""
    """over the runs, such as "mean" or `TIME_MEAN`; nothing if the metric itself is meant"""
    steps: Steps | None = None
    relation: Relation = ""
    other: str = ""
    """label of the filter that it is related to"""
    filter: str = ""
    """label of the measured filter, once that is known"""

    def __str__(self) -> str:
        """Write the expression without the measured filter, as ``gain(mean(rmse[turns]), PF)``."""
        text = self.name
        if self.statistic:
            text = f"{self.statistic}({text})"
        if self.relation:
            text = f"{self.relation}({text}, {self.other})"
        return text

    @property
    def name(self) -> str:
        """Metric over its window or at its steps: ``rmse[turns]``, ``rmse@20`` or ``rmse@3..last``."""
        name = in_window(self.metric, self.window)
        if self.steps is not None:
            name += str(self.steps)
        return name

    @property
    def plain(self) -> "Measure":
        """Expression of one filter, from a comparison of two."""
        return self._replace(relation="", other="")

    @property
    def definition(self) -> Metric:
        """Declared metric: its name, unit and better direction, and the series that it is made of.

        The metric of ``rmse_position`` is ``rmse``; its quantity is another property.
        """
        definition, _ = metric_of(self.metric)
        return definition

    @property
    def quantity(self) -> str:
        """Quantity of the metric, such as ``position`` of ``rmse_position``; empty if it has none."""
        _, quantity = metric_of(self.metric)
        return quantity

    @property
    def base(self) -> str:
        """Name of the stored metric that the number is from, without statistic, window and step."""
        return stored_metric(self.metric)

    @property
    def is_row(self) -> bool:
        """True if this is the name of a metric alone, perhaps with a window.

        It has no statistic, no step and no second filter.
        """
        return not (self.statistic or self.steps or self.relation)

    @property
    def is_error(self) -> bool:
        """True if this is an RMSE against the truth, and not against a measurement."""
        return self.definition.name == "rmse" and not is_of_prediction(self.quantity)

    @property
    def is_cpu_time(self) -> bool:
        """True if this is a CPU time."""
        return self.metric == "cpu_s_per_run"

    @property
    def is_efficiency(self) -> bool:
        """True if this is an efficiency, from the runs of a filter and of the reference."""
        return self.definition.name == "efficiency" and self.is_row

    def made_of(self) -> tuple["Measure", "Measure"]:
        """Return the two measures that an efficiency is computed from.

        They are the RMSE of the reference, and the RMS difference of the filter from the reference.
        """
        rmse = self._replace(metric=joined("rmse", self.quantity))
        rmsd = self._replace(metric=joined("rmsd", self.quantity))
        return rmse, rmsd

    @property
    def is_over_runs(self) -> bool:
        """True if this is a statistic over runs of one number per run."""
        return self.statistic in STATISTICS and not self.relation

    @property
    def is_share(self) -> bool:
        """True if this is the share of runs with an event: the mean of a metric that is 0 or 1."""
        return self.is_over_runs and self.statistic == "mean" and self.definition.is_event

    @property
    def step(self) -> int | None:
        """Number of the step that the measure is at; None for no step, several steps, or ``last``.

        The range ``steps`` has its ends as texts; ``last`` is empty if it is a single step.
        """
        if self.steps is None or self.steps.last or self.steps.first == "last":
            return None
        return int(self.steps.first)

    @property
    def is_many(self) -> bool:
        """True if the measure is at a range of steps."""
        return self.steps is not None and bool(self.steps.last)

    def of(self, label: str) -> "Measure":
        """Return the expression for the filter with this label."""
        return self._replace(filter=label)

    def beside(self, relation: Literal["gain", "ratio", "minus"], other: str) -> "Measure":
        """Return the expression as one that relates the filter to another one, given by its label."""
        return self._replace(relation=relation, other=other)

    def at_each(self, steps: Iterable[int]) -> list["Measure"]:
        """Return an expression for each step of its range.

        Parameters
        ----------
        steps
            numbers of the steps of a run

        Returns
        -------
        list of Measure
            expressions at single steps, in the order of ``steps``; only itself if it has no range
        """
        if self.steps is None or not self.is_many:
            return [self]
        return [self._replace(steps=Steps(str(k))) for k in self.steps.among(steps)]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Return the schema of an expression, which is a word in the config."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(
            measure, core_schema.str_schema(), serialization=core_schema.to_string_ser_schema()
        )


@cache
def measure(text: str) -> Measure:
    """Parse an expression such as ``gain(mean(rmse_position[turns]), PF)`` or ``rmse@20``.

    The module's docstring has all forms.

    Parameters
    ----------
    text
        expression, without the label of the measured filter

    Returns
    -------
    Measure
        parsed expression; `Measure.of` adds the filter

    Raises
    ------
    ValueError
        if the text is no expression, or its statistic is unknown
    """
    groups = _GRAMMAR.fullmatch(text)
    if groups is None:
        raise ValueError(
            f"{text!r} is no expression such as mean(rmse), rmse@20, gain(rms(rmse), PF)"
        )
    # A statistic must be one of the known ones.
    if groups["statistic"] and groups["statistic"] not in (*STATISTICS, TIME_MEAN):
        known = ", ".join((*STATISTICS, TIME_MEAN))
        raise ValueError(f"{groups['statistic']!r} is no statistic; known: {known}")
    # The step stands inside the statistic's parentheses or after them.
    numbers = groups["at"] or groups["step"]
    steps = None
    if numbers:
        first, _, last = numbers.partition("..")
        steps = Steps(first=first, last=last)
    return Measure(
        metric=groups["metric"],
        window=groups["window"] or "",
        statistic=groups["statistic"] or "",
        steps=steps,
        relation=cast(Relation, groups["relation"] or ""),
        other=groups["other"] or "",
    )


def measured(name: str) -> Measure:
    """Parse a name in a results file, such as ``mean(rmse)``, or ``rmse[turns]`` in per_run.csv.

    A name that is no expression becomes a metric of that name.
    """
    try:
        return measure(name)
    except ValueError:
        return Measure(name)


OfRun = Annotated[Measure, "per_run"]
"""A key that names a metric of per_run.csv."""
OfStep = Annotated[Measure, "per_step"]
"""A key that names a metric of per_step.csv."""
OfRank = Annotated[Measure, "rank"]
"""A key that names a PIT: at a step, as every run has it there, or over all steps of each run."""
OfSummary = Annotated[Measure, "summary"]
"""A key that names a row of summary.csv, a time, or a filter's key."""
Expression = Annotated[Measure, "expression"]
"""A key that names a number in any of these ways."""
Comparison = Annotated[Measure, "comparison"]
"""An expression over a grid; without a grid the metric per run whose values are compared."""
