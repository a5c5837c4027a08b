"""Turns of constant acceleration: what a path is made of, and the paper's own."""

from dataclasses import dataclass

from trackbench.keys import Finite, MistakenKeyError, NonNegative, Positive


@dataclass(frozen=True, kw_only=True)
class Leg:
    """A stretch of constant acceleration."""

    start: NonNegative
    """s"""
    end: Positive
    """s"""
    ax: Finite
    """m/s^2"""
    ay: Finite
    """m/s^2"""


@dataclass(frozen=True, kw_only=True)
class Launch:
    """Where the target is at time zero."""

    x: Finite = 2000.0
    """m"""
    y: Finite = 10_000.0
    """m"""
    vx: Finite = 0.0
    """m/s"""
    vy: Finite = -15.0
    """m/s"""


def _legs(*rows: tuple[float, float, float, float]) -> tuple[Leg, ...]:
    return tuple(Leg(start=s, end=e, ax=ax, ay=ay) for s, e, ax, ay in rows)


_FIRST = ((400.0, 600.0, 0.075, 0.075), (620.0, 670.0, -0.3, 0.3), (1000.0, 1200.0, -0.075, -0.075))
PAPER: dict[str, tuple[Launch, tuple[Leg, ...]]] = {
    "corrected": (
        Launch(),
        _legs(*_FIRST, (1205.0, 1255.0, 0.3, -0.3), (1455.0, 1655.0, 0.075, 0.075)),
    ),
    "as-printed": (
        Launch(vx=-15.0, vy=0.0),
        _legs(*_FIRST, (1205.0, 1255.0, -0.3, -0.3), (1455.0, 1700.0, 0.075, 0.075)),
    ),
}


def check_legs(legs: tuple[Leg, ...], duration: float) -> None:
    """Raises MistakenKeyError unless they are in order, no two at once, and within the run."""
    for n, leg in enumerate(legs):
        if leg.end <= leg.start:
            raise MistakenKeyError(f"leg {n + 1} ends before it starts", "legs", n, "end")
        if leg.end > duration:
            what = f"leg {n + 1} ends at {leg.end:g} s, after the run's end at {duration:g} s"
            raise MistakenKeyError(what, "legs", n, "end")
        if n and leg.start < legs[n - 1].end:
            what = f"leg {n + 1} starts at {leg.start:g} s, before leg {n} ends"
            raise MistakenKeyError(what, "legs", n, "start")
