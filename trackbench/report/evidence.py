"""Runs of an experiment that a published row is compared with."""

from typing import Any

from trackbench.experiment.reading.published import picks
from trackbench.report.expressions import Expressions
from trackbench.report.results import Results


def evidence_at(results: Results, text: str) -> Expressions | None:
    """Return the measures at the point that a published row names, None if it has no results."""
    point = point_of(results, text)
    return None if point is None else Expressions(results, point)


def point_of(results: Results, text: str) -> dict[str, Any] | None:
    """Return the point that ``path=value; path=value`` picks; the first with results if it is empty."""
    return next((point for point in results.points() if picks(text, point)), None)
