"""Target `random-legs`: legs along and across the velocity, drawn anew in every run."""

from dataclasses import dataclass
from typing import Annotated, TypeVar

import numpy as np
from annotated_types import Interval

from trackbench.core.arrays import Array, Index
from trackbench.core.elementary import cos_sin
from trackbench.core.random_streams import Streams
from trackbench.field_types import NonNegative, Positive, Steps, Unit
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.targets.base import Flight, Target, measured_along
from trackbench.scenarios.targets.timeline import Timeline

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
    speed: Annotated[tuple[Positive, Positive], Unit("m/s")]
    """least and largest speed at first, m/s, in any direction"""
    legs: tuple[Number, Number]
    """least and largest number of legs"""
    leg_steps: tuple[Steps, Steps]
    """least and largest number of steps of a leg"""
    sigma_along: Annotated[NonNegative, Unit("m/s^2")]
    """standard deviation of a leg's acceleration along the velocity, m/s^2"""
    across: Annotated[NonNegative, Unit("m/s^2")]
    """largest acceleration of a leg across the velocity, to either side, m/s^2"""
    straight_steps: tuple[Steps, Steps] | None = None
    """least and largest number of steps of straight flight before each leg; default: none"""

    axes = 2

    def __post_init__(self) -> None:
        ranges: dict[str, tuple[float, float]] = {
            "speed": self.speed,
            "legs": self.legs,
            "leg_steps": self.leg_steps,
        }
        if self.straight_steps is not None:
            ranges["straight_steps"] = self.straight_steps
        for name, (low, high) in ranges.items():
            if low > high:
                raise ValueError(f"{name}: {low:g} is more than {high:g}")

    @property
    def why_no_bound(self) -> str | None:
        """Reason: every run flies another path."""
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
        """Draw the truth anew in each run, NaN after its last leg, and measure it.

        Of ``start`` (n_x, M) only the number M of runs is used: each run draws its first state, too.
        """
        runs = start.shape[1]
        truth = self._draw_states(len(timeline.steps), timeline.T, rng, runs)
        return measured_along(truth, timeline, sensor, rng, scans, runs)

    def _draw_states(self, steps: int, T: float, rng: Streams, runs: int) -> Array:
        """Draw states (4, K, M) at K = ``steps`` steps, T s apart, of M = ``runs`` runs.

        The first position is uniform over a square about the origin, of which the key ``area`` is half
        the side, m. A leg's acceleration along the velocity is normal, with the standard deviation
        ``sigma_along``. The one across it is uniform, at most ``across`` to either side.
        """
        # Step 1: draw the shares of the first state, and each leg's length and accelerations.
        x_share, y_share, speed_share, heading_share, number_share = rng.random((5, runs))
        number = _uniform_whole(self.legs, number_share)
        _, most = self.legs
        lengths = _uniform_whole(self.leg_steps, rng.random((most, runs)))
        across = self.across * (2.0 * rng.random((most, runs)) - 1.0)
        along = self.sigma_along * rng.standard_normal((most, runs))
        # Step 2: put straight flight before each leg.
        if self.straight_steps is not None:
            straight = _uniform_whole(self.straight_steps, rng.random((most, runs)))
            lengths = _alternating(straight, lengths)
            across = _alternating(np.zeros_like(across), across)
            along = _alternating(np.zeros_like(along), along)
            number = 2 * number  # straight stretches count as legs from here on
        # Step 3: last step of each leg, and of each run.
        ends = np.cumsum(lengths, axis=0)
        last = np.take_along_axis(ends, number[None] - 1, axis=0)[0]
        # Step 4: first state, anywhere in the area and in any direction.
        least_speed, largest_speed = self.speed
        speed = least_speed + (largest_speed - least_speed) * speed_share
        c, s = cos_sin(2.0 * np.pi * heading_share)
        px = self.area * (2.0 * x_share - 1.0)
        py = self.area * (2.0 * y_share - 1.0)
        state = np.stack([px, speed * c, py, speed * s])
        states = np.full((4, steps, runs), np.nan)
        states[:, 0] = state
        # Step 5: move by the current leg's acceleration; NaN after the last leg.
        for i in range(1, steps):
            # The current leg is the first one that has not ended before step i.
            leg = np.minimum((ends < i).sum(axis=0), len(ends) - 1)[None]
            forward = np.take_along_axis(along, leg, axis=0)[0]
            aside = np.take_along_axis(across, leg, axis=0)[0]
            state = _move(state, forward, aside, T)
            states[:, i] = np.where(i <= last, state, np.nan)
        return states


def _uniform_whole(ends: tuple[int, int], shares: Array) -> Index:
    """Map ``shares``, uniform on [0, 1), to whole numbers from the least to the largest of ``ends``.

    Each number is equally probable.
    """
    least, largest = ends
    return (least + np.floor(shares * (largest - least + 1))).astype(np.intp)


def _alternating(first: _Rows, second: _Rows) -> _Rows:
    """Alternate the rows of both (L, M): (2 L, M)."""
    return np.stack([first, second], axis=1).reshape(-1, first.shape[1])


def _move(state: Array, along: Array, across: Array, T: float) -> Array:
    """Move states (4, M) by T s of acceleration ``along`` and ``across`` (M,) the track, m/s^2.

    A positive ``across`` is to the left.
    """
    px, vx, py, vy = state
    speed = np.sqrt(vx * vx + vy * vy)
    # a = along (u, w) + across (-w, u), with (u, w) the direction of flight
    u = vx / speed
    w = vy / speed
    ax = along * u - across * w
    ay = along * w + across * u
    # p + v T + a T^2 / 2, v + a T
    half = 0.5 * T * T
    return np.stack([px + vx * T + half * ax, vx + ax * T, py + vy * T + half * ay, vy + ay * T])
