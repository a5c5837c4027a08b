"""numba: the loops of `scalar.c` in Python, compiled at the first call."""

from typing import Any

import numpy as np
from numba import njit

from benchmarks.peers.c_ import evolution_numbers, merwe_numbers
from trackbench.core.arrays import Array


@njit
def _normalize(w):
    w[:] = np.exp(w - w.max())
    w /= w.sum()


@njit
def _resample(w, x, y):
    N, j = len(w), 0
    u, total = np.random.random(), w[0]
    for i in range(N):
        while total < (i + u) / N and j < N - 1:
            j += 1
            total += w[j]
        for c in range(len(x)):
            y[c, i] = x[c, j]


@njit
def _sensor(p, x, early):
    return p[3] * x * x if early else p[4] * x - 2.0


@njit
def _merwe_pf(p, steps, z, N):
    M, T = z.shape
    out, w = np.empty((M, T)), np.empty(N)
    for m in range(M):
        x, y = np.full((1, N), p[0]), np.empty((1, N))
        for t in range(T):
            drive, early = 1.0 + np.sin(p[1] * steps[t]), steps[t] <= p[7]
            for i in range(N):
                u = np.random.random() * np.random.random() * np.random.random()
                x[0, i] = drive + p[2] * x[0, i] - np.log(u) / p[6]  # gamma noise of shape 3
                e = z[m, t] - _sensor(p, x[0, i], early)
                w[i] = -0.5 * e * e / p[5]
            _normalize(w)
            out[m, t] = (w * x[0]).sum()
            _resample(w, x, y)
            x, y = y, x
    return out


@njit
def _merwe_upf(p, steps, z, N):
    M, T = z.shape
    out, log_w = np.empty((M, T)), np.empty(N)
    q_mean, q_var = 3.0 / p[6], 3.0 / (p[6] * p[6])
    # Seven points of state, process noise and measurement noise: alpha 1, beta 0, kappa 2.
    points, h = np.empty(7), np.empty(7)
    pushed, noisy = np.sqrt(5.0 * q_var), np.sqrt(5.0 * p[5])
    for m in range(M):
        x, y = np.zeros((2, N)), np.empty((2, N))  # state and variance
        x[0] = p[0]
        for t in range(T):
            drive, early = 1.0 + np.sin(p[1] * steps[t]), steps[t] <= p[7]
            for i in range(N):
                old, mu = x[0, i], drive + p[2] * x[0, i] + q_mean
                V = p[2] * p[2] * x[1, i] + q_var
                points[:], moved = mu, p[2] * np.sqrt(5.0 * x[1, i])
                points[1], points[2] = mu + moved, mu - moved
                points[3], points[4] = mu + pushed, mu - pushed
                z_mean, S, C = 0.0, 0.0, 0.0
                for j in range(7):
                    h[j] = _sensor(p, points[j], early)
                    h[j] += noisy if j == 5 else -noisy if j == 6 else 0.0
                    z_mean += (0.1 if j else 0.4) * h[j]
                for j in range(7):
                    S += (0.1 if j else 0.4) * (h[j] - z_mean) ** 2
                    C += (0.1 if j else 0.4) * (points[j] - mu) * (h[j] - z_mean)
                K, e = C / S, np.random.standard_normal()
                P = V - K * K * S
                x[0, i], x[1, i] = mu + K * (z[m, t] - z_mean) + np.sqrt(P) * e, P
                v, r = x[0, i] - drive - p[2] * old, z[m, t] - _sensor(p, x[0, i], early)
                log_w[i] = -1e300
                if v > 0.0:
                    log_w[i] = 2.0 * np.log(v) - p[6] * v - 0.5 * r * r / p[5]
                    log_w[i] += 0.5 * e * e + 0.5 * np.log(P)
            _normalize(log_w)
            out[m, t] = (log_w * x[0]).sum()
            _resample(log_w, x, y)
            x, y = y, x
    return out


@njit
def _log_posterior(p, x, old, drive, z, early):
    v = x - drive - p[2] * old
    if v <= 0.0:
        return -np.inf
    r = z - _sensor(p, x, early)
    return 2.0 * np.log(v) - p[6] * v - 0.5 * r * r / p[5]


