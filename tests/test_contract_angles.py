"""The contract finds filters that are wrong where an angle passes its cut, and accuses no right one."""

import math
from typing import Any, ClassVar

import numpy as np
import pytest

from tests.planted import problem, with_bug
from trackbench.adapters import PerRun
from trackbench.contract.checks import CHECKS
from trackbench.contract.findings import Finding
from trackbench.contract.run_contract import check_filter, run_check
from trackbench.core.arrays import Array

PI, TURN = math.pi, 2.0 * math.pi

RADAR = """
name: radar
scenario:
  kind: tracking
  T: 2
  last: 20
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {x: 9000, y: 3000, vx: -10, vy: -60}}
  sensor: {kind: range-azimuth, sigma_range: 50, sigma_azimuth_mrad: 3, at: [500, -200]}
  start: two-scan
filters: {}
"""
COMPASS = """
name: compass
scenario:
  kind: tracking
  T: 1
  last: 20
  target:
    kind: driven
    motion:
      kind: map
      components: [x, y, heading, speed]
      next: {x: x + T*speed*cos(heading), y: y + T*speed*sin(heading), heading: heading, speed: speed}
      Q: {x: 0.01, y: 0.01, heading: 0.0025, speed: 0.01}
      angles: [heading]
    initial: {x: 10, y: 20, heading: 0.4, speed: 3}
  sensor:
    kind: function
    h: {x: x, y: y, compass: heading}
    angles: [compass]
    R: {x: 4, y: 4, compass: 0.01}
  start: {kind: gaussian, sigma: [2, 2, 0.2, 0.3]}
filters: {}
"""
WANDERING = """
name: wandering
scenario:
  kind: tracking
  T: 1
  last: 40
  target:
    kind: driven
    motion:
      kind: map
      components: [heading, rate]
      next: {heading: heading + T*rate, rate: rate}
      Q: {heading: 0.003, rate: 0.002}
      angles: [heading]
    initial: {heading: 0, rate: 0}
  sensor: {kind: function, h: {compass: heading, gyro: rate}, angles: [compass], R: [0.04, 0.09]}
  start: {kind: gaussian, sigma: [0.5, 0.05]}
filters: {}
"""


def around(angle: float, center: float = 0.0) -> float:
    """Shift an angle by whole turns to within half a turn of another."""
    return angle - TURN * round((angle - center) / TURN)


