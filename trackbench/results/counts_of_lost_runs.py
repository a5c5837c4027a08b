"""Counts of a filter's lost runs by reason, and their sentence."""

from typing import NamedTuple

import numpy as np

from trackbench.evaluation.lost_runs import LOST_BECAUSE, NO_TRUTH, NOT_FINITE
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.result_over_all_runs import FilterResult


class Losses(NamedTuple):
    """Number of runs of one filter, and of the lost ones by reason."""

    runs: int
    by_code: dict[float, int]
    """number of lost runs by the reason, a key of `LOST_BECAUSE`"""
    has_distance: bool = True
    """True if the reference filter could be run, if there is none, and if all runs are lost"""

    @classmethod
    def from_result(cls, result: FilterResult) -> "Losses":
        """Count a filter's lost runs by the codes of the metric ``lost``, 0 for a run that counts."""
        codes = result.per_run["lost"]
        # RMS differences from the reference filter, of each quantity and window.
        distances = []
        for name, values in result.per_run.items():
            metric = measured(name).definition
            if metric.name == "rmsd":
                distances.append(values)
        # A distance to the reference is missing only if the reference failed: there is one and no
        # distance is finite. If all runs are lost, all distances are NaN for this reason, and nothing is
        # missing.
        has_distance = not distances or bool((codes > 0).all())
        if any(np.isfinite(values).any() for values in distances):
            has_distance = True
        by_code = {code: int((codes == code).sum()) for code in LOST_BECAUSE}
        return cls(runs=len(codes), by_code=by_code, has_distance=has_distance)

    @property
    def lost(self) -> int:
        """Runs lost for any reason."""
        return sum(self.by_code.values())

    @property
    def is_total(self) -> bool:
        """True if no run has finite estimates and a finite truth, so that there is nothing to show."""
        return self.by_code[NOT_FINITE] + self.by_code[NO_TRUTH] == self.runs

    def __str__(self) -> str:
        reasons = [f"{n} because {LOST_BECAUSE[code]}" for code, n in self.by_code.items() if n]
        return f"{self.lost} of {self.runs} runs lost, {', '.join(reasons)}"
