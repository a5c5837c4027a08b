"""Chandrasekaran, Shashikiran & Krishnaveni: filters of a distant target that start from two scans.

A scan is (range, azimuth), the state (x, x', y, y').
"""

from math import atan2, cos, exp, expm1, hypot, log, pi, remainder, sin, sinh, sqrt, tau

import numpy as np
from numpy.linalg import cholesky, inv

from tests.reference.particles import resampled, weights

T, DENSITY = 0.5, 1e-3  # T is not 1, lest a factor of T be missed
V, S_A = 0.2**2, 2e-3**2  # variances of range and azimuth
F = np.kron(np.eye(2), [[1, T], [0, 1]])  # eq. 5
Q_AXIS = DENSITY * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
Q = np.kron(np.eye(2), Q_AXIS)  # eq. 6


def framed(along, across, a):
    """A covariance with these variances along and across the direction a."""
    B = np.array([[cos(a), -sin(a)], [sin(a), cos(a)]])
    return B @ np.diag([along, across]) @ B.T


def position(scan):
    return scan[0] * np.array([cos(scan[1]), sin(scan[1])])


def converted(kind, scan, predicted=None):
    """The position that a scan gives, and the covariance of its error.

    Given the scan the target is at (r - w_r) (cos w_a, sin w_a) in the frame of its azimuth: MUCM is
    that vector's mean and variance. UCM lies farther out by e^s, which adds its bias squared. DUCM is
    UCM's e^(s/2) (r_t + w_r) (cos w_a, sin w_a) given the truth, averaged over the prediction.
    """
    (r, a), s, literal = scan, S_A, position(scan)
    if kind == "ccm":
        return literal, framed(V, r**2 * s, a)  # eqs. 1-2
    along = r**2 * expm1(-s) ** 2 / 2 + V * (1 + exp(-2 * s)) / 2
    across = -(r**2 + V) * expm1(-2 * s) / 2
    if kind == "mucm":
        return exp(-s / 2) * literal, framed(along, across, a)
    if kind == "ucm":
        return exp(s / 2) * literal, framed(along + (2 * r * sinh(s / 2)) ** 2, across, a)
    known = predicted is not None and predicted[3] < s  # the azimuth, better than measured
    r_p, a_p, v_r, v_a = predicted if known else (r, a, V, s)
    square, more = r_p**2 + v_r, 2 * sinh(s / 2) ** 2  # more: cosh s - 1
    along, across = square * more + V * (1 + more), (square + V) * sinh(s)
    turned = -expm1(-2 * v_a) / 2 * (across - along)  # v_a turns the frame, too
    return exp(s / 2) * literal, framed(along + turned, across - turned, a_p)


def two_point(kind, first, second):
    """The state at the second scan by differencing."""
    (z1, R1), (z2, R2) = converted(kind, first), converted(kind, second)
    P = np.kron(R2, [[1, 1 / T], [1 / T, 1 / T**2]])
    P[1::2, 1::2] += R1 / T**2 + DENSITY * T / 3 * np.eye(2)
    return np.column_stack([z2, (z2 - z1) / T]).ravel(), P


def jacobian(x):
    """Of eqs. 7-8, with range and azimuth themselves."""
    r = hypot(x[0], x[2])
    H = np.array([[x[0] / r, 0, x[2] / r, 0], [-x[2] / r**2, 0, x[0] / r**2, 0]])
    return H, r, atan2(x[2], x[0])


def updated(x, P, nu, H, R):
    """The Kalman filter's second half, in the form that holds for any gain."""
    K = P @ H.T @ inv(H @ P @ H.T + R)
    kept = np.eye(4) - K @ H
    return x + K @ nu, kept @ P @ kept.T + K @ R @ K.T


def cmkf(first, second, scans, kind):
    """Converted measurement Kalman filter (section III)."""
    x, P = two_point(kind, first, second)
    for scan in scans:
        x, P = F @ x, F @ P @ F.T + Q
        J, r, a = jacobian(x)
        z, R = converted(kind, scan, (r, a, *np.diag(J @ P @ J.T)))
        x, P = updated(x, P, z - x[::2], np.eye(4)[::2], R)
        yield x, P


def mcaekf(first, second, scans):
    """Measurement covariance adaptive EKF (section IV), the sagitta taken at two sigma."""
    x, P = two_point("mucm", first, second)
    for scan in scans:
        x, P = F @ x, F @ P @ F.T + Q
        H, r_e, a = jacobian(x)
        nu = np.array([scan[0] - r_e, remainder(scan[1] - a, tau)])
        v_a = (H @ P @ H.T)[1, 1]
        share = v_a / (v_a + S_A)
        r_p = r_e * cos(abs(share * nu[1]) + 2 * sqrt(v_a * (1 - share)))  # eq. 10
        D = r_e**2 / r_p - r_e  # eq. 11
        x, P = updated(x, P, nu, H, np.diag([V + D**2, S_A]))
        yield x, P


def mpf(first, second, scans, draws, N, boost, boost_scans):
    """Marginalized particle filter (section VI; Schon et al. 2005), regularized jointly."""
    (Q11, Q12), (_, Q22) = Q_AXIS
    cloud, logs, C, sigma = [], [], DENSITY * T / 3, np.sqrt([V, S_A / 2])
    u, both, (e1, e2) = (draws.take(d) for d in ("random", "standard_normal", "standard_normal"))
    for j, uniform in enumerate(u):
        # The azimuths' difference is drawn in strata from a logistic of twice its deviation.
        q = (j + uniform) / len(u)
        apart = 2 * sqrt(3) / pi * log(q / (1 - q))
        logs.append(-(apart**2) / 2 - log(q * (1 - q)))
        p = position(second + sigma * (e2[j], both[j] + apart))
        cloud.append((p, (p - position(first + sigma * (e1[j], both[j] - apart))) / T))
    for age, (r, a) in enumerate(scans, 1):
        # The velocity given the move dz: what their common noise tells, then an update by the rest.
        S, A = T**2 * C + Q11, 1 - T * Q12 / Q11
        L = A * T * C / S
        X, carried, logs = [], logs, []
        for i, e in enumerate(np.transpose(draws.take("standard_normal"))):
            p, v = cloud[i]
            dz = T * v + sqrt(S) * e
            x, y = p + dz
            X.append((p + dz, A * v + Q12 / Q11 * dz + L * (dz - T * v)))
            off_r, off_a = hypot(x, y) - r, remainder(atan2(y, x) - a, tau)
            logs.append(carried[i] - off_r**2 / V / 2 - off_a**2 / S_A / 2)
        C = A**2 * C + Q22 - Q12**2 / Q11 - L * S * L
        w, X = np.array(weights(logs)), np.array([np.column_stack(x).ravel() for x in X])
        mean = w @ X
        P = (X - mean).T @ (w[:, None] * (X - mean))
        yield mean, P + np.diag([0, C, 0, C])
        size = N * (boost if age < boost_scans else 1)
        chosen = resampled("systematic", w, draws, size)
        normals, gammas = np.transpose(draws.take("standard_normal")), draws.take("standard_gamma")
        h = (8 / (pi**2 / 2) * (4 + 4) * (2 * sqrt(pi)) ** 4 / size) ** (1 / 8)  # c_4 = pi^2 / 2
        A_P, cloud, logs = cholesky(P), [], [0.0] * size
        for i, e, g in zip(chosen, normals, gammas, strict=True):
            x = X[i] + h * A_P @ e / sqrt(e @ e + 2 * g)
            cloud.append((x[::2], x[1::2]))
