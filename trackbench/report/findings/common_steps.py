"""Steps of a recording over which filters are compared: those at which every filter has a value."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Mask
from trackbench.report.findings.candidates import Candidate
from trackbench.report.findings.phrases import listed


class CommonSteps(NamedTuple):
    """Steps of a recording over which filters are compared, if some have a metric at fewer steps."""

    is_common: Mask
    """True for each step (T,) at which all filters have the metric"""
    most: int
    """largest number of steps at which one has it"""
    skipping: list[Candidate]
    """filters without it at other steps"""


def common_steps_of(candidates: Sequence[Candidate]) -> CommonSteps | None:
    """Count the steps at which all candidates have the metric; None if all have it at the same steps.

    It is also None if the candidates are not of one recording, or have no step in common.
    """
    if not candidates or any(c.sample.steps is None for c in candidates):
        return None
    # (filters, T), and the number of steps of each filter.
    has_value = np.array([c.sample.steps.has_value for c in candidates if c.sample.steps])
    numbers = has_value.sum(axis=1)
    is_common: Mask = np.logical_and.reduce(has_value, axis=0)
    if not is_common.any() or (numbers == is_common.sum()).all():
        return None
    most = int(numbers.max())
    skipping = [c for c, number in zip(candidates, numbers, strict=True) if number < most]
    return CommonSteps(is_common=is_common, most=most, skipping=skipping)


def explain_common_steps(common: CommonSteps) -> str:
    """Explain over which steps filters are compared if some have the metric at fewer steps."""
    names = [candidate.name for candidate in common.skipping]
    verb = "has" if len(names) == 1 else "have"
    number = int(common.is_common.sum())
    return (
        f"The ranking is over the {number} of {common.most} measured steps at which every filter has a "
        f"value; {listed(names)} {verb} none at the others."
    )
