"""Key `tuning` of a config: metric, number of training runs, budget; label of a tuned filter."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from trackbench.field_types import Count, Finite

SUFFIX = " (tuned)"
"""End of the label of a tuned filter."""


def tuned_label(label: str) -> str:
    """Return the label of the tuned filter beside this one."""
    return label + SUFFIX


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """Metric of tuning, number of training runs, and budget of each filter."""

    metric: str | dict[str, Finite] | None = None
    """objective over the training runs: minimize `rms(rmse_position)`, or the distance of `anees` to 1;
    maximize `log_score`; or minimize a weighted sum, {rms(rmse_position): 1, anees: 20}; default: the
    rms of the first error, or `log_score` of data without ground truth"""
    runs: Count = 100
    """training runs, shared by all filters and separate from the runs of the results"""
    evaluations: Annotated[int, Interval(ge=2, le=10_000)] = 40
    """number of settings that each filter may try"""
    scenario: dict[str, object] | None = None
    """training scenario: keys that replace the scenario's, {target: {kind: random-legs, ...}}, a path,
    or {use: path, key: value}; default: the scenario itself"""
