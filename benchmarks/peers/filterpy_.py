"""filterpy: its resampler in the loop its book shows, `KalmanFilter`, `IMMEstimator`, and UKFs."""

from typing import Any

import numpy as np
from filterpy.kalman import (
    IMMEstimator,
    KalmanFilter,
    MerweScaledSigmaPoints,
    UnscentedKalmanFilter,
)
from filterpy.monte_carlo import systematic_resample

from trackbench.core.arrays import Array


def merwe_pf(scenario: Any, z: Array, N: int) -> Array:
    """Bootstrap filter; z (1, T, M), estimates (1, T, M)."""
    rng = np.random.default_rng(1)
    out = np.empty_like(z)
    for m in range(z.shape[2]):
        x = np.full(N, scenario.x1)
        for t, k in enumerate(scenario.steps[1:]):
            drive = 1.0 + np.sin(scenario.w * np.pi * k)
            x = (
                drive
                + scenario.phi1 * x
                + rng.gamma(scenario.gamma_shape, 1 / scenario.gamma_rate, N)
            )
            h = scenario.phi2 * x**2 if k <= scenario.switch else scenario.phi3 * x - 2.0
            log_w = -0.5 * (z[0, t, m] - h) ** 2 / scenario.R
            w = np.exp(log_w - log_w.max())
            w /= w.sum()
            out[0, t, m] = np.average(x, weights=w)
            x = x[systematic_resample(w)]
    return out


def banana_pf(F: Array, Q: Array, R: Array, clouds: list[Array], z: Array) -> Array:
    """Bootstrap filter of range and azimuth z (2, T, M) from clouds (4, N); estimates (4, T, M)."""
    rng = np.random.default_rng(1)
    root, sigma = np.linalg.cholesky(Q), np.sqrt(np.diag(R))
    out = np.empty((4, z.shape[1], len(clouds)))
    for m, x in enumerate(clouds):
        for t in range(z.shape[1]):
            x = F @ x + root @ rng.standard_normal(x.shape)
            e_r = (z[0, t, m] - np.hypot(x[0], x[2])) / sigma[0]
            turn = z[1, t, m] - np.arctan2(x[2], x[0])
            e_a = ((turn + np.pi) % (2.0 * np.pi) - np.pi) / sigma[1]
            log_w = -0.5 * (e_r**2 + e_a**2)
            w = np.exp(log_w - log_w.max())
            w /= w.sum()
            out[:, t, m] = np.average(x, weights=w, axis=1)
            x = x[:, systematic_resample(w)]
    return out


def _filter(F: Array, Q: Array, R: Array, mean: Array, cov: Array) -> Any:
    kf = KalmanFilter(dim_x=len(F), dim_z=2)
    kf.F, kf.Q, kf.R = F, Q, R
    kf.H = np.zeros((2, len(F)))
    kf.H[0, 0] = kf.H[1, 2] = 1.0
    kf.x, kf.P = mean[:, None].copy(), cov.copy()
    return kf


def kalman_cv(F: Array, Q: Array, R: Array, mean: Array, cov: Array, z: Array) -> Array:
    """Kalman filter of positions z (2, T, M) from N(mean, cov), mean (4, M); estimates (4, T, M)."""
    out = np.empty((4, *z.shape[1:]))
    for m in range(z.shape[2]):
        kf = _filter(F, Q, R, mean[:, m], cov)
        for t in range(z.shape[1]):
            kf.predict()
            kf.update(z[:, t, m])
            out[:, t, m] = kf.x[:, 0]
    return out


def imm(
    motions: list[tuple[Array, Array]],
    transition: Array,
    R: Array,
    mean: Array,
    cov: Array,
    z: Array,
) -> Array:
    """IMM of motions (F, Q) of equal size; z (2, T, M); estimates (n_x, T, M)."""
    out = np.empty((len(mean), *z.shape[1:]))
    r = len(motions)
    for m in range(z.shape[2]):
        filters = [_filter(F, Q, R, mean[:, m], cov) for F, Q in motions]
        mixed = IMMEstimator(filters, np.full(r, 1.0 / r), transition)
        for t in range(z.shape[1]):
            mixed.predict()
            mixed.update(z[:, t, m])
            out[:, t, m] = mixed.x[:, 0]
    return out


def merwe_upf(scenario: Any, z: Array, N: int) -> Array:
    """Unscented particle filter, an `UnscentedKalmanFilter` per particle; z (1, T, M).

    The gamma noise enters the prediction by its mean and variance; the weight is likelihood times
    transition density over proposal density.
    """
    rng = np.random.default_rng(1)
    s, out = scenario, np.empty_like(z)
    mean, variance = s.gamma_shape / s.gamma_rate, s.gamma_shape / s.gamma_rate**2
    for m in range(z.shape[2]):
        ukfs = [_ukf(scenario, variance) for _ in range(N)]
        x = np.full(N, s.x1)
        for t, k in enumerate(s.steps[1:]):
            drive = 1.0 + np.sin(s.w * np.pi * k)
            old, log_w = x.copy(), np.empty(N)
            for i, ukf in enumerate(ukfs):
                ukf.x = np.array([old[i]])
                ukf.predict(drive=drive + mean)
                ukf.update(z[:, t, m], quadratic=k <= s.switch)
                P = ukf.P[0, 0]
                x[i] = ukf.x[0] + np.sqrt(P) * rng.standard_normal()
                log_q = -0.5 * (x[i] - ukf.x[0]) ** 2 / P - 0.5 * np.log(P)
                v = x[i] - drive - s.phi1 * old[i]
                log_prior = (s.gamma_shape - 1) * np.log(v) - s.gamma_rate * v if v > 0 else -np.inf
                h = s.phi2 * x[i] ** 2 if k <= s.switch else s.phi3 * x[i] - 2.0
                log_w[i] = log_prior - 0.5 * (z[0, t, m] - h) ** 2 / s.R - log_q
            top = log_w.max()
            w = np.exp(log_w - top) if np.isfinite(top) else np.ones(N)
            w /= w.sum()
            out[0, t, m] = w @ x
            chosen = systematic_resample(w)
            x = x[chosen]
            for ukf, P in zip(ukfs, [ukfs[i].P.copy() for i in chosen], strict=True):
                ukf.P = P
    return out


def _ukf(scenario: Any, variance: float) -> Any:
    s = scenario
    ukf = UnscentedKalmanFilter(
        dim_x=1,
        dim_z=1,
        dt=1.0,
        fx=lambda x, dt, drive: drive + s.phi1 * x,
        hx=lambda x, quadratic: s.phi2 * x**2 if quadratic else s.phi3 * x - 2.0,
        points=MerweScaledSigmaPoints(1, alpha=1.0, beta=0.0, kappa=2.0),
    )
    ukf.Q, ukf.R = np.array([[variance]]), np.array([[s.R]])
    ukf.P = np.zeros((1, 1)) + 1e-12
    return ukf