@njit
def _merwe_hdepf(p, evolution, steps, z, N, G):
    M, T = z.shape
    F, CR, T0, rho = evolution
    out = np.empty((M, T))
    origin, P, fit = np.empty(N), np.empty(N), np.empty(N)
    best, best_fit, w = np.empty(N), np.empty(N), np.empty(N)
    x, next_x = np.empty(N), np.empty(N)
    q_mean = 3.0 / p[6]
    q_var = 3.0 / (p[6] * p[6])
    # Seven points of state, process noise and measurement noise: alpha 1, beta 0, kappa 2.
    points, h = np.empty(7), np.empty(7)
    pushed = np.sqrt(5.0 * q_var)
    noisy = np.sqrt(5.0 * p[5])
    for m in range(M):
        origin[:] = p[0]
        P[:] = 0.0
        for t in range(T):
            drive = 1.0 + np.sin(p[1] * steps[t])
            early = steps[t] <= p[7]
            for i in range(N):
                old = origin[i]
                mu = drive + p[2] * old + q_mean
                V = p[2] * p[2] * P[i] + q_var
                points[:] = mu
                moved = p[2] * np.sqrt(5.0 * P[i])
                points[1] += moved
                points[2] -= moved
                points[3] += pushed
                points[4] -= pushed
                z_mean, S, C = 0.0, 0.0, 0.0
                for j in range(7):
                    h[j] = _sensor(p, points[j], early)
                    h[j] += noisy if j == 5 else -noisy if j == 6 else 0.0
                    z_mean += (0.1 if j else 0.4) * h[j]
                for j in range(7):
                    S += (0.1 if j else 0.4) * (h[j] - z_mean) ** 2
                    C += (0.1 if j else 0.4) * (points[j] - mu) * (h[j] - z_mean)
                K = C / S
                P[i] = V - K * K * S
                x[i] = mu + K * (z[m, t] - z_mean) + np.sqrt(P[i]) * np.random.standard_normal()
                fit[i] = _log_posterior(p, x[i], old, drive, z[m, t], early)
                best[i], best_fit[i] = x[i], fit[i]
            temperature = T0
            for _ in range(G):
                for i in range(N):
                    next_x[i] = x[i]
                    if np.random.random() > CR:
                        continue  # the trial is its parent
                    a = 1 + int(np.random.random() * (N - 1))
                    b = 1 + int(np.random.random() * (N - 2))
                    b += b >= a
                    a = a + i if a + i < N else a + i - N
                    b = b + i if b + i < N else b + i - N
                    trial = x[i] + F * (x[a] - x[b])
                    trial_fit = _log_posterior(p, trial, origin[i], drive, z[m, t], early)
                    gain = trial_fit - fit[i]
                    if gain > 0.0 or gain > temperature * np.log(np.random.random()):
                        next_x[i], fit[i] = trial, trial_fit
                        if trial_fit > best_fit[i]:
                            best[i], best_fit[i] = trial, trial_fit
                x, next_x = next_x, x
                temperature *= rho
            w[:] = best_fit
            _normalize(w)
            out[m, t] = (w * best).sum()
            origin[:] = best
    return out


@njit
def _banana_pf(F, L, sigma, start, z):
    M, T, N = z.shape[0], z.shape[1], start.shape[2]
    out, w = np.empty((M, T, 4)), np.empty(N)
    old, e = np.empty(4), np.empty(4)
    for m in range(M):
        x, y = start[m].copy(), np.empty((4, N))
        for t in range(T):
            for i in range(N):
                for c in range(4):
                    old[c], e[c] = x[c, i], np.random.standard_normal()
                for c in range(4):
                    total = 0.0
                    for d in range(4):
                        total += F[c, d] * old[d]
                    for d in range(c + 1):
                        total += L[c, d] * e[d]
                    x[c, i] = total
                r = (z[m, t, 0] - np.sqrt(x[0, i] ** 2 + x[2, i] ** 2)) / sigma[0]
                turn = z[m, t, 1] - np.arctan2(x[2, i], x[0, i])
                a = (turn - 2.0 * np.pi * np.rint(turn / (2.0 * np.pi))) / sigma[1]
                w[i] = -0.5 * (r * r + a * a)
            _normalize(w)
            for c in range(4):
                out[m, t, c] = (w * x[c]).sum()
            _resample(w, x, y)
            x, y = y, x
    return out


