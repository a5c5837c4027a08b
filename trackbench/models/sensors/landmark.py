"""Landmarks at known places, as a robot measures them: bearings count from its heading."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import arctan2
from trackbench.core.polar_conversions import distance
from trackbench.core.read_only import fixed
from trackbench.field_types import Finite, InvalidKeyError, Positive, Unit
from trackbench.models.sensors.base import SensorBase
from trackbench.registry import register

_POSITION = ("px", "py")


@register("sensors", "landmark")
@dataclass(frozen=True, kw_only=True)
class Landmark(SensorBase):
    """Range and bearing of a landmark at a known place; the bearing counts from the robot's heading.

    ``r = sqrt(dx^2 + dy^2) + w_r`` and ``b = atan2(dy, dx) - heading + w_b``, with the way (dx, dy) from
    px, py to the landmark. One of the two sigmas may be left out, and with it the component.
    """

    at: tuple[Finite, Finite]
    """place of the landmark, m"""
    sigma_range: Annotated[Positive | None, Unit("m")] = None
    """standard deviation of the range, m"""
    sigma_bearing_mrad: Annotated[Positive | None, Unit("mrad")] = None
    """standard deviation of the bearing, mrad"""
    heading: str = "heading"
    """name of the state's component from which bearings count, anticlockwise"""
    state: tuple[str, ...] = ()
    """names of the state's components, in order; default: those of the target"""

    components: ClassVar[tuple[str, ...]] = ()
    """range and bearing, or one of them"""

    def __post_init__(self) -> None:
        measured = []
        if self.sigma_range is not None:
            measured.append("range")
        if self.sigma_bearing_mrad is not None:
            measured.append("bearing")
        if not measured:
            raise ValueError("give sigma_range, sigma_bearing_mrad, or both")
        object.__setattr__(self, "components", tuple(measured))
        super().__post_init__()

    def for_state(self, components: tuple[str, ...]) -> "Landmark":
        """Return the sensor for states that begin with these components; raises InvalidKeyError."""
        if self.state:
            return self
        names = ", ".join(components)
        for name in _POSITION:
            if name not in components:
                message = f"a landmark is measured from px and py, and the state is {names}"
                raise InvalidKeyError(f"{message}: take `function`", "kind")
        if "bearing" in self.components and self.heading not in components:
            message = f"there is no component {self.heading!r}, from which bearings count"
            raise InvalidKeyError(f"{message}; the state is {names}", "heading")
        return replace(self, state=components)

    @cached_property
    def R(self) -> Array:
        """Noise covariance (n_z, n_z), m^2 and rad^2."""
        sigmas = []
        if self.sigma_range is not None:
            sigmas.append(self.sigma_range)
        if self.sigma_bearing_mrad is not None:
            sigmas.append(1e-3 * self.sigma_bearing_mrad)
        return fixed(np.diag(np.square(sigmas)))

    def _way_to_landmark(self, x: Array) -> tuple[Array, Array]:
        """Return x and y (*batch) from the position of states x (n, *batch) to the landmark."""
        row_x, row_y = map(self.state.index, _POSITION)
        return self.at[0] - x[row_x], self.at[1] - x[row_y]

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N((range, bearing), R) for x (n, *batch)."""
        dx, dy = self._way_to_landmark(x)
        means = []
        if "range" in self.components:
            means.append(distance(dx, dy))
        if "bearing" in self.components:
            means.append(wrap_angle(arctan2(dy, dx) - x[self.state.index(self.heading)]))
        return Gaussian(np.stack(means), self.R)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Compute ``z - z_pred`` (n_z, *batch), the bearing wrapped to (-pi, pi]."""
        nu = z - z_pred
        if "bearing" in self.components:
            nu[-1] = wrap_angle(nu[-1])
        return nu

    def jacobian(self, x: Array, k: int) -> Array:
        """Return d(range, bearing)/dx (n_z, n, *batch)."""
        dx, dy = self._way_to_landmark(x)
        row_x, row_y = map(self.state.index, _POSITION)
        square = dx * dx + dy * dy
        r = np.sqrt(square)
        H = np.zeros((len(self.components), *x.shape))
        if "range" in self.components:
            # dr/dpx = -dx / r, dr/dpy = -dy / r
            H[0, row_x] = -dx / r
            H[0, row_y] = -dy / r
        if "bearing" in self.components:
            # db/dpx = dy / r^2, db/dpy = -dx / r^2, db/dheading = -1
            H[-1, row_x] = dy / square
            H[-1, row_y] = -dx / square
            H[-1, self.state.index(self.heading)] = -1.0
        return H
