"""Targets of straight legs and turns: a given flight, or one drawn for each run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, TypeVar

import numpy as np
from annotated_types import Interval

from trackbench.core.arrays import Array, Index, Mask
from trackbench.core.elementary import cos_sin
from trackbench.core.random_streams import Streams
from trackbench.core.sums import mean
from trackbench.durations import time_text
from trackbench.field_types import Finite, InvalidKeyError, NonNegative, Positive, Steps, Unit
from trackbench.models.motions.coordinated_turn import turn_state
from trackbench.models.sensors.stacked import Sensors
from trackbench.registry import register
from trackbench.scenarios.targets.base import (
    Flight,
    Flown,
    Launch,
    Scored,
    Target,
    Timeline,
    measured_along,
    turn_caution,
)


@dataclass(frozen=True, eq=False)
class Onsets:
    """Onsets of maneuvers, against which a filter's detections are measured."""

    times: Array
    """sampling times (K,), s"""
    starts: tuple[float, ...]
    """time at which each leg starts, s"""
    inside: Mask
    """samples that each leg covers (legs, K)"""
    quiet: Mask
    """samples (K,) of settled straight flight"""

    def metrics(
        self, mode: Array, alarm: Array | None, age: Array | None = None
    ) -> dict[str, Array]:
        """Measure in each run (M,) how a filter detects maneuvers.

        ``mode`` (K, M) is the weight of its maneuvering mode, and ``alarm`` (K, M) is positive where it
        raises an alarm. ``age`` (K, M) is the estimated time since the onset, s, NaN without an alarm.

        ``detection_delay_s[leg n]``: time from the onset to the first sample in the maneuvering
        mode, NaN if there is none. ``missed_maneuvers[leg n]``: 1 for a leg without that mode.
        ``already_maneuvering[leg n]``: 1 if the mode was on before the onset. ``onset_age_s[leg
        n]``: time from the estimated onset to that sample. ``onset_error_s[leg n]``: estimated
        minus true onset. ``onset_abs_error_s[leg n]``: its size. ``false_maneuvers_per_1000``:
        alarms per 1000 quiet samples in the quiescent mode.
        """
        is_on = mode > 0.5  # the prior's row is NaN: off
        # The estimate of an alarm counts until the next one.
        estimated_onset = None
        if age is not None:
            estimated_onset = _carry_last(self.times[:, None] - age)
        metrics: dict[str, Array] = {}
        for n, (start, during) in enumerate(zip(self.starts, self.inside, strict=True), 1):
            if not during.any():
                continue  # shorter than the sampling time
            # Mode just before the leg, and whether it comes on during the leg.
            first = int(np.argmax(during))
            was_on = np.zeros(is_on.shape[1], dtype=np.bool_)
            if first > 0:
                was_on = is_on[first - 1]
            detected = is_on[during].any(axis=0)
            # The sample at the onset itself carries none of the turn; `during` starts after it.
            sample = first + np.argmax(is_on[during], axis=0)
            # Delay from the onset to that sample, if the mode was off before.
            delay = np.where(detected & ~was_on, self.times[sample] - start, np.nan)
            metrics[f"detection_delay_s[leg {n}]"] = delay
            if estimated_onset is not None:
                # Estimated onset (time less the alarm's age) minus the true one.
                error = estimated_onset[sample, np.arange(len(sample))] - start
                detected_error = np.where(np.isnan(delay), np.nan, error)
                metrics[f"onset_error_s[leg {n}]"] = detected_error
                metrics[f"onset_abs_error_s[leg {n}]"] = np.abs(detected_error)
                metrics[f"onset_age_s[leg {n}]"] = delay - error
            metrics[f"missed_maneuvers[leg {n}]"] = (~detected).astype(float)
            metrics[f"already_maneuvering[leg {n}]"] = was_on.astype(float)
        metrics["false_maneuvers_per_1000"] = self._false_alarms(is_on, alarm)
        return metrics

    def _false_alarms(self, is_on: Mask, alarm: Array | None) -> Array:
        """Return each run's false alarms (M,) per 1000 quiet samples whose predecessor is off.

        ``is_on`` (K, M) marks the samples in the maneuvering mode; ``alarm`` (K, M) is positive where
        the filter raises an alarm. Without ``alarm`` each switching on is one.
        """
        # The first sample has no predecessor, and counts as one after an off.
        was_off = np.vstack([np.ones_like(is_on[:1]), ~is_on[:-1]])
        raised = is_on & was_off
        if alarm is not None:
            raised = alarm > 0.0
        quiet = self.quiet[:, None] & was_off
        return np.asarray(1000.0 * (raised & quiet).sum(axis=0) / quiet.sum(axis=0))


def _carry_last(rows: Array) -> Array:
    """Return ``rows`` (K, M) with each NaN replaced by the last value above it, if there is one."""
    row_number = np.arange(len(rows))[:, None]
    latest = np.maximum.accumulate(np.where(np.isnan(rows), 0, row_number), axis=0)
    return np.asarray(np.take_along_axis(rows, latest, axis=0))


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
        """Check that the legs are ordered, disjoint, and within the run."""
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
        # Each is a mask (K,) of scored steps. `trackbench describe legs` prints the text above.
        inside = self._inside(times)
        # Start of a turn: its first `edge` seconds.
        starts = [
            during & ~(times > leg.start + self.edge)
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

        ``overshoot_m[leg n]`` is the mean error along the turn's acceleration after its end. With
        ``settled_error`` there is also the settling after each leg, up to the next one. ``values`` are
        series (K, M) by name: errors, and what the filter reports, such as the weight of its ``mode``.
        """
        metrics = super().run_metrics(values, scored)
        times = scored.times
        window = scored.windows[""]
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
            metrics |= scored.settling(error, self.settled_error, stretches)
        if "mode" in values:
            onsets = Onsets(
                times=times,
                starts=tuple(leg.start for leg in self.legs),
                inside=self._inside(times),
                quiet=window & self._quiet(times),
            )
            metrics |= onsets.metrics(
                values["mode"], values.get("alarm"), values.get("alarm_age_s")
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
        """Measure overshoots (M,), m, from signed position errors x and y (K, M), m, after each leg.

        A filter that still turns is ahead. ``scored`` (K,) marks the scored ones of the times t (K,), s.
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
        """Draw states (4, K, M) at K = ``steps`` steps, T s apart, of M = ``runs`` runs."""
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
            number = 2 * number
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
