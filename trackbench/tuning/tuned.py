"""What tuning found: every trial of a filter, in the order in which they were asked for."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from trackbench.tuning.axes import Axis
from trackbench.tuning.objective import Score
from trackbench.tuning.search import Rank, Values

_FAILED: Rank = (1 << 30, np.inf)


class Evaluation(NamedTuple):
    """Values that were tried, and what came of them; no score if the filter failed."""

    values: Values
    score: Score | None

    @property
    def rank(self) -> Rank:
        """What orders evaluations."""
        return _FAILED if self.score is None else self.score.rank


@dataclass
class Tuned:
    """A filter's axes and its evaluations."""

    axes: tuple[Axis, ...]
    evaluations: list[Evaluation] = field(default_factory=list)

    @property
    def best(self) -> Evaluation:
        """The evaluation of the smallest rank; of equal ones the first."""
        return min(self.evaluations, key=lambda evaluation: evaluation.rank)

    @property
    def found(self) -> dict[str, Any]:
        """The best values by key."""
        keys = [axis.key for axis in self.axes]
        return dict(zip(keys, self.best.values, strict=True))
