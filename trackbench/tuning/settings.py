"""What an experiment says of its tuning beside the keys: the metric, the runs, the budget."""

from dataclasses import dataclass
from typing import Annotated, Any

from annotated_types import Interval

from trackbench.keys import Count, Finite

SUFFIX = " (tuned)"
"""What the label of a tuned filter ends with."""


def tuned(label: str) -> str:
    """Label of the tuned filter beside this one."""
    return label + SUFFIX


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """By what filters are tuned, on how many runs, and how often each may try."""

    metric: str | dict[str, Finite] | None = None
    """what is made small over the training runs: `rms(rmse_position)`; `anees`, its distance to 1;
    `log_score`, made large; or a sum by weights, {rms(rmse_position): 1, anees: 20}; default: the rms
    of the first error, `log_score` of data without a truth"""
    runs: Count = 100
    """training runs, the same for every filter, none of which is a run of the results"""
    evaluations: Annotated[int, Interval(ge=2, le=10_000)] = 40
    """how many values of its keys each filter may try"""
    scenario: dict[str, Any] | None = None
    """what training simulates in place of the scenario: keys laid over it, {target: {kind: random-legs,
    ...}}, a path, or {use: path, key: value}; default: the scenario itself"""
