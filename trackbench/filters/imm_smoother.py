"""Smoother of interacting multiple models: one step back, given the smoothed step after it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian, per_run_moments
from trackbench.core.imm_probabilities_and_mixing import (
    common_components,
    pad,
    predict_weights,
    update_weights,
)
from trackbench.core.mixtures import combine
from trackbench.core.rts_smoother import Transition, smooth_step
from trackbench.core.sums import total
from trackbench.filters.gaussian_base import GaussianFilter
from trackbench.models.base import Model, angle_rows

_ROUNDING = 1e-9  # of a covariance


class WeightedStates(NamedTuple):
    """A Gaussian of each of r models, and the models' weights (r, M)."""

    states: tuple[Gaussian, ...]
    weights: Array


def smooth_one_back(
    models: Sequence[Model],
    bank: WeightedStates,
    later: WeightedStates,
    transition: Array,
    predict: Callable[[Model, Gaussian, Model, Gaussian, int], Transition],
    k: int,
) -> WeightedStates:
    """Smooth states and weights of the models at step k - 1 (Heskes & Zoeter 2002).

    Parameters
    ----------
    models : sequence of Model
        The r models.
    bank : WeightedStates
        Filtered states and weights of step k - 1.
    later : WeightedStates
        Smoothed states and weights of step k.
    transition : array (r, r)
        Probabilities p_ij of a switch from model i to model j.
    predict : callable
        `cross_transition` of the filter and of the key `mixing`.
    k : int
        Number of the later step.

    Returns
    -------
    WeightedStates
        Smoothed states and weights of step k - 1.
    """
    # Filtered state of each model at this step, before the motion to the next one.
    priors = [per_run_moments(state) for state in bank.states]
    # At [i, j] the probability p_ij mu_i of a switch from model i to j, normalized over i.
    _, mixing_weights = predict_weights(bank.weights, transition)
    joint_weights = []
    smoothed = []
    for j, model_j in enumerate(models):
        # Step 1: predict each state i by model j. If the key `mixing` is unbiased, the state of
        # model j at this step fills in the components that the state i lacks.
        predictions = [
            predict(model_i, prior, model_j, priors[j], k)
            for model_i, prior in zip(models, priors, strict=True)
        ]
        # Step 2: x_k given i, j and all z; Pr(i, j | all z) = mu_j|T p_ij mu_i c_ij / c_j,
        # where c_ij is the likelihood of the later measurements under the prediction of i by j,
        # and c_j the sum of p_ij mu_i c_ij over i.
        predicted = [prediction.predicted for prediction in predictions]
        angles = angle_rows(model_j.motion)
        ends, log_c = given_later(predicted, mixing_weights[:, j], later.states[j], angles)
        # A likelihood is exp(-nis / 2): c_ij enters as a NIS of -2 log c_ij.
        share = update_weights(mixing_weights[:, j], -2.0 * log_c)
        joint_weights.append(later.weights[j] * share)
        # Step 3: smooth each state i.
        smoothed.append(list(map(smooth_step, priors, predictions, ends)))
    # Step 4: collapse over the models j of the next step.
    joint = np.stack(joint_weights)
    weights = total(joint, axis=0)
    share_of_next = joint / np.where(weights > 0.0, weights, 1.0)
    merged = []
    for i, states_of_i in enumerate(zip(*smoothed, strict=True)):
        angles = angle_rows(models[i].motion)
        merged.append(combine(states_of_i, share_of_next[:, i], angles=angles))
    return WeightedStates(states=tuple(merged), weights=weights)


