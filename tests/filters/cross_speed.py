"""The long-range target's posterior by quadrature: an oracle that no filter's code shares.

Given the cross speed at the first scan, everything else is Gaussian to far below the noise: range and
range rate enter the ranges linearly (second order: 1e-5 m against 0.2 m), and in a frame turned by the
first azimuth the azimuths are that angle plus a known turn. So each node of one variable, the cross
speed, carries a five-dimensional Kalman filter, and the posterior is their mixture.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trackbench.scenarios.base import Simulation
from trackbench.scenarios.tracking import Tracking

Array = NDArray[np.float64]

_WIDEST, _FINEST = 4.5e4, 0.5  # m/s: six standard deviations after two scans; below the last one's
_FLAT = 1e5  # m/s, deviation of the range rate before the second scan: ten times what it can be
_FORGOTTEN = 1e-14  # weight in every run below which a node is dropped


class Posterior(NamedTuple):
    """Mean (4, T + 1, M) and covariance (4, 4, T + 1, M) from the second scan on."""

    mean: Array
    cov: Array


class _Bank(NamedTuple):
    """Per node: mean (5, M, J), covariance (5, 5, J) of (px, vx, py, vy, first azimuth), log-weight."""

    mean: Array
    cov: Array
    log_w: Array


def exact_posterior(scenario: Tracking, data: Simulation, spacing: float = 0.15) -> Posterior:
    """The posterior at every scan, of a target whose velocity is not known beforehand."""
    motion, sensor = scenario.model.motion, scenario.model.sensor
    polar = scenario.target.polar
    assert polar.velocity_radial == 0.0
    F, Q = np.eye(5), np.zeros((5, 5))
    F[:4, :4], Q[:4, :4] = motion.F, motion.Q
    R = np.diag([sensor.sigma_range**2, sensor.sigma_azimuth**2])
    prior = data.prior
    speed, weight = _nodes(polar.velocity_cross, spacing)
    first = prior.first
    mean = np.zeros((5, first.shape[1], len(speed)))
    mean[0], mean[3], mean[4] = first[0][:, None], speed, first[1][:, None]
    cov = np.zeros((5, 5, len(speed)))
    cov[0, 0], cov[1, 1], cov[4, 4] = R[0, 0], _FLAT**2, R[1, 1]
    bank = _Bank(mean, cov, np.tile(np.log(weight), (first.shape[1], 1)))
    scans = np.concatenate([prior.second[:, None], data.measurements], axis=1)
    means, covs = [], []
    for k in range(scans.shape[1]):
        across = (k + 1) * scenario.T * speed
        H = _jacobian(1e3 * polar.range_km, across)
        bank = _conditioned(bank, F, Q, H, R, scans[:, k])
        w = np.exp(bank.log_w)
        kept = (w > _FORGOTTEN).any(axis=0)
        speed = speed[kept]
        bank = _Bank(bank.mean[..., kept], bank.cov[..., kept], bank.log_w[:, kept])
        m, P = _moments(bank, w[:, kept])
        means.append(m)
        covs.append(P)
    return Posterior(np.stack(means, axis=1), np.stack(covs, axis=2))


def _nodes(speed: float, spacing: float) -> tuple[Array, Array]:
    """Cross speeds and the widths they stand for: dense at +-speed, coarser as the distance grows.

    Where the nodes stand changes no integral; the posterior narrows about the truth and its mirror.
    """

    def u(v: Array) -> Array:
        return np.arcsinh((v - speed) / _FINEST) + np.arcsinh((v + speed) / _FINEST)

    table = np.concatenate(
        [s + _FINEST * np.sinh(np.linspace(-13, 13, 4001)) for s in (-speed, speed)]
    )
    table = np.unique(table)
    end = u(np.array(_WIDEST))
    v = np.interp(np.arange(-end, end, spacing), u(table), table)
    slope = sum(1.0 / np.sqrt((v - s) ** 2 + _FINEST**2) for s in (-speed, speed))
    return v, 1.0 / np.asarray(slope)


def _jacobian(along: float, across: Array) -> Array:
    """d(range, azimuth)/d(state) (2, 5, J) where the nodes' paths are."""
    r = np.hypot(along, across)
    c, s = along / r, across / r
    zero = np.zeros_like(r)
    return np.array([[c, zero, s, zero, zero], [-s / r, zero, c / r, zero, zero + 1.0]])


