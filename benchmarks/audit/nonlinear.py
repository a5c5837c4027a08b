"""Two nonlinear problems, and the filters of textbooks on them in a few lines of numpy.

The problems have the state (px, vx, py, vy) of the linear one, so that adapters serve both. `PENDULUMS`
has a nonlinear motion and a linear sensor, `SQUARES` a linear motion and a nonlinear sensor. No code of
trackbench or of a judged package computes the expected estimates.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import yaml

from trackbench.config.load import load
from trackbench.contract.estimates import run_filter, simulate
from trackbench.contract.missing_measurements_check import with_gaps
from trackbench.contract.problems import ModelDraws
from trackbench.core.arrays import Array
from trackbench.filters.base import AnyFilter

T = 0.5
_RUNS = 20
TOLERANCE = 1e-4
"""in standard deviations: what weights of 1e6 lose by rounding is below 1e-6"""

_HEAD = "name: audit\nscenario:\n  kind: tracking\n  T: 0.5\n  last: 8\n"
_TAIL = "filters: {EKF: {kind: ekf}}\n"
_PENDULUMS = """  target:
    kind: driven
    motion:
      kind: map
      components: [px, vx, py, vy]
      next: {px: px + T*vx, vx: vx - 4*T*sin(px), py: py + T*vy, vy: vy - 2*T*sin(py)}
      Q: [0.002, 0.01, 0.001, 0.02]
    launch: {x: 1.0, vx: 0.5, y: -0.7, vy: 0.4}
  sensor: {kind: position, sigma: 0.4}
  start: {kind: gaussian, sigma: [0.5, 0.4, 0.4, 0.5]}
"""
_SQUARES = """  target:
    kind: driven
    motion: {kind: cwna, q: 0.05}
    launch: {x: 2.0, vx: 0.1, y: 1.5, vy: -0.1}
  sensor:
    kind: function
    h: {first: px**2, second: px*py + py**2}
    R: [0.8, 1.2]
  start: {kind: gaussian, sigma: [0.4, 0.2, 0.3, 0.3]}
