"""Outliers of a sensor's true measurements: their key, and the factor on the errors."""

from dataclasses import dataclass

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.field_types import Count, Positive, Share


@dataclass(frozen=True, kw_only=True)
class Outliers:
    """Errors that are larger than a filter assumes: now and then, or by a heavy tail."""

    share: Share = 0.0
    """share of the measurements with an error `times` as large"""
    times: Positive = 10.0
    """factor on their error"""
    degrees: Count | None = None
    """degrees of freedom of Student's t, in place of the normal distribution of the same scale"""


def outlier_factor(outliers: Outliers, runs: int, rng: Streams) -> Array:
    """Draw the factor (M,) by which a run's standard normal errors are multiplied.

    It makes a share of them larger, gives them Student's t distribution, or both. One factor is drawn
    for all components of a measurement.
    """
    factor = np.ones(runs)
    if outliers.degrees is not None:
        # Student's t is a normal over the root of a mean of d squared normals.
        squares = np.square(rng.standard_normal((outliers.degrees, runs)))
        factor = np.sqrt(outliers.degrees / total(squares, axis=0))
    if outliers.share:
        is_outlier = rng.random((runs,)) < outliers.share
        factor = np.where(is_outlier, outliers.times * factor, factor)
    return factor
