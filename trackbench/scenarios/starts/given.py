"""Start `given`: every filter starts from the same normal distribution."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trackbench.core.distributions import Distribution, Gaussian
from trackbench.registry import register
from trackbench.scenarios.starts.base import FixedStart, repeated
from trackbench.scenarios.starts.normal_distribution import Located, NormalStart


@register("starts", "given")
@dataclass(frozen=True, kw_only=True)
class GivenStart(Located, NormalStart, FixedStart):
    """Every filter starts from the same normal distribution, wherever the target really is.

    In a recording it is the state one step before the first row. If the first row has no measurement, as
    in a log of wheels, it is the state at the first row.
    """

    draws_truth: ClassVar[bool] = False

    def distribution(self, runs: int) -> Distribution:
        """Return the configured prior."""
        return Gaussian(repeated(np.array(self.mean), runs), self._cov)