class HandEKF(PerRun):
    """An EKF of a radar by hand; ``bug`` names how it treats the azimuth."""

    bug: ClassVar[str] = ""
    state: ClassVar[tuple[str, ...]] = ("px", "vx", "py", "vy")
    measured: ClassVar[tuple[str, ...]] = ("range", "azimuth")

    def start(self, mean: Array, cov: Array) -> None:
        self.x, self.P = mean, cov

    def difference(self, z: float, expected: float) -> float:
        nu = z - expected
        if self.bug == "no wrap":
            return nu
        if self.bug == "wraps down only":
            return nu - TURN if nu > PI else nu
        if self.bug == "wraps up only":
            return nu + TURN if nu < -PI else nu
        if self.bug == "predicts from 0 to 2 pi":
            return z - expected % TURN
        if self.bug == "counts from 0 to 2 pi":
            return z % TURN - expected % TURN
        if self.bug == "counts from north":
            return (PI / 2 - expected) % TURN - (PI / 2 - z) % TURN
        if self.bug == "right, from 0 to 2 pi":
            return around(z % TURN - expected % TURN)
        if self.bug == "right, by one turn":
            return nu - TURN if nu > PI else nu + TURN if nu < -PI else nu
        return math.atan2(math.sin(nu), math.cos(nu))

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        F, Q = np.eye(4), np.kron(np.eye(2), [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        F[0, 1] = F[2, 3] = dt
        self.x, self.P = F @ self.x, F @ self.P @ F.T + Q
        if z is not None:
            self.update(z)
        return self.x, self.P

    def update(self, z: Array) -> None:
        dx, dy = self.x[0] - 500.0, self.x[2] + 200.0
        r = math.hypot(dx, dy)
        H = np.array([[dx / r, 0, dy / r, 0], [-dy / r**2, 0, dx / r**2, 0]])
        azimuth = math.atan2(dy, dx)
        nu = np.array([z[0] - r, self.difference(z[1], azimuth)])
        S = H @ self.P @ H.T + np.diag([50.0**2, 0.003**2])
        if self.bug == "gate" and nu[1] ** 2 > 25.0 * S[1, 1]:
            return
        K = self.P @ H.T @ np.linalg.inv(S)
        self.x = self.x + K @ nu
        self.P = self.P - K @ S @ K.T


class HandUKF(HandEKF):
    """A UKF of a radar by hand."""

    def update(self, z: Array) -> None:
        L = np.linalg.cholesky(self.P)
        points = self.x + 2.0 * np.concatenate([L.T, -L.T])
        dx, dy = points[:, 0] - 500.0, points[:, 2] + 200.0
        seen = np.stack([np.hypot(dx, dy), np.arctan2(dy, dx)], axis=1)
        mean = seen.mean(axis=0)
        if self.bug != "mean on the line":
            mean[1] = math.atan2(np.sin(seen[:, 1]).mean(), np.cos(seen[:, 1]).mean())
        off = seen - mean
        if self.bug != "sigma points not wrapped":
            off[:, 1] = np.arctan2(np.sin(off[:, 1]), np.cos(off[:, 1]))
        S = off.T @ off / 8.0 + np.diag([50.0**2, 0.003**2])
        K = (points - self.x).T @ off / 8.0 @ np.linalg.inv(S)
        self.x = self.x + K @ [z[0] - mean[0], self.difference(z[1], mean[1])]
        self.P = self.P - K @ S @ K.T


class HandCompass(PerRun):
    """An EKF, or a UKF, of a vehicle that measures its position and heading."""

    bug: ClassVar[str] = ""
    state: ClassVar[tuple[str, ...]] = ("x", "y", "heading", "speed")
    measured: ClassVar[tuple[str, ...]] = ("x", "y", "compass")

    def start(self, mean: Array, cov: Array) -> None:
        self.x, self.P = mean, cov

    def moved(self, x: Array, dt: float) -> Array:
        heading = x[2]
        if self.bug in ("state wrapped, innovation not", "state wrapped", "points wrapped"):
            heading = around(heading)
        if self.bug == "state from 0 to 2 pi":
            heading = heading % TURN
        step = dt * x[3] * np.array([math.cos(x[2]), math.sin(x[2])])
        return np.array([*(x[:2] + step), heading, x[3]])

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        Q = np.diag([0.01, 0.01, 0.0025, 0.01])
        if self.bug == "points wrapped":
            L = np.linalg.cholesky(self.P)
            points = np.array([self.moved(x, dt) for x in self.x + 2.0 * np.r_[L.T, -L.T]])
            self.x = points.mean(axis=0)
            self.P = (points - self.x).T @ (points - self.x) / 8.0 + Q
        else:
            c, s, v = math.cos(self.x[2]), math.sin(self.x[2]), self.x[3]
            F = np.eye(4)
            F[0, 2:], F[1, 2:] = [-dt * v * s, dt * c], [dt * v * c, dt * s]
            self.x, self.P = self.moved(self.x, dt), F @ self.P @ F.T + Q
        if z is not None:
            H = np.eye(3, 4)
            nu = z - H @ self.x
            if self.bug not in ("no wrap", "state wrapped, innovation not"):
                nu[2] = around(nu[2])
            S = H @ self.P @ H.T + np.diag([4.0, 4.0, 0.01])
            K = self.P @ H.T @ np.linalg.inv(S)
            self.x = self.x + K @ nu
            self.P = self.P - K @ S @ K.T
        return self.x, self.P


class HandWandering(PerRun):
    """A Kalman filter of a heading that wanders: it passes a cut in most runs, wherever it begins."""

    bug: ClassVar[str] = ""
    state: ClassVar[tuple[str, ...]] = ("heading", "rate")
    measured: ClassVar[tuple[str, ...]] = ("compass", "gyro")

    def start(self, mean: Array, cov: Array) -> None:
        self.x, self.P = mean, cov

    def step(self, z: Array | None, dt: float) -> tuple[Array, Array]:
        F = np.array([[1.0, dt], [0.0, 1.0]])
        self.x, self.P = F @ self.x, F @ self.P @ F.T + np.diag([0.003, 0.002])
        if z is not None:
            nu = z - self.x
            if self.bug != "no wrap":
                nu[0] = around(nu[0])
            S = self.P + np.diag([0.04, 0.09])
            if self.bug == "gate" and nu[0] ** 2 > 10.0 * S[0, 0]:
                return self.x, self.P
            K = self.P @ np.linalg.inv(S)
            self.x, self.P = self.x + K @ nu, self.P - K @ S @ K.T
        return self.x, self.P


ON = {HandEKF: RADAR, HandUKF: RADAR, HandCompass: COMPASS, HandWandering: WANDERING}
WRONG = {
    HandEKF: (
        "no wrap",
        "wraps down only",
        "wraps up only",
        "counts from 0 to 2 pi",
        "counts from north",
    ),
    HandUKF: ("no wrap", "mean on the line", "sigma points not wrapped"),
    HandCompass: ("no wrap", "state wrapped, innovation not", "points wrapped"),
    HandWandering: ("no wrap",),
}
RIGHT = {
    HandEKF: ("", "right, from 0 to 2 pi", "right, by one turn", "gate"),
    HandUKF: ("",),
    HandCompass: ("", "state wrapped", "state from 0 to 2 pi"),
    HandWandering: ("", "gate"),
}
NAMED = {"no wrap", "wraps down only", "wraps up only", "state wrapped, innovation not"}


def findings(base: type[Any], bug: str) -> list[Finding]:
    cls = with_bug(base, bug)
    return list(check_filter(cls, cls(), on=problem(ON[base])))


@pytest.mark.parametrize(("base", "bug"), [(b, bug) for b, bugs in WRONG.items() for bug in bugs])
def test_a_filter_that_is_wrong_at_a_cut_is_found(base: type[Any], bug: str) -> None:
    """The check of the angles finds it; `test_a_right_filter_is_good` runs all checks."""
    name, check = CHECKS["angles"]
    finding = run_check(name, check, with_bug(base, bug)(), problem(ON[base]))
    assert finding.verdict == "bad"
    angle = "azimuth" if base in (HandEKF, HandUKF) else "compass"
    if bug in NAMED:
        assert f"the innovation of {angle} is not wrapped" in finding.why
    assert angle in finding.why or "heading" in finding.why


def test_a_prediction_from_0_to_2_pi_is_found() -> None:
    """It goes wrong in half of the plane, so its errors show it rather than its behavior at a cut."""
    found = findings(HandEKF, "predicts from 0 to 2 pi")
    assert any(finding.verdict == "bad" and "azimuth" in finding.why for finding in found)


@pytest.mark.parametrize(("base", "bug"), [(b, bug) for b, bugs in RIGHT.items() for bug in bugs])
def test_a_right_filter_is_good(base: type[Any], bug: str) -> None:
    bad = [finding for finding in findings(base, bug) if finding.verdict == "bad"]
    assert bad == []
