"""Target `legs`: straight flight with legs of constant acceleration or turn rate."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from trackbench.core.arrays import Array, Mask
from trackbench.core.sums import mean
from trackbench.durations import time_text
from trackbench.field_types import Finite, InvalidKeyError, NonNegative, Positive, Unit
from trackbench.models.motions.coordinated_turn import turn_state
from trackbench.registry import register
from trackbench.scenarios.settling_time import settling_metrics
from trackbench.scenarios.targets.base import Flown
from trackbench.scenarios.targets.initial_state import Launch
from trackbench.scenarios.targets.large_turns import turn_caution
from trackbench.scenarios.targets.maneuver_detection import Onsets
from trackbench.scenarios.targets.peak_errors import Scored
from trackbench.scenarios.targets.timeline import Timeline


@dataclass(frozen=True, kw_only=True)
class Leg:
    """A stretch of constant acceleration, or of a constant turn rate."""

    start: NonNegative
    """s"""
    end: Positive
    """s"""
    ax: Finite = 0.0
    """m/s^2"""
    ay: Finite = 0.0
    """m/s^2"""
    az: Finite = 0.0
    """m/s^2"""
    turn_rate_deg_s: Annotated[Finite, Unit("deg/s")] = 0.0
    """turn at constant speed in the plane, deg/s, positive from x to y"""

    def __post_init__(self) -> None:
        if self.turn_rate_deg_s and any(self.acceleration):
            raise ValueError("a leg has an acceleration or a turn rate, not both")

    @property
    def acceleration(self) -> tuple[float, float, float]:
        """(ax, ay, az), m/s^2."""
        return self.ax, self.ay, self.az

    @property
    def size(self) -> float:
        """Size of the acceleration, m/s^2; zero of a turn at a constant rate."""
        ax, ay, az = self.acceleration
        return float(np.sqrt(ax * ax + ay * ay + az * az))


@register("targets", "legs")
@dataclass(frozen=True, kw_only=True)
class Legs(Flown):
    """A target that flies straight but for legs of constant acceleration or turn rate.

    The truth is the same in every run, only the measurements differ (adaptive Kalman filter paper,
    section 4).
    """

    launch: Launch
    """position and velocity at time zero"""
    legs: tuple[Leg, ...] = ()
    """turns, in order, no two at once; [] is straight flight"""
    settle: Annotated[NonNegative, Unit("s")] = 100.0
    """time after a turn that is neither turn nor quiet, s"""
    edge: Annotated[Positive, Unit("s")] = 50.0
    """length of a turn's start, and of the stretch after its end where an overshoot is looked for, s"""
    settled_error: Annotated[Positive, Unit("m")] | None = None
    """largest position error of a filter that has settled after a turn, m; default: not measured"""

    @property
    def axes(self) -> int:
        """Axes of the space it moves in."""
        return self.launch.axes

    def check(self, timeline: Timeline) -> None:
        """Raise InvalidKeyError unless the legs are in order, do not overlap, and end within the run.

        The type of `Leg.start` makes sure that no leg starts before time zero.
        """
        end = float(timeline.times[-1])
        for n, leg in enumerate(self.legs):
            if leg.end <= leg.start:
                raise InvalidKeyError(f"leg {n + 1} ends before it starts", *_LEGS_KEY, n, "end")
            if leg.end > end:
                message = f"leg {n + 1} ends at {time_text(leg.end)} s, after the run's end at "
                message += f"{time_text(end)} s"
                raise InvalidKeyError(message, *_LEGS_KEY, n, "end")
            if n and leg.start < self.legs[n - 1].end:
                message = f"leg {n + 1} starts at {time_text(leg.start)} s, before leg {n} ends"
                raise InvalidKeyError(message, *_LEGS_KEY, n, "start")

    def cautions(self, timeline: Timeline) -> list[str]:
        """Note turns by more than half a turn between two steps, and turns of a target that stands."""
        notes = []
        for n, leg in enumerate(self.legs, 1):
            if not leg.turn_rate_deg_s:
                continue
            caution = turn_caution(f"leg {n}", leg.turn_rate_deg_s, timeline.times)
            if caution:
                notes.append(caution)
            # (vx, vy) at the leg's start: a turn is in the plane.
            velocity = self.states(np.array([leg.start]))[1:4:2, 0]
            if not velocity.any():
                message = f"leg {n} turns a target that stands still, which changes nothing"
                notes.append(f"{message}: give the launch a speed")
        return notes

    def states(self, times: Array) -> Array:
        """Compute exact states (n, K): each leg adds its acceleration's two integrals.

        A turn at a constant rate starts anew from the state at its beginning, and at its end.
        """
        states = np.empty((2 * self.axes, len(times)))
        # State at the last restart, its time, and the accelerations after it.
        state = self.launch.state
        since = 0.0
        accelerated: list[Leg] = []
        for leg in self.legs:
            if not leg.turn_rate_deg_s:
                # Accelerations are summed up to the next turn at a constant rate.
                accelerated.append(leg)
                continue
            # Later legs overwrite the states after their start.
            later = times >= since
            states[:, later] = _accelerated_states(state, accelerated, times[later], since)
            # A turn starts from the state at its beginning; the next stretch starts from its end.
            at_start = _accelerated_states(state, accelerated, np.array([leg.start]), since)[:, 0]
            turning = times >= leg.start
            states[:, turning] = _turned_states(at_start, leg, times[turning])
            state = _turned_states(at_start, leg, np.array([leg.end]))[:, 0]
            since = leg.end
            accelerated = []
        later = times >= since
        states[:, later] = _accelerated_states(state, accelerated, times[later], since)
        return states

    def windows(self, times: Array, scored: Mask) -> dict[str, Mask]:
        """Select ``quiet``, settled straight flight; of the turns, if there are any:

        ``before`` the first one, ``turns`` and each ``leg n``, their ``starts`` and each ``start n``.
        """
        # Each is a mask (K,) of scored steps. `trackbench describe legs` prints the text above. A leg is
        # a turn: the straight flight between two of them is none.
        inside = self._inside(times)
        # Start of a turn: its first `edge` seconds.
        starts = [
            during & (times <= leg.start + self.edge)
            for leg, during in zip(self.legs, inside, strict=True)
        ]
        windows = {}
        if self.legs:
            windows["before"] = scored & (times <= self.legs[0].start)
            windows["turns"] = scored & inside.any(axis=0)
            windows["starts"] = scored & np.any(starts, axis=0)
        for n, during in enumerate(inside, 1):
            windows[f"leg {n}"] = scored & during
        for n, during in enumerate(starts, 1):
            windows[f"start {n}"] = scored & during
        windows["quiet"] = scored & self._quiet(times)
        return windows

    @property
    def spans(self) -> list[tuple[float, float]]:
        """Start and end of each turn, s: what a figure shades."""
        return [(leg.start, leg.end) for leg in self.legs]

    @property
    def turns(self) -> tuple[float, ...]:
        """Sizes of the legs' accelerations, m/s^2."""
        return tuple(leg.size for leg in self.legs if leg.size)

    def run_metrics(self, values: Mapping[str, Array], scored: Scored) -> dict[str, Array]:
        """Add overshoots and the metrics of maneuver detection to the base's metrics.

        ``overshoot_m[leg n]`` is the mean error along the turn's acceleration in the first `edge`
        seconds after its end. With ``settled_error`` there is also the settling after each leg, up to
        the next one. ``values`` are series (K, M) by name: errors, and what the filter reports. A filter
        that detects maneuvers reports the weight of its maneuvering ``mode``, perhaps its ``alarm``, and
        ``alarm_age_s``, the estimated time since the onset of the maneuver.
        """
        metrics = super().run_metrics(values, scored)
        times = scored.times
        window = scored.windows[""]  # mask (K,) of all scored steps
        if "error_x" in values:
            metrics |= self._overshoots(values["error_x"], values["error_y"], times, window)
        if self.settled_error is not None:
            # Stretch from each leg's end to the next leg's start.
            stretches = {}
            for n, leg in enumerate(self.legs, 1):
                end = np.inf
                if n < len(self.legs):
                    end = self.legs[n].start
                stretches[f"leg {n}"] = (leg.end, end)
            error = np.sqrt(values["squared_position"])
            metrics |= settling_metrics(error, self.settled_error, stretches, times, window)
        if "mode" in values:
            onsets = Onsets(
                times=times,
                starts=tuple(leg.start for leg in self.legs),
                # steps in a leg, and steps long after one, at which an alarm is false
                inside=self._inside(times),
                quiet=window & self._quiet(times),
            )
            metrics |= onsets.metrics(
                values["mode"], alarm=values.get("alarm"), age=values.get("alarm_age_s")
            )
        return metrics

    def _inside(self, t: Array) -> Mask:
        """Select the times that each leg covers (legs, K)."""
        during = [(t > leg.start) & (t <= leg.end) for leg in self.legs]
        return np.array(during, dtype=np.bool_).reshape(len(during), len(t))

    def _quiet(self, t: Array) -> Mask:
        """Select the times (K,) of settled straight flight."""
        quiet = np.ones(len(t), dtype=np.bool_)
        for leg in self.legs:
            quiet &= (t <= leg.start) | (t > leg.end + self.settle)
        return quiet

    def _overshoots(self, x: Array, y: Array, t: Array, scored: Mask) -> dict[str, Array]:
        """Return the mean overshoot (M,), m, in the first `edge` seconds after each leg.

        The position errors x and y (K, M), m, are estimate minus truth. A filter that still turns after
        the leg's end is ahead of the target in the direction of the leg's acceleration. ``scored`` (K,)
        marks the scored ones of the times t (K,), s.
        """
        overshoots = {}
        straight = scored & ~self._inside(t).any(axis=0)
        for n, leg in enumerate(self.legs):
            after = (t > leg.end) & (t <= leg.end + self.edge) & straight
            size = np.sqrt(leg.ax * leg.ax + leg.ay * leg.ay)
            if after.any() and size > 0.0:
                # Error along the turn's acceleration, a . e / |a|
                ahead = (leg.ax * x[after] + leg.ay * y[after]) / size
                overshoots[f"overshoot_m[leg {n + 1}]"] = mean(ahead, axis=0)
        return overshoots