@njit
def _kalman_cv(F, Q, R, mean, cov, z):
    M, T = z.shape[:2]
    out, K = np.empty((M, T, 4)), np.empty((4, 2))
    A, y, row = np.empty((4, 4)), np.empty(4), np.empty((2, 4))
    for m in range(M):
        x, P = mean[m].copy(), cov.copy()
        for t in range(T):
            for i in range(4):
                y[i] = 0.0
                for j in range(4):
                    y[i] += F[i, j] * x[j]
                    A[i, j] = 0.0
                    for k in range(4):
                        A[i, j] += F[i, k] * P[k, j]
            for i in range(4):
                for j in range(4):
                    P[i, j] = Q[i, j]
                    for k in range(4):
                        P[i, j] += A[i, k] * F[j, k]
            a, b, d = P[0, 0] + R[0, 0], P[0, 2] + R[0, 1], P[2, 2] + R[1, 1]
            det = 1.0 / (a * d - b * b)
            u, v = z[m, t, 0] - y[0], z[m, t, 1] - y[2]
            for i in range(4):
                K[i, 0] = (P[i, 0] * d - P[i, 2] * b) * det
                K[i, 1] = (P[i, 2] * a - P[i, 0] * b) * det
                x[i] = y[i] + K[i, 0] * u + K[i, 1] * v
                row[0, i], row[1, i] = P[0, i], P[2, i]
            for i in range(4):
                for j in range(4):
                    P[i, j] -= K[i, 0] * row[0, j] + K[i, 1] * row[1, j]
                out[m, t, i] = x[i]
    return out


@njit
def _imm_filter(F, Q, R, x, P, z, y, A):
    """Make one Kalman step of a model; return the density of z times 2 pi."""
    for i in range(4):
        y[i] = 0.0
        for j in range(4):
            y[i] += F[i, j] * x[j]
            A[i, j] = 0.0
            for k in range(4):
                A[i, j] += F[i, k] * P[k, j]
    for i in range(4):
        for j in range(4):
            P[i, j] = Q[i, j]
            for k in range(4):
                P[i, j] += A[i, k] * F[j, k]
    a = P[0, 0] + R[0, 0]
    b = P[0, 2] + R[0, 1]
    d = P[2, 2] + R[1, 1]
    det = 1.0 / (a * d - b * b)
    u = z[0] - y[0]
    v = z[1] - y[2]
    for i in range(4):
        A[0, i] = P[0, i]
        A[1, i] = P[2, i]
    for i in range(4):
        first = (A[0, i] * d - A[1, i] * b) * det
        second = (A[1, i] * a - A[0, i] * b) * det
        x[i] = y[i] + first * u + second * v
        for j in range(4):
            P[i, j] -= first * A[0, j] + second * A[1, j]
    return np.sqrt(det) * np.exp(-0.5 * (u * u * d - 2.0 * u * v * b + v * v * a) * det)


@njit
def _imm_cv(F, Q, R, transition, mean, cov, z):
    M, T = z.shape[:2]
    r = len(F)
    out = np.empty((M, T, 4))
    x = np.empty((r, 4))
    P = np.empty((r, 4, 4))
    mixed = np.empty((r, 4))
    spread = np.empty((r, 4, 4))
    mu = np.empty(r)
    c = np.empty(r)
    w = np.empty(r)
    y = np.empty(4)
    A = np.empty((4, 4))
    for m in range(M):
        for j in range(r):
            x[j] = mean[m]
            P[j] = cov
            mu[j] = 1.0 / r
        for t in range(T):
            for j in range(r):
                c[j] = 0.0
                for i in range(r):
                    w[i] = transition[i, j] * mu[i]
                    c[j] += w[i]
                for k in range(4):
                    mixed[j, k] = 0.0
                    for i in range(r):
                        mixed[j, k] += w[i] / c[j] * x[i, k]
                for k in range(4):
                    for n in range(4):
                        spread[j, k, n] = 0.0
                        for i in range(r):
                            apart = (x[i, k] - mixed[j, k]) * (x[i, n] - mixed[j, n])
                            spread[j, k, n] += w[i] / c[j] * (P[i, k, n] + apart)
            whole = 0.0
            for j in range(r):
                for k in range(4):
                    x[j, k] = mixed[j, k]
                    for n in range(4):
                        P[j, k, n] = spread[j, k, n]
                mu[j] = c[j] * _imm_filter(F[j], Q[j], R, x[j], P[j], z[m, t], y, A)
                whole += mu[j]
            for k in range(4):
                out[m, t, k] = 0.0
            for j in range(r):
                mu[j] /= whole
                for k in range(4):
                    out[m, t, k] += mu[j] * x[j, k]
    return out