def cross_transition(
    tracker: GaussianFilter,
    model: Model,
    state: Gaussian,
    next_model: Model,
    next_state: Gaussian,
    k: int,
    unbiased: bool,
) -> Transition:
    """Predict the state of one model to step k by the motion of another one.

    Parameters
    ----------
    tracker : GaussianFilter
        Filter of each model.
    model : Model
        Model of ``state``, whose motion has n components.
    state : Gaussian
        State of ``model`` at step k - 1: mean (n, M), covariance (n, n, M).
    next_model : Model
        Model whose motion leads to step k, and has n' components.
    next_state : Gaussian
        State of ``next_model`` at step k - 1: mean (n', M), covariance (n', n', M).
    k : int
        Number of the step.
    unbiased : bool
        Take the moments of the components that ``state`` lacks from ``next_state``; otherwise they are
        zero.

    Returns
    -------
    Transition
        Prediction of x_k, mean (n', M), covariance (n', n', M), and cov(state, x_k) (n, n', M).
    """
    names = model.motion.components
    next_names = next_model.motion.components
    common = common_components(names, next_names)
    y = per_run_moments(pad(state, next_state, common, unbiased))
    # With the fading memory of the filter's key `fading`, as in its steps.
    transition = tracker.faded_transition(next_model, y, k)
    if names == next_names:
        return transition
    # `transition.cross` is C_y = cov(y, x_k) of y, which has the next model's components. Regress
    # the state x on y: C = cov(x, y) P_y^-1 C_y.
    cross = np.zeros((len(names), *y.cov.shape[1:]))
    in_state, in_y = common
    cross[:, list(in_y)] = state.cov[:, list(in_state)]
    return replace(transition, cross=linalg.matmul(Transition(y, cross).gain, transition.cross))


def given_later(
    predicted: Sequence[Gaussian], mixing: Array, later: Gaussian, angles: Sequence[int] = ()
) -> tuple[list[Gaussian], Array]:
    """Condition each of r predictions on later measurements (Heskes & Zoeter 2002).

    Their likelihood is ``later(x) / mixed(x)``, by the smoothed and the predicted mixture of all r. It
    is taken as 1 in a run where it would widen a prediction.

    Parameters
    ----------
    predicted : sequence of Gaussian
        r predictions, means (n, M), covariances (n, n, M).
    mixing : array (r, M)
        Their weights in the predicted mixture.
    later : Gaussian
        Moments of the same step given all measurements, also later ones.
    angles : sequence of int
        Components that are angles.

    Returns
    -------
    conditioned : list of Gaussian
        The r predictions given the later measurements.
    log_c : array (r, M)
        Logarithm of the likelihood of the later measurements under each prediction.
    """
    mixed = combine(predicted, mixing, angles=angles)
    # A component without any variance would make the inverses below infinite. It gets unit variance in
    # every term, which cancels in the results.
    added = np.eye(len(mixed.mean))[..., None] * (linalg.diagonal(mixed.cov) == 0.0)
    mixed_cov = mixed.cov + added
    later_cov = later.cov + added
    mixed_precision = linalg.inverse(mixed_cov)
    later_precision = linalg.inverse(later_cov)
    mixed_mean = mixed.mean
    later_mean = later.mean
    conditioned = []
    log_ratios = []
    is_proper = np.ones(later.mean.shape[1], dtype=np.bool_)
    for prediction in predicted:
        p = Gaussian(prediction.mean, prediction.cov + added)
        # Step 1: P = (P_i^-1 + P_later^-1 - P_mixed^-1)^-1,
        # m = m_i + P (P_later^-1 (m_later - m_i) - P_mixed^-1 (m_mixed - m_i)).
        P = linalg.inverse(linalg.inverse(p.cov) + later_precision - mixed_precision)
        later_mean = near(later_mean, p.mean, angles)
        mixed_mean = near(mixed_mean, p.mean, angles)
        by_later = linalg.matvec(later_precision, later_mean - p.mean)
        by_mixed = linalg.matvec(mixed_precision, mixed_mean - p.mean)
        given = Gaussian(p.mean + linalg.matvec(P, by_later - by_mixed), P)
        # Step 2: c_i = N_i(x) later(x) / (mixed(x) given_i(x)) at any x.
        x = p.mean
        above = p.log_prob(x) + Gaussian(later_mean, later_cov).log_prob(x)
        below = Gaussian(mixed_mean, mixed_cov).log_prob(x) + given.log_prob(x)
        # A likelihood narrows: a wider P is none of a proper likelihood.
        is_narrower = linalg.diagonal(P) <= (1.0 + _ROUNDING) * linalg.diagonal(p.cov)
        is_proper &= is_narrower.all(axis=0) & np.isfinite(above - below)
        conditioned.append(given)
        log_ratios.append(above - below)
    # Step 3: keep the predictions of the runs in which one of them would become wider.
    results = []
    for given, prediction in zip(conditioned, predicted, strict=True):
        mean = np.where(is_proper, given.mean, prediction.mean)
        cov = np.where(is_proper, given.cov - added, prediction.cov)
        results.append(Gaussian(mean, cov))
    return results, np.where(is_proper, np.stack(log_ratios), 0.0)
