"""All steps of a nonlinear Kalman filter in one call: the UKF, and the EKF of a radar."""

from typing import NamedTuple

import numpy as np

from trackbench.core import _elementary_kernels, compiled
from trackbench.core.arrays import Array, Index, all_finite, count_operations, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation, MotionMatrices
from trackbench.core.sigma_points import Unscented

_MOST_RUNS = 512
_MOST_COMPONENTS = 6
_MOST_MEASURED = 2
"""Runs, and components of states and measurements, up to which the C kernel filters."""


class MeasuredByKernel(NamedTuple):
    """Sensor of the C kernels, which measures components of the state, or is a radar.

    A radar measures range and azimuth of the positions, which are the components 0 and 2.
    """

    R: Array
    """noise covariance (n_z, n_z)"""
    rows: tuple[int, ...] = ()
    """measured components of the state, unless this is a radar"""
    place: tuple[float, ...] | None = None
    """position of the radar, m; None if the sensor is none"""

    @property
    def is_radar(self) -> bool:
        """True if the sensor is a radar."""
        return self.place is not None

    def arguments(self) -> tuple[Index, Array, Array, Array]:
        """Return the arrays that the kernels take: rows, place, table of the arctangent, and pi.

        The rows are the state's measured components, and the place (2,) is the position of a radar.
        """
        # The kernels read the place of a radar, or else the rows. The unused one gets any numbers.
        place = np.array(self.place if self.place is not None else (0.0, 0.0))
        rows = np.array(self.rows or (0, 2), dtype=np.intp)
        arctangents, pi = _elementary_kernels.arctangent_tables()
        return rows, place, arctangents, pi


class FilteredSteps(NamedTuple):
    """T steps of a filter with one Gaussian, in M runs; axes of steps and runs come last."""

    states: Gaussian
    """posteriors: means (n, T + 1, M), covariances (n, n, T + 1, M); the first is the given one"""
    innovation: Innovation
    """innovations: nu (n_z, T, M), S (n_z, n_z, T, M), and the predictions"""
    nis: Array
    """NIS (T, M)"""


def filter_steps(
    prior: Gaussian,
    motion: MotionMatrices,
    measured: MeasuredByKernel,
    z: Array,
    rule: Unscented | None = None,
) -> FilteredSteps | None:
    """Filter all steps of a linear motion and a sensor of the kernels.

    The bytes are those of `ukf.augmented_step` or `ekf.extended_step`, and `Innovation.nis`, step by
    step, in a small part of the time for few runs.

    Parameters
    ----------
    prior : Gaussian
        Posterior before the first step: mean (n, M), covariance (n, n[, M]).
    motion : MotionMatrices
        Transition matrices and covariances of the process noise of the T steps.
    measured : MeasuredByKernel
        The sensor, which is a radar if there is no ``rule``.
    z : array (n_z, T, M)
        Measurements; NaN where a component is missing.
    rule : Unscented, optional
        Sigma points of state and noises; default: none, for the EKF.

    Returns
    -------
    FilteredSteps or None
        None if there are no C kernels, M, n or n_z is above the kernel's limits, or a step needs numpy:
        a run diverges, or a difference of covariances has lost its digits.
    """
    n_z, T, M = z.shape
    n = motion.size
    is_small = M <= _MOST_RUNS and n <= _MOST_COMPONENTS and n_z <= _MOST_MEASURED
    if not compiled.kernels or not is_small:
        return None
    weights = np.empty(0)
    cov_weights = np.empty(0)
    scale = 0.0
    if rule is not None:
        size = 2 * n + n_z
        scale = float(np.sqrt(rule.spread(size)))
        weights, cov_weights = rule.weights(size)
    means = np.empty((n, T + 1, M))
    covs = np.empty((n, n, T + 1, M))
    means[:, 0] = prior.mean
    covs[:, :, 0] = with_trailing(prior.cov, 1, leading=2)
    predicted = Gaussian(np.empty((n, T, M)), np.empty((n, n, T, M)))
    nu = np.empty((n_z, T, M))
    S = np.empty((n_z, n_z, T, M))
    nis = np.empty((T, M))
    is_done = compiled.kernels.filter_steps(
        *motion.arguments(),
        np.ascontiguousarray(measured.R, dtype=np.float64),
        weights,
        cov_weights,
        *measured.arguments(),
        np.ascontiguousarray(z, dtype=np.float64),
        means,
        covs,
        predicted.mean,
        predicted.cov,
        nu,
        S,
        nis,
        scale,
        measured.is_radar,
        n,
        n_z,
        M,
    )
    # A NaN that is no missing measurement is that of a run that diverges.
    missing = np.isnan(z)
    has_nu = np.array_equal(np.isnan(nu), missing)
    has_nis = np.array_equal(np.isnan(nis), missing.all(axis=0))
    if not (is_done and has_nu and has_nis and all_finite(S)):
        return None
    count_operations("covariances", nis, component_axes=0)
    innovation = Innovation(nu=nu, S=S, predicted=predicted)
    return FilteredSteps(states=Gaussian(means, covs), innovation=innovation, nis=nis)
