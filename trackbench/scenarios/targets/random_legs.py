"""A target that flies another path in every run: legs of random length and acceleration."""

from dataclasses import dataclass
from typing import Annotated, TypeVar

import numpy as np
from annotated_types import Interval

from trackbench.core.arrays import Array, Index
from trackbench.core.elementary import cos_sin
from trackbench.core.random_streams import Streams
from trackbench.field_types import NonNegative, Positive, Steps
from trackbench.models.sensors.base import Sensors
from trackbench.registry import register
from trackbench.scenarios.targets.base import Flight, Target, Timeline, measured_along

_Rows = TypeVar("_Rows", Array, Index)
Number = Annotated[int, Interval(ge=1, le=1000)]


@register("targets", "random-legs")
@dataclass(frozen=True, kw_only=True)
class RandomLegs(Target):
    """Legs of constant acceleration along and across the velocity, drawn anew in every run.

    The simulated problem of Greenberg, Yannay & Mannor 2023. Each step takes the acceleration at its
    beginning. After the last leg the target is gone: there is nothing to measure, and no error.
    """

    area: Positive
    """the first position is anywhere within so many metres of the origin along each axis"""
    speed: tuple[Positive, Positive]
    """least and largest speed at first, m/s, in any direction"""
    legs: tuple[Number, Number]
    """least and largest number of legs"""
    leg_steps: tuple[Steps, Steps]
    """least and largest number of steps of a leg"""
    sigma_along: NonNegative
    """standard deviation of a leg's acceleration along the velocity, m/s^2"""
    across: NonNegative
    """largest acceleration of a leg across the velocity, to either side, m/s^2"""
    straight_steps: tuple[Steps, Steps] | None = None
    """least and largest number of steps of straight flight before each leg; default: none"""

    axes = 2

    def __post_init__(self) -> None:
        ranges = {"speed": self.speed, "legs": self.legs, "leg_steps": self.leg_steps}
        for name, (low, high) in {
            **ranges,
            "straight_steps": self.straight_steps or (0, 0),
        }.items():
            if low > high:
                raise ValueError(f"{name}: {low:g} is more than {high:g}")

    @property
    def why_no_bound(self) -> str | None:
        """Return the reason: every run flies another path."""
        return "the target flies another path in every run"

    def start(self, timeline: Timeline) -> Array:
        """Return rest in the area's corner, as far from a sensor at the origin as possible."""
        return np.array([self.area, 0.0, self.area, 0.0])

    def path(self, timeline: Timeline) -> Array:
        """Return the first state at every step."""
        return np.repeat(self.start(timeline)[:, None], len(timeline.steps), axis=1)

    def fly(
        self, start: Array, timeline: Timeline, sensor: Sensors, rng: Streams, scans: int
    ) -> Flight:
        """Return the truth drawn anew, NaN after its last leg, and its measurements."""
        runs = start.shape[1]
        truth = self._flown(len(timeline.steps), timeline.T, rng, runs)
        return measured_along(truth, timeline, sensor, rng, scans, runs)

    def _flown(self, steps: int, T: float, rng: Streams, runs: int) -> Array:
        """Return states (4, K, M)."""
        # Step 1: draw the shares of the first state, and each leg's length and accelerations.
        x, y, share, heading, many = rng.random((5, runs))
        most, number = self.legs[1], _whole(self.legs, many)
        lengths = _whole(self.leg_steps, rng.random((most, runs)))
        across = self.across * (2.0 * rng.random((most, runs)) - 1.0)
        along = self.sigma_along * rng.standard_normal((most, runs))
        # Step 2: put straight flight before each leg.
        if self.straight_steps is not None:
            straight = _whole(self.straight_steps, rng.random((most, runs)))
            lengths, most, number = _alternating(straight, lengths), 2 * most, 2 * number
            across, along = (_alternating(np.zeros_like(a), a) for a in (across, along))
        # Step 3: last step of each leg, and of each run.
        ends = np.cumsum(lengths, axis=0)
        last = np.take_along_axis(ends, number[None] - 1, axis=0)[0]
        # Step 4: first state, anywhere in the area and in any direction.
        speed = self.speed[0] + (self.speed[1] - self.speed[0]) * share
        c, s = cos_sin(2.0 * np.pi * heading)
        state = np.stack(
            [self.area * (2.0 * x - 1.0), speed * c, self.area * (2.0 * y - 1.0), speed * s]
        )
        out = np.full((4, steps, runs), np.nan)
        out[:, 0] = state
        # Step 5: move by the current leg's acceleration; NaN after the last leg.
        for i in range(1, steps):
            leg = np.minimum((ends < i).sum(axis=0), most - 1)[None]
            forward, aside = (np.take_along_axis(a, leg, axis=0)[0] for a in (along, across))
            state = _moved(state, forward, aside, T)
            out[:, i] = np.where(i <= last, state, np.nan)
        return out


def _whole(ends: tuple[int, int], shares: Array) -> Index:
    """Return whole numbers from the least to the largest, each as probable."""
    return (ends[0] + np.floor(shares * (ends[1] - ends[0] + 1))).astype(np.intp)


def _alternating(first: _Rows, second: _Rows) -> _Rows:
    """Return rows (2 L, M) of both (L, M), one after the other."""
    return np.stack([first, second], axis=1).reshape(-1, first.shape[1])


def _moved(state: Array, along: Array, across: Array, T: float) -> Array:
    """Return the state (4, M) after T seconds of along- and cross-track acceleration, m/s^2."""
    px, vx, py, vy = state
    speed = np.sqrt(vx * vx + vy * vy)
    u, w = vx / speed, vy / speed
    # a = along (u, w) + across (-w, u), with (u, w) the direction of flight
    ax, ay = along * u - across * w, along * w + across * u
    # p + v T + a T^2 / 2, v + a T
    half = 0.5 * T * T
    return np.stack([px + vx * T + half * ax, vx + ax * T, py + vy * T + half * ay, vy + ay * T])
