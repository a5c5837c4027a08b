"""Filters written by hand in the ways that the docs show, each with a place for a mistake.

``bug`` names the mistake; without one the filter is right. Those with constants of their own belong
to the problem of `OWN`.
"""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import yaml

from trackbench.adapters import PerRun
from trackbench.adapters.per_run import loop_over_runs
from trackbench.config.load import load
from trackbench.contract.problems import ModelDraws
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian, per_run_moments
from trackbench.filters.base import Filter
from trackbench.models.likelihood import log_likelihood
from trackbench.models.model_for_programs import description_of
from trackbench.models.sensors.angular import AngularSensor

OWN = """
name: own
scenario:
  kind: tracking
  T: 2
  last: 25
  target: {kind: driven, motion: {kind: cwna, q: 4}, launch: {x: 4000, y: -2000, vx: -60, vy: 90}}
  sensor: {kind: position, sigma: 15, detection: 0.9}
  start: {kind: gaussian, sigma: [30, 15, 30, 15]}
filters: {}
"""
OWN_RADAR = """
name: own-radar
scenario:
  kind: tracking
  T: 2
  last: 25
  target: {kind: driven, motion: {kind: cwna, q: 4}, launch: {x: -6000, y: 50, vx: 60, vy: -5}}
  sensor: {kind: range-azimuth, sigma_range: 25, sigma_azimuth_mrad: 5}
  start: {kind: gaussian, sigma: [30, 15, 30, 15]}
filters: {}
"""


def with_bug(base: type[Any], bug: str) -> type[Any]:
    """The filter with a mistake, found by its name when it is pickled."""
    name = base.__name__ + bug.title().replace(" ", "")
    cls = type(name, (base,), {"bug": bug, "__module__": __name__, "__annotations__": {}})
    globals()[name] = cls
    return loop_over_runs(cls) if issubclass(cls, PerRun) else cls


def problem(text: str) -> ModelDraws:
    """The problem of a config."""
    config = yaml.safe_load(text) | {"filters": {"KF": {"kind": "ekf"}}}
    return ModelDraws(base=load(config).points[0].scenario)


def mul(*matrices: Array) -> Array:
    """Product of matrices (a, b, M)."""
    out = matrices[0]
    for m in matrices[1:]:
        out = np.einsum("ij...,jk...->ik...", out, m)
    return out


def turned(A: Array) -> Array:
    return np.swapaxes(A, 0, 1)


def inverse(A: Array) -> Array:
    return np.moveaxis(np.linalg.inv(np.moveaxis(A, -1, 0)), 0, -1)


def at_wrong_place(sensor: Any, bug: str) -> Any:
    """The sensor at the place that a filter with this mistake takes for its own."""
    if not isinstance(sensor, AngularSensor):
        return sensor
    if bug == "place ignored":
        return replace(sensor, at=(), platform=None)
    if bug == "place added" and sensor.at:
        return replace(sensor, at=tuple(-place for place in sensor.at))
    if bug == "sensor stays" and sensor.platform is not None:
        return replace(sensor, at=sensor.platform.place(0), platform=None)
    return sensor


class Track(NamedTuple):
    x: Array
    P: Array
    shown: Gaussian
    nis: Array


