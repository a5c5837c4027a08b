"""Linearization of the EKF: prediction by Jacobians, and the second-order terms of Hessians."""

from typing import cast

import numpy as np

from trackbench.core import kalman, linalg
from trackbench.core.arrays import with_axes_of
from trackbench.core.distributions import Gaussian
from trackbench.core.rts_smoother import Transition
from trackbench.filters.assumed_noise import AssumedNoise
from trackbench.models.base import DifferentiableMotion, DifferentiableSensor, Model
from trackbench.models.numerical_derivatives import jacobian_at


def extended_prediction(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, order: int = 1
) -> Gaussian:
    """Predict x_k, with the motion f expanded at the mean.

    ``m^- = f(m)``, ``P^- = F P F' + Q`` with the Jacobian F of f at m; order 2 adds `with_curvature`.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Gaussian
        Posterior of step k - 1: m (n_x, *batch), P (n_x, n_x[, *batch]). The batch is the runs (M,), or
        runs and particles (M, N).
    k : int
        Number of the step.
    assumed : AssumedNoise
        Noise that the filter assumes.
    order : {1, 2}
        Order of the expansion.

    Returns
    -------
    Gaussian
        Prediction: m^- (n_x, *batch), P^- (n_x, n_x[, *batch]).
    """
    # A cast, because isinstance of a Protocol at every step takes as long as the step.
    motion = cast(DifferentiableMotion, model.motion)
    # N(f(m), Q)
    transition = assumed.transition(model, state.mean, k)
    if order == 2:
        transition = with_curvature(transition, motion, state, k)
    F = jacobian_at(motion, state, k)
    return kalman.predict(state, F, transition.cov, transition.mean)


def extended_transition(
    model: Model, state: Gaussian, k: int, assumed: AssumedNoise, order: int = 1
) -> Transition:
    """Return the `extended_prediction` of x_k together with its covariance with x_{k-1}.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    state : Gaussian
        Posterior of step k - 1: m (n_x, M), P (n_x, n_x[, M]).
    k : int
        Number of the step.
    assumed : AssumedNoise
        Noise that the filter assumes.
    order : {1, 2}
        Order of the expansion.

    Returns
    -------
    Transition
        Prediction of x_k, and cov(x_{k-1}, x_k) = P F' (n_x, n_x[, M]).
    """
    F = jacobian_at(cast(DifferentiableMotion, model.motion), state, k)
    cross = linalg.matmul(state.cov, linalg.transpose(F))
    predicted = extended_prediction(model, state, k, assumed, order)
    return Transition(predicted, cross)


def with_curvature(
    linear: Gaussian,
    function: DifferentiableMotion | DifferentiableSensor,
    state: Gaussian,
    k: int,
) -> Gaussian:
    """Add the second-order terms of a motion or sensor to its mean and to its noise covariance.

    They are ``tr(H_i P) / 2`` and ``tr(H_i P H_j P) / 2`` (Bar-Shalom, Li & Kirubarajan 2001, section
    10.3.2), with the Hessian H_i of component i.

    Parameters
    ----------
    linear : Gaussian
        Value of the function at the state's mean, and covariance of its noise.
    function : DifferentiableMotion or DifferentiableSensor
        Function whose Hessians are taken.
    state : Gaussian
        State N(m, P) about whose mean the function is expanded.
    k : int
        Number of the step.

    Returns
    -------
    Gaussian
        Mean and noise covariance with the second-order terms.
    """
    hessians = jacobian_at(function, state, k, order=2)
    if not hessians.any():
        return linear
    HP = [linalg.matmul(H_i, state.cov) for H_i in hessians]
    bias = 0.5 * np.stack([linalg.trace(A) for A in HP])
    cov = linalg.symmetrize(0.5 * linalg.traces_of_products(np.stack(HP)))
    return Gaussian(
        linear.mean + with_axes_of(linear.mean, bias),
        with_axes_of(cov, linear.cov) + with_axes_of(linear.cov, cov),
    )
