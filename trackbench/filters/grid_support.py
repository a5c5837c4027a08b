"""Intervals of a scalar state that a grid must cover: what prediction and measurement make likely."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol, runtime_checkable

import numpy as np

from trackbench.core import grid_quadrature
from trackbench.core.arrays import Array, Mask
from trackbench.core.grid_quadrature import Interval, Panel, Panels, gauss_legendre
from trackbench.models.base import SampledMotion, Sensor
from trackbench.models.likelihood import log_likelihood

_WIDE_PARTS = 8  # panels of a wide interval, for noise with an edge
_NOISE_REACH = 8.0  # standard deviations of Gaussian process noise
_SEARCHED = 1025  # states at which the likely ones are looked for
_MOST_INTERVALS = 32  # of likely states, in a run


@runtime_checkable
class BoundedMotion(Protocol):
    """A motion whose noise has an edge, beyond which the density is zero."""

    def support(self, low: Array, high: Array, k: int) -> grid_quadrature.Interval:
        """Return the interval that the motion can reach.

        Parameters
        ----------
        low, high : array (M,)
            Limits of the scalar state x_{k-1}.
        k : int
            Number of the step.

        Returns
        -------
        Interval
            Lower and upper end (M,) of x_k.
        """

    def origins(self, x: Array, k: int) -> grid_quadrature.Interval:
        """Return the interval of x_{k-1} from which x_k = x can be reached.

        Parameters
        ----------
        x : array (J, M)
            Scalar states of step k, J in each run.
        k : int
            Number of the step.

        Returns
        -------
        Interval
            Lower and upper end (J, M) of x_{k-1}, which may be infinite.
        """


@runtime_checkable
class SensorWithPreimage(Protocol):
    """A sensor of a scalar state that can be inverted to the states of a measurement."""

    def preimage(self, z: Array, deviations: float, k: int) -> list[grid_quadrature.Interval]:
        """Return the intervals of x whose measurement without noise h(x) is near z.

        Parameters
        ----------
        z : array (1, M)
            Measurements; NaN where one is missing.
        deviations : float
            Largest distance of h(x) from z, in standard deviations of the measurement noise.
        k : int
            Number of the step.

        Returns
        -------
        list of Interval
            Lower and upper ends (M,) of the scalar state, one interval for each root of the measurement
            equation.
        """


def support_of_prediction(
    motion: SampledMotion, old: grid_quadrature.Panels, k: int, deviations: float | None
) -> grid_quadrature.Interval:
    """Return the interval of a scalar x_k that the prediction from a posterior reaches.

    Parameters
    ----------
    motion : SampledMotion
        Motion of the filter model.
    old : Panels
        Posterior of step k - 1.
    k : int
        Number of the step.
    deviations : float or None
        Leave out states of the posterior that are more than so many standard deviations from its mean;
        None for none.

    Returns
    -------
    Interval
        Lower and upper end (M,).
    """
    low, high = grid_quadrature.hull(old)
    if deviations is not None:
        # Leave out states in the posterior's far tails.
        moments = grid_quadrature.moments(old)
        mean = moments.mean[0]
        span = deviations * np.sqrt(moments.cov[0, 0])
        low = np.maximum(low, mean - span)
        high = np.minimum(high, mean + span)
    if isinstance(motion, BoundedMotion):
        return motion.support(low, high, k)
    # Move states of the whole interval; the largest gap between moved neighbors is added as a margin.
    states = low + (high - low) * np.linspace(0.0, 1.0, _SEARCHED)[:, None]
    moved = motion.transition(states.T[None], k)
    mean = moved.mean[0].T
    margin = np.abs(np.diff(mean, axis=0)).max(axis=0)
    # The largest noise of all runs is taken, as the grid may be wider than needed (`Filter.mixes_runs`).
    reach = margin + _NOISE_REACH * np.sqrt(np.max(moved.cov))
    return mean.min(axis=0) - reach, mean.max(axis=0) + reach


def likely_intervals(
    sensor: Sensor, z: Array, deviations: float, k: int, support: grid_quadrature.Interval
) -> list[grid_quadrature.Interval]:
    """Return intervals of the support that contain all states whose measurement is near z.

    The log-likelihood is computed at equally spaced states. A likely state between two of them can be
    missed only at a local maximum of the likelihood, and all local maxima are included.

    Parameters
    ----------
    sensor : Sensor
        Sensor of the filter model.
    z : array (n_z, M)
        Measurements of step k; NaN where a component is missing.
    deviations : float
        States are likely whose log-likelihood is at most ``deviations^2 / 2`` below the largest.
    k : int
        Number of the step.
    support : Interval
        Lower and upper end (M,) of the scalar states that are searched.

    Returns
    -------
    list of Interval
        Lower and upper ends (M,) of at most 32 intervals, in ascending order. In runs with fewer
        intervals than others the rest have width zero.
    """
    # Step 1: log-likelihood at states from end to end, relative to its largest value there.
    low, high = support
    states = low + (high - low) * np.linspace(0.0, 1.0, _SEARCHED)[:, None]
    level = log_likelihood(sensor, z, states.T[None], k).T
    likely = level >= level.max(axis=0) - 0.5 * deviations * deviations
    # Step 2: add local maxima, and the neighbors of what is likely.
    likely[1:-1] |= (level[1:-1] >= level[:-2]) & (level[1:-1] >= level[2:])
    wide = likely.copy()
    wide[1:] |= likely[:-1]
    wide[:-1] |= likely[1:]
    # Step 3: the stretches of consecutive likely states of each run. The last allowed one takes in all
    # further stretches.
    # An edge is 1 where a stretch begins, and -1 after its end.
    edges = np.diff(np.pad(wide, [(1, 1), (0, 0)]).astype(int), axis=0)
    intervals = []
    number = np.cumsum(edges[:-1] > 0, axis=0)  # of the stretch that a state is in or after
    for i in range(1, min(int(number.max()), _MOST_INTERVALS) + 1):
        is_last_allowed = i == _MOST_INTERVALS
        is_stretch = number >= i if is_last_allowed else number == i
        intervals.append(_first_and_last(states, wide & is_stretch))
    return intervals


def _first_and_last(states: Array, inside: Mask) -> grid_quadrature.Interval:
    """Return the first and the last state (M,) of a stretch; an interval of width zero if it is empty.

    ``inside`` (S, M) marks those of the S searched states that are in the stretch.
    """
    nonempty = inside.any(axis=0)
    first = np.argmax(inside, axis=0)
    last = len(inside) - 1 - np.argmax(inside[::-1], axis=0)
    runs = np.arange(inside.shape[1])
    # An empty stretch gets the width zero.
    low = states[first, runs]
    high = states[last, runs]
    return low, np.where(nonempty, high, low)


def support_if_missing(
    z: Array,
    intervals: list[grid_quadrature.Interval],
    support: grid_quadrature.Interval,
    number_of_parts: int,
) -> list[grid_quadrature.Interval]:
    """Replace the intervals by the support, in equal parts, in the runs without a whole measurement.

    Parameters
    ----------
    z : array (n_z, M)
        Measurements; a run with NaN in any component gets the support.
    intervals : list of Interval
        Intervals that the measurement allows, with ends (M,).
    support : Interval
        Lower and upper end (M,) of the states that the prediction reaches.
    number_of_parts : int
        Number of parts of the support, from the function of this name.

    Returns
    -------
    list of Interval
        The intervals themselves if no component is missing. Otherwise at least ``number_of_parts``
        intervals, of which those that a run does not need have width zero.
    """
    missing = np.isnan(z).any(axis=0)
    if not missing.any():
        return intervals
    low, high = support
    # In runs with a measurement the parts beyond its intervals are empty.
    empty = [(low, low)] * (number_of_parts - len(intervals))
    with_measurement = [*intervals, *empty]
    # In runs without a measurement the intervals beyond the parts are empty.
    shares = [min(i / number_of_parts, 1.0) for i in range(len(with_measurement) + 1)]
    ends = [(1.0 - share) * low + share * high for share in shares]
    divided = []
    for (first, last), (a, b) in zip(with_measurement, pairwise(ends), strict=True):
        divided.append((np.where(missing, a, first), np.where(missing, b, last)))
    return divided


def number_of_parts(motion: SampledMotion) -> int:
    """Return the number of panels into which a wide interval is cut.

    Noise with an edge needs several: beyond its edge the density is continued by its formula and grows,
    the more the wider a panel is.
    """
    return _WIDE_PARTS if isinstance(motion, BoundedMotion) else 1


def nodes_between(intervals: Sequence[Interval], support: Interval, n: int) -> Panels:
    """Lay a panel of n nodes over each interval, cut to the support, with the density one.

    Parameters
    ----------
    intervals : sequence of Interval
        Intervals in which the measurement allows the state, with ends (M,) each.
    support : Interval
        Lower and upper end (M,) outside which the prediction has no density.
    n : int
        Number of nodes of a panel.

    Returns
    -------
    Panels
        Panels with nodes (n, M). One that is empty in some runs has width zero there, and one that is
        empty in all is left out. If all are empty, there is one panel over the support, of two nodes and
        density zero.
    """
    panels = []
    for low, high in intervals:
        # Cut the interval to the support.
        a = np.maximum(low, support[0])
        b = np.maximum(np.minimum(high, support[1]), a)
        if (b > a).any():
            # Map the nodes of [-1, 1] to [a, b].
            x = 0.5 * (a + b) + 0.5 * (b - a) * gauss_legendre(n).nodes[:, None]
            panels.append(Panel(a, b, x, np.ones_like(x)))
    if panels:
        return tuple(panels)
    # No interval meets the support: the measurements of all runs are impossible. Return one panel over
    # the support, of density zero.
    low, high = support
    return (Panel(low, high, np.stack([low, high]), np.zeros((2, *low.shape))),)