@dataclass(frozen=True, kw_only=True)
class HandEKF(Filter[Track]):
    """Extended Kalman filter of all runs, with the runner's model; Kalman's where it is linear."""

    bug: ClassVar[str] = ""
    requires: ClassVar[tuple[str, ...]] = ("motion.jacobian", "sensor.jacobian")

    def init(self, model: Any, prior: Any, rng: Any) -> Track:
        g = per_run_moments(prior)
        if self.bug == "prior ignored":
            g = Gaussian(0.0 * g.mean, 1e6 * np.eye(4)[..., None] + 0.0 * g.cov)
        return Track(g.mean, g.cov, g, np.full(g.mean.shape[1], np.nan))

    def step(self, model: Any, state: Track, z: Array, k: int, rng: Any) -> Track:
        bug, runs = self.bug, z.shape[1]
        if bug == "returns its start":
            return state
        x, P = state.x, state.P
        at = max(k - 1, 1) if bug == "other interval" else k
        moved = model.motion.transition(x, at)
        F, Q = model.motion.jacobian(x, at), moved.cov
        if F.ndim == 2:
            F, Q = (np.repeat(A[..., None], runs, axis=2) for A in (F, Q))
        x, dt = moved.mean, F[0, 1, 0]
        if bug == "dt ignored":
            F = np.repeat(np.eye(4)[..., None], runs, axis=2)
            F[0, 1] = F[2, 3] = 1.0
            x = mul(F, state.x[:, None])[:, 0]
        elif bug == "Q times dt":
            Q = Q * dt
        elif bug == "Q forgotten":
            Q = 0.0 * Q
        elif bug == "kind of motion ignored":
            q = description_of(model).motion.q
            Q = 0.0 * Q + model_of(dt.flat[0], q, bug)[1][..., None]
        P = mul(turned(F), P, F) + Q if bug == "F transposed" else mul(F, P, turned(F)) + Q
        predicted = x, P
        if bug == "global noise":
            x = x + np.random.normal(size=x.shape)
        sensor = at_wrong_place(model.sensor, bug)
        seen = sensor.measurement(x, k)
        H, R = sensor.jacobian(x, k), seen.cov
        if H.ndim == 2:
            H = np.repeat(H[..., None], runs, axis=2)
        R = np.repeat(R[..., None], runs, axis=2) if R.ndim == 2 else R
        R = np.sqrt(R) if bug == "sigma" else R
        if bug == "missing is zero":
            z = np.nan_to_num(z)
        missing = np.isnan(z).any(axis=0)
        z = z[::-1] if bug == "axes swapped" else z
        z = np.rad2deg(z) if bug == "degrees" else z
        nu = z - seen.mean if bug == "no wrap" else model.sensor.innovation(z, seen.mean)
        nu = np.where(missing, 0.0, -nu if bug == "sign of innovation" else nu)
        S = mul(H, P, turned(H)) + (0.0 if bug == "R forgotten" else R)
        K = mul(P, turned(H), inverse(S))
        K = np.where(missing, 0.0, K)
        x = x + mul(K, nu[:, None])[:, 0]
        if bug == "gain forgotten":
            pass
        elif bug == "not symmetric":
            P = P - mul(K, H)
        elif bug == "not definite":
            P = P - 2.0 * mul(K, S, turned(K))
        elif bug == "half Joseph":
            A = np.eye(4)[..., None] - mul(K, H)
            P = mul(A, P, turned(A))
        else:
            P = P - mul(K, S, turned(K))
            P = 0.5 * (P + turned(P))
        if bug == "uncorrelated":
            P = P * np.eye(4)[..., None]
        if bug == "speed limit":
            x[1::2] = np.clip(x[1::2], -80.0, 80.0)
        if bug == "float32":
            x, P = (np.float64(np.float32(A)) for A in (x, P))
        nis = np.where(missing, np.nan, (nu * mul(inverse(S), nu[:, None])[:, 0]).sum(axis=0))
        nis = nis * (2.0 if bug == "NIS doubled" else 1.0)
        shown = Gaussian(x, P)
        if bug == "late":
            shown = Gaussian(state.x, state.P)
        if bug == "stale covariance":
            shown = Gaussian(x, predicted[1])
        if bug == "runs mixed":
            shown = Gaussian(np.roll(x, 1, axis=1), P)
        if bug == "in place":
            state.x[:] = x
        return Track(x, P, shown, nis)

    def estimate(self, state: Track) -> Gaussian:
        return state.shown

    def diagnostics(self, state: Track) -> dict[str, Array]:
        return {"nis": state.nis}


class Cloud(NamedTuple):
    x: Array
    w: Array
    shown: Gaussian
    before: Gaussian | None = None


