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
from trackbench.tuning.entries import Chosen, with_values


@dataclass(frozen=True)
class Tried:
    """A filter and what it assumes."""

    filter: AnyFilter
    assume: Assume | None


def make_trial(source: Source, point: Point, label: str, values: Chosen) -> Tried | list[Problem]:
    """The filter with these values; the reasons if there is none."""
    changed = with_values(source, label, values)
    tracker: Any = build_kind("filters", changed, ("filters", label))
    assume = read_assumed(changed, label)
    if tracker is not None and not changed.problems:
        assumed = {label: assume} if assume is not None else {}
        tried = Point(point.values, point.scenario, {label: tracker}, assumed)
        seen = check_assumed(changed, tried, label)
        if seen is not None:
            check_fit(changed, ("filters", label), tracker, seen)
    return changed.problems or Tried(tracker, assume)