def _conditioned(bank: _Bank, F: Array, Q: Array, H: Array, R: Array, z: Array) -> _Bank:
    """Each node's Kalman filter one scan on, its weight multiplied by the scan's likelihood."""
    mean = np.einsum("ij,jmn->imn", F, bank.mean)
    P = np.einsum("ij,jkn,lk->iln", F, bank.cov, F) + Q[..., None]
    PH = np.einsum("ijn,ajn->ian", P, H)
    S = np.einsum("ain,ibn->abn", H, PH) + R[..., None]
    precision = np.linalg.inv(S.transpose(2, 0, 1)).transpose(1, 2, 0)
    K = np.einsum("ian,abn->ibn", PH, precision)
    nu = np.stack(
        [
            z[0][:, None] - np.sqrt(mean[0] ** 2 + mean[2] ** 2),
            z[1][:, None] - mean[4] - np.arctan2(mean[2], mean[0]),
        ]
    )
    nu[1] = np.angle(np.exp(1j * nu[1]))
    mean = mean + np.einsum("ian,amn->imn", K, nu)
    A = np.eye(5)[..., None] - np.einsum("ian,ajn->ijn", K, H)
    cov = np.einsum("ijn,jkn,lkn->iln", A, P, A) + np.einsum("ian,ab,jbn->ijn", K, R, K)
    log_w = bank.log_w - 0.5 * np.log(S[0, 0] * S[1, 1] - S[0, 1] ** 2)
    log_w = log_w - 0.5 * np.einsum("amn,abn,bmn->mn", nu, precision, nu)
    log_w = log_w - log_w.max(axis=1, keepdims=True)
    return _Bank(mean, cov, log_w - np.log(np.exp(log_w).sum(axis=1, keepdims=True)))


def _moments(bank: _Bank, w: Array) -> tuple[Array, Array]:
    """Mean (4, M) and covariance (4, 4, M), turned back by the first azimuth (Gauss-Hermite)."""
    x, g = np.polynomial.hermite_e.hermegauss(5)
    c, v = bank.cov[:4, 4], bank.cov[4, 4]
    a = bank.mean[4][..., None] + np.sqrt(v)[:, None] * x
    y = bank.mean[:4, ..., None] + (c / np.sqrt(v))[:, None, :, None] * x
    cos, sin = np.cos(a), np.sin(a)
    state = np.empty_like(y)
    for i in (0, 1):
        state[i], state[i + 2] = y[i] * cos - y[i + 2] * sin, y[i] * sin + y[i + 2] * cos
    share = w[..., None] * (g / g.sum())
    center = state[:, :, :1, :1]
    e = state - center
    mean = np.einsum("imnk,mnk->im", e, share)
    e = e - mean[..., None, None]
    cov = np.einsum("imnk,jmnk,mnk->ijm", e, e, share, optimize=True)
    within = np.einsum("ijn,mn->ijm", bank.cov[:4, :4] - c[:, None] * c / v, w)
    turn = np.einsum("mnk,mnk->m", a, share)
    cos, sin = np.cos(turn), np.sin(turn)
    G, eye = np.zeros((4, 4, len(turn))), np.arange(4)
    G[eye, eye] = cos
    G[[0, 1], [2, 3]], G[[2, 3], [0, 1]] = -sin, sin
    return mean + center[..., 0, 0], cov + np.einsum("ijm,jkm,lkm->ilm", G, within, G)