@dataclass(frozen=True, kw_only=True)
class HandPF(Filter[Cloud]):
    """Bootstrap particle filter of all runs, with the runner's model."""

    bug: ClassVar[str] = ""
    N: int = 400

    def init(self, model: Any, prior: Any, rng: Any) -> Cloud:
        x = prior.sample(rng, self.N)
        if self.bug == "prior ignored":
            x = x - 0.5 * (x - x.mean(axis=-1, keepdims=True)) + 20.0
        w = np.full(x.shape[1:], 1.0 / self.N)
        return Cloud(x, w, self.moments(x, w))

    def step(self, model: Any, state: Cloud, z: Array, k: int, rng: Any) -> Cloud:
        bug, x, w = self.bug, state.x, state.w
        if bug == "runs mixed":
            x = np.roll(x, 1, axis=1)
        if bug in ("dt ignored", "Q forgotten", "Q times dt"):
            mean = model.motion.transition(x, k).mean
            dt = float(np.median((mean - x)[0] / x[1]))
            noise = model.motion.transition(x, k).sample(rng) - mean
            if bug == "dt ignored":
                mean = x.copy()
                mean[::2] += x[1::2]
            x = mean + {"dt ignored": 1.0, "Q forgotten": 0.0, "Q times dt": dt}[bug] * noise
        else:
            moved = model.motion.transition(x, k)
            x = moved.sample(rng)
            if bug == "velocity without noise":
                x[1::2] = moved.mean[1::2]
        if bug == "global noise":
            x = x + np.random.normal(size=x.shape)
        if bug == "missing is zero":
            z = np.nan_to_num(z)
        z = z[::-1] if bug == "axes swapped" else z
        z = np.rad2deg(z) if bug == "degrees" else z
        if bug in ("sigma", "no wrap"):
            seen = model.sensor.measurement(x, k)
            R = np.diagonal(seen.cov)[:, None, None]
            nu = z[..., None] - seen.mean
            if bug == "sigma":
                nu, R = model.sensor.innovation(z[..., None], seen.mean), np.sqrt(R)
            log_w = np.nan_to_num(-0.5 * (nu**2 / R).sum(axis=0))
        else:
            log_w = log_likelihood(model.sensor, z, x, k)
        if bug == "weights squared":
            log_w = 2.0 * log_w
        w = (1.0 if bug == "weights reset early" else w) * np.exp(
            log_w - log_w.max(axis=-1, keepdims=True)
        )
        if bug != "weights not normalized":
            w = w / w.sum(axis=-1, keepdims=True)
        shown = self.moments(x, w)
        norm = w.sum(axis=-1, keepdims=True)
        edges = np.cumsum(w / norm, axis=-1)
        u = (np.arange(self.N) + rng.random((*w.shape[:1], 1))) / self.N
        i = np.stack([np.searchsorted(e, v) for e, v in zip(edges, u, strict=True)])
        x = np.take_along_axis(x, np.minimum(i, self.N - 1)[None], axis=-1)
        if bug == "weights stay":
            w = np.take_along_axis(w, np.minimum(i, self.N - 1), axis=-1)
        elif bug != "weights not normalized":
            w = np.full_like(w, 1.0 / self.N)
        return Cloud(x, w, shown, state.shown)

    def moments(self, x: Array, w: Array) -> Gaussian:
        if self.bug == "weights ignored":
            w = np.full_like(w, 1.0 / x.shape[-1])
        m = (w * x).sum(axis=-1)
        e = x - m[..., None]
        P = (w * e[:, None] * e).sum(axis=-1)
        if self.bug == "not symmetric":
            P = (w * e[:, None] * x).sum(axis=-1) + (w * e).sum(axis=-1) + m[:, None] * e[..., 0]
        if self.bug == "not definite":
            P = (w * x[:, None] * x).sum(axis=-1) - 1.01 * m[:, None] * m
        if self.bug == "mean of squares":
            P = (w * x[:, None] * x).sum(axis=-1)
        return Gaussian(m, P)

    def estimate(self, state: Cloud) -> Gaussian:
        return (self.bug == "late" and state.before) or state.shown