"""


class Pendulums:
    """Motion and sensor, each by its formula."""

    config: ClassVar[str] = _HEAD + _PENDULUMS + _TAIL
    Q: ClassVar[Array] = np.diag([0.002, 0.01, 0.001, 0.02])
    R: ClassVar[Array] = np.diag([0.16, 0.16])

    def f(self, x: Array) -> Array:
        p, v, q, w = x
        return np.array([p + T * v, v - 4 * T * np.sin(p), q + T * w, w - 2 * T * np.sin(q)])

    def F(self, x: Array) -> Array:
        out = np.eye(4)
        out[0, 1] = out[2, 3] = T
        out[1, 0], out[3, 2] = -4 * T * np.cos(x[0]), -2 * T * np.cos(x[2])
        return out

    def h(self, x: Array) -> Array:
        return x[[0, 2]]

    def H(self, x: Array) -> Array:
        return np.eye(4)[[0, 2]]


class Squares:
    """Motion and sensor, each by its formula."""

    config: ClassVar[str] = _HEAD + _SQUARES + _TAIL
    Q: ClassVar[Array] = 0.05 * np.kron(np.eye(2), [[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    R: ClassVar[Array] = np.diag([0.8, 1.2])

    def f(self, x: Array) -> Array:
        return self.F(x) @ x

    def F(self, x: Array) -> Array:
        out = np.eye(4)
        out[0, 1] = out[2, 3] = T
        return out

    def h(self, x: Array) -> Array:
        return np.array([x[0] ** 2, x[0] * x[2] + x[2] ** 2])

    def H(self, x: Array) -> Array:
        return np.array([[2 * x[0], 0, 0, 0], [x[2], 0, x[0] + 2 * x[2], 0]])


FORMULAS = {"nonlinear motion": Pendulums(), "nonlinear sensor": Squares()}
State = tuple[Array, Array]


@dataclass(frozen=True)
class Extended:
    """Extended Kalman filter: x = f(x), P = F P F' + Q; K = P H' S^-1 with H at the prediction."""

    def steps(self, of: Any, x: Array, P: Array, z: Array) -> Iterator[State]:
        for row in z:
            F = of.F(x)
            x, P = of.f(x), F @ P @ F.T + of.Q
            if not np.isnan(row).all():
                x, P = self.updated(of, x, P, row)
            yield x, P

    def updated(self, of: Any, x: Array, P: Array, z: Array) -> State:
        H = of.H(x)
        S = H @ P @ H.T + of.R
        K = P @ H.T @ np.linalg.inv(S)
        return x + K @ (z - of.h(x)), P - K @ S @ K.T


class Iterated(Extended):
    """Iterated EKF: linearized at the last iterate until it stands (Gauss-Newton)."""

    def updated(self, of: Any, x: Array, P: Array, z: Array) -> State:
        at = x
        for _ in range(1000):
            H = of.H(at)
            S = H @ P @ H.T + of.R
            K = P @ H.T @ np.linalg.inv(S)
            before, at = at, x + K @ (z - of.h(at) - H @ (x - at))
            if np.abs(at - before).max() < 1e-12:
                return at, P - K @ S @ K.T
        raise ValueError("the iteration does not converge")


def lower_root(P: Array) -> Array:
    return np.linalg.cholesky(P)


def symmetric_root(P: Array) -> Array:
    values, vectors = np.linalg.eigh(P)
    return vectors * np.sqrt(values) @ vectors.T


def simplex(n: int) -> Array:
    """Return the n + 1 corners (n, n + 1) of a regular simplex, of unit covariance.

    Moireau & Chapelle 2011, eqs. 2.6 to 2.8.
    """
    a = n / (n + 1)
    corners = np.array([[-1.0, 1.0]]) / np.sqrt(2 * a)
    for d in range(2, n + 1):
        row = np.ones(d + 1)
        row[-1] = -d
        wider = np.hstack([corners, np.zeros((d - 1, 1))])
        corners = np.vstack([wider, row / np.sqrt(a * d * (d + 1))])
    return np.sqrt(n) * corners


@dataclass(frozen=True)
class SigmaPoints:
    """Sigma-point filter that draws points anew from the prediction; noises are additive.

    Points x +- root((n + lambda) P), lambda = alpha^2 (n + kappa) - n; the covariance's weight of the
    mean point is larger by 1 - alpha^2 + beta (van der Merwe 2004, eq. 3.12).
    """

    alpha: float = 1.0
    beta: float = 0.0
    kappa: float = 0.0
    is_simplex: bool = False
    root: Callable[[Array], Array] = lower_root

    def points(self, x: Array, P: Array) -> tuple[Array, Array, Array]:
        """Return points (S, n) and their weights for means and covariances (S,)."""
        n = len(x)
        if self.is_simplex:
            weights = np.full(n + 1, 1 / (n + 1))
            return x + (self.root(P) @ simplex(n)).T, weights, weights
        c = self.alpha**2 * (n + self.kappa)
        L = np.sqrt(c) * self.root(P)
        mean_weights = np.full(2 * n + 1, 0.5 / c)
        mean_weights[0] = 1.0 - n / c
        cov_weights = mean_weights.copy()
        cov_weights[0] += 1.0 - self.alpha**2 + self.beta
        return x + np.vstack([np.zeros(n), L.T, -L.T]), mean_weights, cov_weights

    def steps(self, of: Any, x: Array, P: Array, z: Array) -> Iterator[State]:
        for row in z:
            points, w, c = self.points(x, P)
            moved = np.array([of.f(p) for p in points])
            x = w @ moved
            P = (moved - x).T * c @ (moved - x) + of.Q
            if not np.isnan(row).all():
                points, w, c = self.points(x, P)
                seen = np.array([of.h(p) for p in points])
                expected = w @ seen
                S = (seen - expected).T * c @ (seen - expected) + of.R
                K = (points - x).T * c @ (seen - expected) @ np.linalg.inv(S)
                x, P = x + K @ (row - expected), P - K @ S @ K.T
            yield x, P


@dataclass(frozen=True)
class Augmented(SigmaPoints):
    """Sigma-point filter of state and both noises, with the same points in prediction and update."""

    def steps(self, of: Any, x: Array, P: Array, z: Array) -> Iterator[State]:
        n, m = len(x), len(of.R)
        for row in z:
            joint = np.zeros((2 * n + m, 2 * n + m))
            joint[:n, :n], joint[n : 2 * n, n : 2 * n], joint[2 * n :, 2 * n :] = P, of.Q, of.R
            points, w, c = self.points(np.concatenate([x, np.zeros(n + m)]), joint)
            moved = np.array([of.f(p[:n]) + p[n : 2 * n] for p in points])
            x = w @ moved
            P = (moved - x).T * c @ (moved - x)
            if not np.isnan(row).all():
                seen = np.array([of.h(q) + p[2 * n :] for q, p in zip(moved, points, strict=True)])
                expected = w @ seen
                S = (seen - expected).T * c @ (seen - expected)
                K = (moved - x).T * c @ (seen - expected) @ np.linalg.inv(S)
                x, P = x + K @ (row - expected), P - K @ S @ K.T
            yield x, P


EXTENDED = Extended()
CUBATURE = SigmaPoints()
"""2 n points of weight 1 / (2 n): that of the mean is zero for kappa = 0, alpha = 1 and beta = 0."""

Rule = Extended | SigmaPoints


def off_the_formulas(tracker: AnyFilter, rule: Rule, name: str) -> float:
    """Return the largest distance of estimates from the expected ones, in standard deviations."""
    of = FORMULAS[name]
    problem = ModelDraws(base=load(yaml.safe_load(of.config)).points[0].scenario)
    data = with_gaps(simulate(problem, _RUNS))
    tested = run_filter(tracker, problem, data)
    rules: list[Rule] = [rule]
    if isinstance(rule, SigmaPoints):
        # A package may take any root of a covariance.
        rules = [_with_root(rule, root) for root in (lower_root, symmetric_root)]
    return min(_distance(tested.mean, tested.cov, of, one, data) for one in rules)


def _with_root(rule: SigmaPoints, root: Callable[[Array], Array]) -> SigmaPoints:
    return type(rule)(rule.alpha, rule.beta, rule.kappa, rule.is_simplex, root)


def _distance(mean: Array, cov: Array, of: Any, rule: Rule, data: Any) -> float:
    largest = 0.0
    for run in range(mean.shape[-1]):
        prior = data.prior.mean[:, run], np.asarray(data.prior.cov).reshape(4, 4, -1)[..., 0]
        for k, (x, P) in enumerate(rule.steps(of, *prior, data.measurements[..., run].T), 1):
            sigma = np.sqrt(np.diag(P))
            off = np.abs(mean[:, k, run] - x) / sigma
            off_P = np.abs(cov[:, :, k, run] - P) / np.outer(sigma, sigma)
            largest = max(largest, float(off.max()), float(off_P.max()))
    return largest
