"""All steps of an IMM in one call of the C kernels, bit for bit those of `step`."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from trackbench.core import compiled, elementary
from trackbench.core.arrays import Array, all_finite, with_trailing
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import Gaussian
from trackbench.core.kalman import Innovation
from trackbench.filters.all_steps_at_once import MOST_MEASURED
from trackbench.models.base import Model, angle_rows
from trackbench.models.motions.steps_at_once import MotionMatrices, matrices_of_steps
from trackbench.models.sensors.compiled_sensors import MeasuredByKernel, measured_by_kernel
from trackbench.models.sensors.position import LinearSensor

_MOST_COMPILED = 6
"""Models, and components of their states, up to which the C kernel filters."""


class LinearModel(NamedTuple):
    """Matrices of a linear model over T steps: those of the motion, H (n_z, n), R (n_z, n_z)."""

    motion: MotionMatrices
    H: Array
    R: Array


class Interacting(NamedTuple):
    """T steps of r interacting models, in M runs; axes of steps and runs come last."""

    states: tuple[Gaussian, ...]
    """posteriors of each model: means (n, T + 1, M), covariances (n, n, T + 1, M); first given"""
    weights: Array
    """weights (r, T + 1, M); the first are given"""
    predicted_weights: Array
    """weights (r, T, M) before each measurement"""
    innovations: tuple[Innovation, ...]
    """innovation of each model: nu (n_z, T, M), S (n_z, n_z, T, M), and the prediction"""
    nis: Array
    """mean NIS (T, M)"""
    estimate: Gaussian
    """moments of the mixture: mean (n, T, M), covariance (n, n, T, M)"""


def matrices_of_models(models: list[Model], k: int, steps: int) -> list[LinearModel] | None:
    """Return the matrices of each model over several steps, for `interact`.

    Parameters
    ----------
    models : list of Model
        The r models, all with one sensor.
    k : int
        Number of the first step.
    steps : int
        Number of steps T.

    Returns
    -------
    list of LinearModel or None
        Matrices of the r models. A radar has no H: its H is zero. None unless all models are linear but
        for a radar, and their states have the same components and no angles.
    """
    matrices = []
    components = models[0].motion.components
    for motion, sensor in models:
        if motion.components != components or angle_rows(motion):
            return None
        motion_matrices = matrices_of_steps(motion, k, steps)
        if motion_matrices is None:
            return None
        n = motion_matrices.size
        if isinstance(sensor, LinearSensor):
            matrices.append(LinearModel(motion=motion_matrices, H=sensor.H(n), R=sensor.R))
            continue
        measured = measured_by_kernel(sensor, n)
        if measured is None:
            return None
        no_matrix = np.zeros((len(measured.R), n))
        matrices.append(LinearModel(motion=motion_matrices, H=no_matrix, R=measured.R))
    return matrices


def interact(
    states: Sequence[Gaussian],
    weights: Array,
    models: Sequence[LinearModel],
    transition: Array,
    z: Array,
    radar: MeasuredByKernel | None = None,
) -> Interacting | None:
    """Filter all steps of interacting linear models with a constant sensor (Blom & Bar-Shalom 1988).

    The sensor may be a radar, whose Jacobian takes the place of H. The bytes are those of
    `predict_weights`, `combine`, `kalman.predict`, `kalman.update` and `update_weights` step by step, in
    a small part of the time for few runs.

    Parameters
    ----------
    states : sequence of Gaussian
        Posterior of each of the r models before the first step, means (n, M), covariances (n, n, M).
    weights : array (r, M)
        Weights of the models before the first step.
    models : sequence of LinearModel
        Matrices of each model. All must have the same H and R, and the same ``motion.numbers``, the
        indices of F and Q at each step: those of the first model are used.
    transition : array (r, r)
        Probabilities p_ij of a switch from model i to model j.
    z : array (n_z, T, M)
        Measurements.
    radar : MeasuredByKernel, optional
        The sensor, if it is a radar.

    Returns
    -------
    Interacting or None
        None if there are no C kernels, r or n is above 6, n_z above 2, a component is missing (NaN) in
        some of the runs only, or a run diverges.
    """
    n_z, T, M = z.shape
    r = len(models)
    n = models[0].motion.size
    missing = np.isnan(z)
    if not compiled.kernels or max(r, n) > _MOST_COMPILED or n_z > MOST_MEASURED:
        return None
    if (missing != missing[..., :1]).any():
        return None
    # Step 1: arrays with the axes of steps and runs last, the first step's from before.
    means = np.empty((r, n, T + 1, M))
    covs = np.empty((r, n, n, T + 1, M))
    all_weights = np.empty((r, T + 1, M))
    for j, state in enumerate(states):
        means[j, :, 0] = state.mean
        covs[j, :, :, 0] = with_trailing(state.cov, 1, leading=2)
    all_weights[:, 0] = weights
    predicted_means = np.empty((r, n, T, M))
    predicted_covs = np.empty((r, n, n, T, M))
    predicted_weights = np.empty((r, T, M))
    nu = np.empty((r, n_z, T, M))
    S = np.empty((r, n_z, n_z, T, M))
    nis = np.empty((T, M))
    estimate = Gaussian(np.empty((n, T, M)), np.empty((n, n, T, M)))
    # Step 2: all steps.
    motions = MotionMatrices(
        F=np.stack([model.motion.F for model in models]),
        Q=np.stack([model.motion.Q for model in models]),
        numbers=models[0].motion.numbers,
    )
    matrices = [
        models[0].H,
        models[0].R,
        transition,
        z,
    ]
    sensor = radar or MeasuredByKernel(R=models[0].R)
    is_finite = compiled.kernels.interact(
        *motions.arguments(),
        *[np.ascontiguousarray(matrix, dtype=np.float64) for matrix in matrices],
        *elementary.exp_tables(),
        *sensor.arguments(),
        *(means, covs, all_weights, predicted_means, predicted_covs, predicted_weights),
        *(nu, S, nis, estimate.mean, estimate.cov),
        *(sensor.is_radar, r, n, n_z, M),
    )
    # A NaN that is no missing measurement is that of a run that diverges.
    has_nu = (np.isnan(nu) == missing).all()
    if not (is_finite and has_nu and all_finite(means) and all_finite(covs)):
        return None
    # One update of a covariance per model, step and run (r, T, M).
    count_operations("covariances", predicted_weights, component_axes=0)
    innovations = []
    for j in range(r):
        prediction = Gaussian(predicted_means[j], predicted_covs[j])
        innovations.append(Innovation(nu=nu[j], S=S[j], predicted=prediction))
    return Interacting(
        states=tuple(map(Gaussian, means, covs)),
        weights=all_weights,
        predicted_weights=predicted_weights,
        innovations=tuple(innovations),
        nis=nis,
        estimate=estimate,
    )
