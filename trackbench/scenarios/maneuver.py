"""Scenario `maneuver`: straight flight and turns of constant acceleration, seen by position."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.distributions import Gaussian
from trackbench.core.streams import Streams
from trackbench.core.sums import mean
from trackbench.keys import MOST_STEPS, MistakenKeyError, NonNegative, Positive
from trackbench.models.base import Model
from trackbench.models.linear import PositionSensor
from trackbench.models.motions import ConstantVelocity
from trackbench.registry import register
from trackbench.scenarios.base import Simulation, in_window
from trackbench.scenarios.legs import PAPER, Launch, Leg, check_legs
from trackbench.scenarios.onsets import Onsets

STRAY = 10.0
"""Error beyond which a track has strayed, in standard deviations of a measurement."""
_STRAIGHT = ConstantVelocity(q=0.0)


@register("scenarios", "maneuver")
@dataclass(frozen=True, kw_only=True)
class Maneuver:
    """A target that flies straight but for legs of constant acceleration, seen by its position.

    Tang, Sun & Liu, adaptive Kalman filter paper, section 4. The truth is the same in every run, only
    the measurement noise differs. The first two measurements give every filter its prior, by
    differencing (the paper does not say how a filter starts): x = z_1, v = (z_1 - z_0) / T.
    """

    T: Positive = 1.0
    """sampling time, s"""
    duration: Positive = 1700.0
    """time of the last measurement, s"""
    truth: Literal["corrected", "as-printed"] = "corrected"
    """the paper's own track, with its misprints corrected or not; used where legs are not given"""
    launch: Launch | None = None
    """position and velocity at time zero; default: the paper's"""
    legs: tuple[Leg, ...] | None = None
    """turns, in order, no two at once; default: the paper's five; [] is straight flight"""
    sigma: Positive = 100.0
    """standard deviation of a measured position, per axis, m"""
    motion: ConstantVelocity = _STRAIGHT
    """what a filter without a motion of its own assumes"""
    score_from: NonNegative = 20.0
    """errors count from this time, s; the paper's detector starts with the twentieth sample"""
    settle: NonNegative = 100.0
    """time after a turn that is neither turn nor quiet, s"""
    edge: Positive = 50.0
    """length of a turn's start, and of the stretch after its end where an overshoot is looked for, s"""
    lost_beyond: Positive | None = None
    """error beyond which a run counts as lost and is left out, m; default: none, so that a filter that
    diverges stays in every number; the metric `strayed` says in how many runs it does"""

    def __post_init__(self) -> None:
        check_legs(self.turns, self.duration)
        if self.duration > MOST_STEPS * self.T:
            raise MistakenKeyError(
                f"{self.duration:g} s hold over {MOST_STEPS} samples", "duration"
            )
        if self.duration < 3 * self.T:
            raise MistakenKeyError(f"{self.duration:g} s hold fewer than three samples", "duration")
        if self.score_from > self.times[-1]:
            raise MistakenKeyError(f"no sample after {self.score_from:g} s", "score_from")

    @property
    def turns(self) -> tuple[Leg, ...]:
        """The legs that are flown."""
        return PAPER[self.truth][1] if self.legs is None else self.legs

    @property
    def model(self) -> Model:
        """Constant velocity, and the sensor."""
        return Model(self.motion.sampled(self.T), PositionSensor(self.sigma))

    @property
    def steps(self) -> Index:
        """From the second measurement (the prior's) to the last."""
        return np.arange(1, int(round(self.duration / self.T, 9)) + 1)

    @property
    def times(self) -> Array:
        """Sampling times, s."""
        return np.asarray(self.steps * self.T, dtype=float)

    @property
    def windows(self) -> dict[str, Mask]:
        """All that is scored; ``quiet``: settled straight flight; of the turns, if there are any:

        ``before`` the first one, ``turns`` and each ``leg n``, their ``starts`` and each ``start n``.
        """
        scored, inside, starts = self.times >= self.score_from, self._inside, self._starts
        out = {"": scored}
        if self.turns:
            out["before"] = scored & (self.times <= self.turns[0].start)
            out["turns"] = scored & inside.any(axis=0)
            out["starts"] = scored & starts.any(axis=0)
        out |= {f"leg {n}": scored & during for n, during in enumerate(inside, 1)}
        out |= {f"start {n}": scored & during for n, during in enumerate(starts, 1)}
        out["quiet"] = scored & self._quiet
        return {name: mask for name, mask in out.items() if mask.any()}

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end of each turn, s: what a figure shades."""
        return [(leg.start, leg.end) for leg in self.turns]

    @property
    def _inside(self) -> Mask:
        t = self.times
        during = [(t > leg.start) & (t <= leg.end) for leg in self.turns]
        return np.array(during, dtype=np.bool_).reshape(len(during), len(t))

    @property
    def _starts(self) -> Mask:
        late = [self.times > leg.start + self.edge for leg in self.turns]
        return self._inside & ~np.array(late, dtype=np.bool_).reshape(self._inside.shape)

    @property
    def _ends(self) -> Mask:
        """The stretch after each turn's end (legs, K), as far as no other turn covers it."""
        t = self.times
        after = [(t > leg.end) & (t <= leg.end + self.edge) for leg in self.turns]
        straight = ~self._inside.any(axis=0) & (t >= self.score_from)
        return np.array(after, dtype=np.bool_).reshape(self._inside.shape) & straight

    @property
    def _quiet(self) -> Mask:
        t, quiet = self.times, np.ones(len(self.times), dtype=np.bool_)
        for leg in self.turns:
            quiet &= (t <= leg.start) | (t > leg.end + self.settle)
        return quiet

    def path(self, t: Array) -> Array:
        """Exact state (4, len(t)) at times t: each leg adds its acceleration's two integrals."""
        start = self.launch or PAPER[self.truth][0]
        px, py = start.x + start.vx * t, start.y + start.vy * t
        vx, vy = np.full_like(t, start.vx), np.full_like(t, start.vy)
        for leg in self.turns:
            since, after = np.maximum(t - leg.start, 0.0), np.maximum(t - leg.end, 0.0)
            speed, distance = since - after, (since * since - after * after) / 2
            px, py = px + leg.ax * distance, py + leg.ay * distance
            vx, vy = vx + leg.ax * speed, vy + leg.ay * speed
        return np.stack([px, vx, py, vy])

    def simulate(self, rng: Streams, runs: int) -> Simulation:
        """Noisy positions along the path; the prior by two-point differencing."""
        path = self.path(np.concatenate([[0.0], self.times]))
        noise = rng.standard_normal((2, path.shape[1], runs))
        z = path[[0, 2], :, None] + self.sigma * noise
        velocity = (z[:, 1] - z[:, 0]) / self.T
        mean = np.stack([z[0, 1], velocity[0], z[1, 1], velocity[1]])
        T, R = self.T, self.sigma * self.sigma
        axis = R * np.array([[1.0, 1.0 / T], [1.0 / T, 2.0 / (T * T)]])
        prior = Gaussian(mean, np.asarray(np.kron(np.eye(2), axis), dtype=float))
        truth = np.broadcast_to(path[:, 1:, None], (4, len(self.steps), runs))
        return Simulation(truth, z[:, 2:], prior)

    def errors(self, mean: Array, truth: Array) -> dict[str, Array]:
        """Vectors of position (m) and velocity (m/s), and the position's two components."""
        e = mean - truth
        return {"position": e[0:4:2], "velocity": e[1:4:2], "x": e[:1], "y": e[2:3]}

    def run_metrics(self, values: dict[str, Array]) -> dict[str, Array]:
        """Peaks and overshoots, and how a filter that switches meets the onsets of the turns.

        ``peak_position`` largest error in a window, m; ``strayed`` 1 where it was over ten standard
        deviations of a measurement: none would be taken for the track's any more. ``overshoot_m[leg n]``
        mean error along the turn's acceleration after its end.
        """
        squared, windows = values["squared_position"], self.windows
        peaks = {name: np.sqrt(squared[mask].max(axis=0)) for name, mask in windows.items()}
        out = {in_window("peak_position", name): peak for name, peak in peaks.items()}
        strayed = (peaks[""] > STRAY * self.sigma).astype(float)
        out["strayed"] = np.where(np.isnan(peaks[""]), np.nan, strayed)
        if "error_x" in values:
            out |= self._overshoots(values["error_x"], values["error_y"])
        if "mode" in values:
            starts = tuple(leg.start for leg in self.turns)
            quiet = (self.times >= self.score_from) & self._quiet
            onsets = Onsets(self.times, starts, self._inside, quiet)
            out |= onsets.metrics(values["mode"], values.get("alarm"), values.get("alarm_age_s"))
        return out

    def _overshoots(self, x: Array, y: Array) -> dict[str, Array]:
        """From signed errors (K, M): a filter that still turns is ahead, on the side it turned to."""
        out = {}
        for n, (leg, after) in enumerate(zip(self.turns, self._ends, strict=True), 1):
            size = np.sqrt(leg.ax * leg.ax + leg.ay * leg.ay)
            if after.any() and size > 0.0:
                ahead = (leg.ax * x[after] + leg.ay * y[after]) / size
                out[f"overshoot_m[leg {n}]"] = mean(ahead, axis=0)
        return out
