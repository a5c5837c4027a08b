"""What the runs of an experiment say of a number: all of them, and each independent batch by itself."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from trackbench.experiment.reading.published import picks
from trackbench.report.expressions import Expressions
from trackbench.report.results import Results


class _Splits(Protocol):
    @property
    def splits(self) -> bool: ...


_Measured = TypeVar("_Measured", bound=_Splits)


@dataclass(frozen=True)
class Evidence:
    """All runs at a point of the grid, and the batches of them that a verdict needs."""

    whole: Expressions
    batches: list[Expressions]

    @classmethod
    def at(cls, results: Results, point: dict[str, Any]) -> "Evidence":
        """At a point; a folder from before there were batches has one."""
        whole = Expressions(results, point)
        return cls(whole, whole.batches(results.config.get("verdict_seeds", 1)))

    def of(self, measure: Callable[[Expressions], _Measured]) -> tuple[_Measured, list[_Measured]]:
        """What is measured over all runs, and in each batch if it splits."""
        whole = measure(self.whole)
        return whole, [measure(batch) for batch in self.batches] if whole.splits else []


def evidence_at(results: Results, text: str) -> Evidence | None:
    """At the point that a published row names, if it has results."""
    point = point_of(results, text)
    return None if point is None else Evidence.at(results, point)


def point_of(results: Results, text: str) -> dict[str, Any] | None:
    """The point with results that ``path=value; path=value`` picks; the first one if it is empty."""
    return next((point for point in results.points() if picks(text, point)), None)