@cache
def model_of(dt: float, q: float, bug: str) -> tuple[Array, Array]:
    """F and Q of straight flight, px, vx, py, vy."""
    dt = 1.0 if bug == "dt ignored" else dt
    F, B = np.eye(4), np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    F[0, 1] = F[2, 3] = dt
    Q = q * np.kron(np.eye(2), B)
    Q = Q * {"Q times dt": dt, "Q forgotten": 0.0}.get(bug, 1.0)
    return (F.T if bug == "F transposed" else F), Q


class HandKF(PerRun):
    """Kalman filter of one run, with constants of its own; a UKF by its sigma points if nonlinear."""

    bug: ClassVar[str] = ""
    state: ClassVar[tuple[str, ...]] = ("px", "vx", "py", "vy")
    measured: ClassVar[tuple[str, ...]] = ("x", "y")
    q: float = 4.0
    sigma: float = 15.0

    def start(self, mean: Array, cov: Array) -> None:
        self.x, self.P = mean, cov
        if self.bug == "prior ignored":
            self.x, self.P = 0.0 * mean, 1e4 * cov
        self.shown = self.x, self.P

    def h(self, x: Array) -> Array:
        return x[[2, 0]] if self.bug == "axes swapped" else x[[0, 2]]

    @property
    def R(self) -> Array:
        return np.eye(2) * (self.sigma if self.bug == "sigma" else self.sigma**2)

    def difference(self, z: Array, other: Array) -> Array:
        return z - other

    def predicted(self, dt: float) -> None:
        F, Q = model_of(dt, self.q, self.bug)
        self.x, self.P = F @ self.x, F @ self.P @ F.T + Q

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        bug, before = self.bug, (self.x.copy(), self.P.copy())
        self.predicted(dt)
        if z is None and bug == "missing is zero":
            z = np.zeros(2)
        if bug == "global noise":
            self.x = self.x + np.random.normal(size=4)
        predicted = self.P
        if z is not None:
            # Sigma points of the cubature rule.
            L = np.linalg.cholesky(self.P)
            points = self.x + 2.0 * np.concatenate([L.T, -L.T])
            seen = self.h(points.T).T
            off = self.difference(seen.T, seen[:1].T).T
            mean = off.mean(axis=0)
            S = (off - mean).T @ (off - mean) / 8 + (0.0 if bug == "R forgotten" else self.R)
            C = (points - self.x).T @ (off - mean) / 8
            nu = self.difference(z, seen[0] + mean) * (-1.0 if bug == "sign of innovation" else 1.0)
            K = C @ np.linalg.inv(S)
            self.x = self.x + K @ nu
            if bug == "not symmetric":
                self.P = self.P - K @ C.T @ np.linalg.inv(self.P)
            elif bug == "not definite":
                self.P = self.P - 2.0 * K @ S @ K.T
            elif bug == "half Joseph":
                A = np.eye(4) - K @ C.T @ np.linalg.inv(self.P)
                self.P = A @ self.P @ A.T
            elif bug != "gain forgotten":
                self.P = self.P - K @ S @ K.T
        if bug == "float32":
            self.x, self.P = (np.float64(np.float32(A)) for A in (self.x, self.P))
        if bug == "fixed gain":
            self.P = self.first = getattr(self, "first", self.P)
        shown = (self.x, predicted) if bug == "stale covariance" else (self.x, self.P)
        return before if bug == "late" else shown


class HandUKF(HandKF):
    """The same of a radar."""

    measured: ClassVar[tuple[str, ...]] = ("range", "azimuth")
    sigma: float = 25.0

    def h(self, x: Array) -> Array:
        y, x = (x[0], x[2]) if self.bug == "axes swapped" else (x[2], x[0])
        a = np.arctan2(y, x)
        return np.array([np.hypot(x, y), np.rad2deg(a) if self.bug == "degrees" else a])

    @property
    def R(self) -> Array:
        return np.diag([self.sigma, 0.005]) ** (1 if self.bug == "sigma" else 2)

    def difference(self, z: Array, other: Array) -> Array:
        e = z - other
        if self.bug != "no wrap":
            e[1] = (e[1] + np.pi) % (2.0 * np.pi) - np.pi
        return e
