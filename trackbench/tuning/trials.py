"""A filter with values for the keys that are tuned, as a config would make it."""

from dataclasses import dataclass
from typing import Any

from trackbench.experiment.problems import Problem
from trackbench.experiment.reading.assuming import check_assumed, read_assumed
from trackbench.experiment.reading.checks import check_fit
from trackbench.experiment.reading.definition import Point
from trackbench.experiment.reading.parts import build_kind
from trackbench.experiment.reading.source import Source
from trackbench.filters.base import AnyFilter
from trackbench.models.assumed import Assume
from trackbench.tuning.entries import Values, with_values


@dataclass(frozen=True)
class Trial:
    """A filter and what it assumes."""

    filter: AnyFilter
    assume: Assume | None


def make_trial(
    source: Source, point: Point, label: str, values: Values, problems: list[Problem]
) -> Trial | None:
    """The filter with these values; None, with the reasons, if there is none."""
    changed, found = with_values(source, label, values), list[Problem]()
    tracker: Any = build_kind("filters", changed, ("filters", label), found)
    assume = read_assumed(changed, label, found)
    if tracker is not None and not found:
        assumed = {label: assume} if assume is not None else {}
        tried = Point(point.values, point.scenario, {label: tracker}, assumed)
        seen = check_assumed(changed, tried, label, found)
        if seen is not None:
            check_fit(changed, ("filters", label), tracker, seen, found)
    problems += found
    return None if found else Trial(tracker, assume)