@njit
def _lorenz96(x, slope):
    N, n = x.shape
    for m in range(N):
        for i in range(n):
            slope[m, i] = (x[m, (i + 1) % n] - x[m, i - 2]) * x[m, i - 1] - x[m, i] + 8.0


@njit
def _lorenz96_enkf(numbers, mean, z, N):
    M, T, n = z.shape
    sigma, R, dt, inflation = numbers
    out = np.empty((M, T, n))
    slope = np.empty((N, n))
    for m in range(M):
        x = mean + sigma * np.random.standard_normal((N, n))
        for t in range(T):
            # Runge-Kutta step of all members
            at = x.copy()
            change = np.zeros((N, n))
            for ahead, weight in ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (0.0, 1.0)):
                _lorenz96(at, slope)
                change += weight * slope
                at = x + ahead * dt * slope
            x += dt / 6.0 * change
            # Perturbed innovations, centered; gain by LAPACK
            deviations = x - x.sum(0) / N
            error = np.sqrt(R * N / (N - 1.0)) * np.random.standard_normal((N, n))
            error += z[m, t] - x - error.sum(0) / N
            C = deviations.T @ deviations / (N - 1.0)
            x += np.linalg.solve(C + R * np.eye(n), error.T).T @ C
            center = x.sum(0) / N
            out[m, t] = center
            x = center + inflation * (x - center)
    return out


def _rows(z: Array) -> Array:
    return np.ascontiguousarray(z.transpose(2, 1, 0))


def merwe_pf(scenario: Any, z: Array, N: int) -> Array:
    """Bootstrap filter; z (1, T, M), estimates (1, T, M)."""
    steps = np.array(scenario.steps[1:], dtype=float)
    return _merwe_pf(merwe_numbers(scenario), steps, _rows(z)[..., 0], N).T[None]


def merwe_upf(scenario: Any, z: Array, N: int) -> Array:
    """Unscented particle filter; z (1, T, M), estimates (1, T, M)."""
    steps = np.array(scenario.steps[1:], dtype=float)
    return _merwe_upf(merwe_numbers(scenario), steps, _rows(z)[..., 0], N).T[None]


def merwe_hdepf(scenario: Any, tracker: Any, z: Array) -> Array:
    """Hybrid differential evolution particle filter; z (1, T, M), estimates (1, T, M)."""
    steps = np.array(scenario.steps[1:], dtype=float)
    numbers = (merwe_numbers(scenario), evolution_numbers(tracker))
    return _merwe_hdepf(*numbers, steps, _rows(z)[..., 0], tracker.N, tracker.G).T[None]


def banana_pf(F: Array, Q: Array, R: Array, start: Array, z: Array) -> Array:
    """Bootstrap filter of z (2, T, M) from clouds (4, M, N); estimates (4, T, M)."""
    clouds = np.ascontiguousarray(start.swapaxes(0, 1))
    root, sigma = np.linalg.cholesky(Q), np.sqrt(np.diag(R))
    return _banana_pf(np.array(F), root, sigma, clouds, _rows(z)).transpose(2, 1, 0)


def kalman_cv(F: Array, Q: Array, R: Array, mean: Array, cov: Array, z: Array) -> Array:
    """Kalman filter of z (2, T, M) from N(mean, cov), mean (4, M); estimates (4, T, M)."""
    first = np.ascontiguousarray(mean.T)
    args = (np.array(F), np.array(Q), np.array(R), first, np.array(cov), _rows(z))
    return _kalman_cv(*args).transpose(2, 1, 0)


def imm_cv(
    F: Array, Q: Array, R: Array, transition: Array, mean: Array, cov: Array, z: Array
) -> Array:
    """IMM of motions F, Q (r, 4, 4) of z (2, T, M) from N(mean, cov); estimates (4, T, M)."""
    first = np.ascontiguousarray(mean.T)
    found = _imm_cv(F, Q, np.array(R), transition, first, np.array(cov), _rows(z))
    return found.transpose(2, 1, 0)


def lorenz96_enkf(numbers: Array, mean: Array, z: Array, N: int) -> Array:
    """Ensemble Kalman filter of z (n, T, M) from N(mean, sigma^2 I), mean (n,); estimates (n, T, M).

    ``numbers`` are sigma, the measurements' variance, the time between steps and the inflation.
    """
    return _lorenz96_enkf(numbers, mean, _rows(z), N).transpose(2, 1, 0)
