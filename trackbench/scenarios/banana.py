"""Scenario `banana`: a distant target seen with a sharp range and a blunt azimuth."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from annotated_types import Interval

from trackbench.core import linalg
from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.bounds import posterior_cramer_rao
from trackbench.core.conversions import position, rotated
from trackbench.core.elementary import cos_sin
from trackbench.core.streams import Streams
from trackbench.keys import MOST_STEPS, Finite, Natural, NonNegative, Positive
from trackbench.models.base import Model
from trackbench.models.linear import CWNA
from trackbench.models.radar import RangeAzimuth, wrapped
from trackbench.models.twopoint import TwoPoint
from trackbench.registry import register
from trackbench.scenarios.base import Simulation, simulate_markov

_IN_A_ROW = 10  # scans at the end of a run


@register("scenarios", "banana")
@dataclass(frozen=True, kw_only=True)
class Banana:
    """A target in white-noise acceleration, seen in range and azimuth from the origin.

    Chandrasekaran, Shashikiran & Krishnaveni, banana paper, section II, eqs. 3-8. The first two scans
    make the prior; filters are updated from the third. Only the cross speed matters beside the
    geometry: r'' = v_c^2 / r, so the sharp range tells its square and leaves its sign open.
    """

    range_km: Positive = 2711.549
    """range at the first scan; the paper prints 50 km and 2711.5 km"""
    azimuth_deg: Finite = 67.2176
    """azimuth at the first scan"""
    velocity_radial: Finite = 0.0
    """initial speed away from the radar, m/s (not printed)"""
    velocity_cross: Finite = 5000.0
    """initial speed across the line of sight, anticlockwise, m/s (not printed)"""
    scans: Annotated[int, Interval(ge=3, le=MOST_STEPS)] = 100
    """number of scans, the two that make the prior included (not printed)"""
    T: Positive = 1.0
    """time between scans, s"""
    q: NonNegative = 1e-3
    """power spectral density of the acceleration, m^2/s^3"""
    sigma_range: Positive = 0.2
    """standard deviation of the range, m"""
    sigma_azimuth_mrad: Positive = 2.0
    """standard deviation of the azimuth, mrad"""
    rmse_window: tuple[int, int] | None = None
    """first and last scan over which errors are averaged (not printed); default: from the second on"""
    until: tuple[Natural, ...] = ()
    """earlier last scans of further averages, each with its name: `rmse_position[k<=50]`"""
    lost_sigmas: Positive | None = 10.0
    """a run is lost once its position is off by more than so many times what one azimuth leaves, r
    sigma_azimuth at the first scan; null: never"""

    def __post_init__(self) -> None:
        first, last = self._window
        if not 2 <= first <= last <= self.scans:
            raise ValueError(f"rmse_window [{first}, {last}] is not within scans 2 to {self.scans}")
        if not all(first <= end <= last for end in self.until):
            raise ValueError(f"until {list(self.until)} is not within scans {first} to {last}")

    @property
    def _window(self) -> tuple[int, int]:
        return self.rmse_window or (2, self.scans)

    @cached_property
    def _motion(self) -> CWNA:
        return CWNA(self.T, self.q)

    @cached_property
    def _sensor(self) -> RangeAzimuth:
        return RangeAzimuth(self.sigma_range, 1e-3 * self.sigma_azimuth_mrad)

    @property
    def model(self) -> Model:
        """Motion and sensor."""
        return Model(self._motion, self._sensor)

    @property
    def steps(self) -> Index:
        """Scans 2 (the prior's) to the last."""
        return np.arange(2, self.scans + 1)

    @property
    def times(self) -> Array:
        """Time since the first scan, s."""
        return np.asarray((self.steps - 1) * self.T)

    @property
    def windows(self) -> dict[str, Mask]:
        """The scans of ``rmse_window``, and those up to each scan of ``until``."""
        first, last = self._window
        ends = {"": last} | {f"k<={end}": end for end in self.until}
        return {name: (self.steps >= first) & (self.steps <= end) for name, end in ends.items()}

    @property
    def lost_beyond(self) -> float | None:
        """Position error beyond which a run counts as lost, m.

        Ten deviations: no measured azimuth is off by that, so any single scan is nearer to the target
        than the track is, and none that was as far off has come back.
        """
        if self.lost_sigmas is None:
            return None
        return self.lost_sigmas * self.range_km * self.sigma_azimuth_mrad

    @property
    def marginals(self) -> dict[str, tuple[int, ...]]:
        """Parts of the state with a consistency measure of their own."""
        return {"position": self._sensor.position}

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Every run starts at the same state; the first two scans of each are its prior."""
        start = np.tile(self._start[:, None], runs)
        first = self._sensor.measurement(start, 1).sample(rng)
        truth, seen = simulate_markov(self.model, start, np.arange(1, self.scans + 1), rng)
        prior = TwoPoint(self._sensor, first, seen[:, 0], self.T, self.q)
        return Simulation(truth[:, 1:], seen[:, 1:], prior)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Vector errors, and signed ones in polar coordinates and along and across the line of sight."""
        e = mean - truth
        (r, a), (r_true, a_true) = self._sensor.polar(mean), self._sensor.polar(truth)
        c, s = cos_sin(a_true)
        return {
            "position": e[0::2],
            "velocity": e[1::2],
            "range": (r - r_true)[None],
            "azimuth_deg": np.rad2deg(wrapped(a - a_true))[None],
            "radial": (c * e[0] + s * e[2])[None],
            "cross": (c * e[2] - s * e[0])[None],
        }

    def observables(self, x: Array) -> dict[str, Array]:
        """Functions of the state whose posterior means are scored beside the mean state's own."""
        return {"mean_range": self._sensor.range(x)}

    def run_metrics(self, values: dict[str, Array]) -> dict[str, Array]:
        """``diverged`` (M,): whether each of the last ten estimates is outside its own 1e-6 region.

        Such a track need not be far from the target to mislead: it will not come back by what it
        believes. It is no lost run, whose error would leave the averages: an overconfident filter is
        not to be better for it.
        """
        last = values.get("outside", np.full((1, 1), np.nan))[-_IN_A_ROW:]
        return {"diverged": last.min(axis=0)}  # NaN if one is

    def bounds(self) -> dict[str, Array]:
        """Posterior Cramer-Rao bound on every RMSE (T + 1,), along the path without process noise.

        It starts from the two-point covariance at the truth, which knows no velocity beforehand.
        """
        path = self._path()
        P = posterior_cramer_rao(
            self._initial_bound(path), self._motion.F, self._motion.Q, self._information(path)
        )
        J = self._sensor.jacobian(path[:, 1:], 0)
        polar = linalg.sandwich(J, P)
        a = self._sensor.polar(path[:, 1:])[1]
        c, s = cos_sin(a)
        frame = np.stack([np.stack([c, s]), np.stack([-s, c])])
        seen = linalg.sandwich(frame, P[0::2, 0::2])
        squares = {
            "position": P[0, 0] + P[2, 2],
            "velocity": P[1, 1] + P[3, 3],
            "range": polar[0, 0],
            "mean_range": polar[0, 0],
            "azimuth_deg": np.rad2deg(np.rad2deg(polar[1, 1])),
            "radial": seen[0, 0],
            "cross": seen[1, 1],
        }
        return {name: np.sqrt(square) for name, square in squares.items()}

    @cached_property
    def _start(self) -> Array:
        a = np.array(np.deg2rad(self.azimuth_deg))
        u, w = position(np.array(1.0), a), position(np.array(1.0), a + 0.5 * np.pi)
        velocity = self.velocity_radial * u + self.velocity_cross * w
        out = np.empty(4)
        out[0::2], out[1::2] = 1e3 * self.range_km * u, velocity
        return out

    def _path(self) -> Array:
        """States (4, scans) without process noise."""
        path = [self._start]
        for _ in range(self.scans - 1):
            path.append(linalg.matvec(self._motion.F, path[-1]))
        return np.stack(path, axis=-1)

    def _initial_bound(self, path: Array) -> Array:
        r, a = self._sensor.polar(path[:, :2])
        across = np.square(r) * self._sensor.R[1, 1]
        R = rotated(self._sensor.R[0, 0], across, a)
        P = np.empty((4, 4))
        P[0::2, 0::2] = R[..., 1]
        P[0::2, 1::2] = P[1::2, 0::2] = R[..., 1] / self.T
        P[1::2, 1::2] = (R[..., 0] + R[..., 1]) / (
            self.T * self.T
        ) + self.q * self.T / 3.0 * np.eye(2)
        return P

    def _information(self, path: Array) -> Iterator[Array]:
        R_inverse = linalg.inverse(self._sensor.R)
        for x in path[:, 2:].T:
            H = self._sensor.jacobian(x, 0)
            yield linalg.sandwich(H.T, R_inverse)
