"""Tang, Sun & Liu: the adaptive Kalman filter, both axes in one state as the paper writes it.

Input estimation (Bogler 1987; Park, Seo & Lee 1995) is the least-squares fit of an input to the
innovations since an onset, from the beginning at every step and for every onset.
"""

from math import inf

import numpy as np
from numpy.linalg import det, inv

T = 2.0  # not 1, lest a factor of T be missed
R, GAMMA, P_LAST, T_A = 100.0**2 * np.eye(2), 0.8, 2, 9.49
INPUT = np.array([[T**2 / 2, 0], [T, 0], [0, T**2 / 2], [0, T], [1, 0], [0, 1]])
PHI_M = np.eye(6)  # of (x, x', y, y', x'', y'')
PHI_M[0, 1] = PHI_M[2, 3] = T
PHI_M[:4, 4:] = INPUT[:4]
PHI = PHI_M[:4, :4]


def kalman(x, P, z, Phi, q):
    """Eqs. 8-12: the posterior, and the innovation with its covariance and gain."""
    H, G = np.eye(len(x))[[0, 2]], INPUT[: len(x)]
    x, P = Phi @ x, Phi @ P @ Phi.T + q * G @ G.T
    S = H @ P @ H.T + R
    K = P @ H.T @ inv(S)
    nu = z - H @ x
    return x + K @ nu, P - K @ H @ P, (nu, S, K)


def fitted(since):
    """A constant input u since an onset: its effect on the state, u, L = cov u, and zeta = u' L^-1 u."""
    M, information, score = np.zeros((4, 2)), np.zeros((2, 2)), np.zeros(2)
    for nu, S, K in since:
        M = PHI @ M + INPUT[:4]  # what the prediction lacks for a unit of input
        Psi = M[[0, 2]]
        information += Psi.T @ inv(S) @ Psi
        score += Psi.T @ inv(S) @ nu
        M = M - K @ Psi
    L = inv(information)
    return M, L @ score, L, score @ L @ score


def log_density(nu, S, _):
    return -0.5 * (nu @ inv(S) @ nu + np.log(det(2 * np.pi * S)))


def adaptive(
    x, P, measurements, q, q_m, eta, statistic, onset="argmax", window=5, xi_min=0, n=0, hold=0
):
    """From the estimate at step 1: the state at steps 2, 3, ... and whether the MF is on."""
    seen, rho, mode, since, x_m, P_m = [], 0.0, "NMF", 1, None, None
    for k, z in enumerate(measurements, 2):
        if mode != "NMF":
            x_m, P_m, maneuvering = kalman(x_m, P_m, z, PHI_M, q_m)
        if mode != "MF":
            x, P, quiet = kalman(x, P, z, PHI, q)
            nu, S, _ = quiet
            rho = GAMMA * rho + nu @ inv(S) @ nu
            seen = [*seen, quiet][-window:]
        if mode == "NMF" and k >= 20 and (statistic == "zeta" or rho > eta):  # eqs. 5-7
            fits = [fitted(seen[-age:]) for age in range(1, len(seen) + 1)]
            zeta = [fit[3] for fit in fits]
            age = {"argmax": 1 + np.argmax(zeta), "newest": 1, "oldest": len(fits)}[onset]
            if (statistic == "rho" or max(zeta) > eta) and age >= xi_min:
                M, u, L, _ = fits[age - 1]
                x_m = np.concatenate([x + M @ u, u])
                P_m = np.block([[P + M @ L @ M.T, M @ L], [L @ M.T, L]])
                mode, since, evidence, recent = "both" if n else "MF", k, 0.0, [inf] * P_LAST
        elif mode == "both":  # the second decision logic
            evidence += log_density(*maneuvering) - log_density(*quiet)
            if k - since >= n:
                mode, since, recent = "MF" if evidence > 0 else "NMF", k, [inf] * P_LAST
        elif mode == "MF":
            recent = [*recent[1:], x_m[4:] @ inv(P_m[4:, 4:]) @ x_m[4:]]
            if sum(recent) < T_A and k - since >= hold:
                mode, since, rho, seen, x, P = "NMF", k, 0.0, [], x_m[:4], P_m[:4, :4]
        yield (x_m[:4], P_m[:4, :4], 1.0) if mode == "MF" else (x, P, 0.0)
