"""Smoothers against the joint distribution of all states, and against each other."""

import numpy as np
import pytest

from trackbench.core.distributions import Gaussian
from trackbench.core.rts_smoother import Transition, smooth

F = np.array([[1.0, 0.5], [-0.2, 0.9]])
Q = np.array([[0.3, 0.1], [0.1, 0.2]])
H = np.array([[1.0, 0.3]])
R = np.array([[0.4]])
P0 = np.array([[2.0, 0.3], [0.3, 1.0]])
T = 12
Z = np.random.default_rng(7).normal(size=(T, 1, 3))


def filtered(measured: int) -> tuple[list[Gaussian], list[Transition]]:
    """Return posteriors of steps 0 to ``measured`` and the transitions between them."""
    posteriors, transitions = [Gaussian(np.zeros((2, 3)), P0)], []
    for k in range(measured):
        m, P = posteriors[-1].mean, posteriors[-1].cov
        predicted = Gaussian(F @ m, F @ P @ F.T + Q)
        transitions.append(Transition(predicted, P @ F.T))
        S = H @ predicted.cov @ H.T + R
        K = predicted.cov @ H.T @ np.linalg.inv(S)
        mean = predicted.mean + K @ (Z[k] - H @ predicted.mean)
        posteriors.append(Gaussian(mean, predicted.cov - K @ S @ K.T))
    return posteriors, transitions


def joint_posterior(measured: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (T + 1, 2, 3) and covariance (T + 1, 2, 2) given so many measurements at once."""
    n = 2 * (T + 1)
    A = np.zeros((n, n))  # x = A w with w = (x_0, v_1, ..., v_T)
    for k in range(T + 1):
        for j in range(k + 1):
            A[2 * k : 2 * k + 2, 2 * j : 2 * j + 2] = np.linalg.matrix_power(F, k - j)
    W = np.kron(np.eye(T + 1), Q)
    W[:2, :2] = P0
    P = A @ W @ A.T
    C = np.zeros((measured, n))
    for k in range(measured):
        C[k, 2 * k + 2 : 2 * k + 4] = H
    K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R * np.eye(measured))
    mean = K @ Z[:measured, 0]
    cov = P - K @ C @ P
    blocks = [cov[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(T + 1)]
    return mean.reshape(T + 1, 2, 3), np.array(blocks)


@pytest.mark.parametrize("lag", [None, 1, 4, T])
def test_a_fixed_lag_or_none_against_the_joint_distribution(lag: int | None) -> None:
    for k, found in enumerate(smooth(*filtered(T), lag)):
        mean, cov = joint_posterior(T if lag is None else min(k + lag, T))
        np.testing.assert_allclose(found.mean, mean[k], atol=1e-12)
        np.testing.assert_allclose(found.cov, cov[k], atol=1e-12)
