"""Place of a sensor: a position `at`, or the path of its moving `platform`."""

from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise

from trackbench.field_types import Finite, Natural


@dataclass(frozen=True, kw_only=True)
class Platform:
    """Path of a moving sensor: straight between waypoints, at rest before and after them."""

    steps: tuple[Natural, ...]
    """numbers of the steps at which the waypoints are reached, in order"""
    x: tuple[Finite, ...]
    """m"""
    y: tuple[Finite, ...]
    """m"""

    def __post_init__(self) -> None:
        if not len(self.steps) == len(self.x) == len(self.y) > 0:
            raise ValueError("steps, x and y must have the same number of entries, at least one")
        if any(b <= a for a, b in pairwise(self.steps)):
            raise ValueError("the steps of the waypoints must increase")

    def place(self, k: int) -> tuple[float, float]:
        """Return the platform's position at step k, by linear interpolation.

        Parameters
        ----------
        k : int
            Step.

        Returns
        -------
        tuple of float (2,)
            Position, m. Before the first waypoint and after the last one the platform is at rest there.
        """
        n = bisect_right(self.steps, k)
        if n in (0, len(self.steps)):
            # Before the first or after the last waypoint: at rest.
            end = min(n, len(self.steps) - 1)
            return self.x[end], self.y[end]
        # Between two waypoints: interpolate.
        share = (k - self.steps[n - 1]) / (self.steps[n] - self.steps[n - 1])
        px = self.x[n - 1] + share * (self.x[n] - self.x[n - 1])
        py = self.y[n - 1] + share * (self.y[n] - self.y[n - 1])
        return px, py


def check_place(at: tuple[float, ...], platform: Platform | None, axes: int, standing: str) -> None:
    """Reject a place of a sensor that is neither a position, nor a platform, nor unset.

    Parameters
    ----------
    at : tuple of float
        Position, m. Empty if it is unset.
    platform : Platform or None
        Path of a moving sensor. None if it is unset.
    axes : int
        Number of axes of the space.
    standing : str
        The sensor in words if it cannot move. Empty if it can.

    Raises
    ------
    ValueError
        For a position of another number of axes, for a position beside a platform, and for a platform of
        a sensor that cannot move.
    """
    if at and len(at) != axes:
        raise ValueError(f"at has {len(at)} numbers for {axes} axes")
    if at and platform is not None:
        raise ValueError("a sensor has a position `at` or a `platform`; remove one of them")
    if platform is not None and standing:
        raise ValueError(f"{standing} cannot move; remove `platform`")