_LEGS_KEY = ("target", "legs")


def _accelerated_states(start: Array, legs: list[Leg], times: Array, begun: float) -> Array:
    """Return the states (n, K) at ``times`` (K,) of a target in ``start`` (n,) at time ``begun``.

    ``legs`` are those that accelerate it from then on.
    """
    t = times - begun
    rows = []
    for axis, (p, v) in enumerate(zip(start[0::2], start[1::2], strict=True)):
        position = p + v * t
        velocity = np.full_like(t, v)
        for leg in legs:
            # v += a (s - e), p += a (s^2 - e^2) / 2; s since the leg's start, e since its end
            s = np.maximum(times - leg.start, 0.0)
            e = np.maximum(times - leg.end, 0.0)
            position = position + leg.acceleration[axis] * ((s * s - e * e) / 2)
            velocity = velocity + leg.acceleration[axis] * (s - e)
        rows += [position, velocity]
    return np.stack(rows)


def _turned_states(start: Array, leg: Leg, times: Array) -> Array:
    """Return the states (n, K) at ``times`` (K,) of a turn at the leg's rate.

    ``start`` (n,) is the state at the leg's start.
    """
    t = times - leg.start
    turn_rate = np.full_like(t, np.deg2rad(leg.turn_rate_deg_s))
    rows = list(turn_state(start[:4], turn_rate, t))
    if len(start) > 4:
        # The turn is in the plane; the height goes on at constant speed.
        height, climb = start[4:]
        rows += [height + climb * t, np.full_like(t, climb)]
    return np.stack(rows)
