"""Latitude, longitude and height as metres in a plane: east, north, up on the WGS 84 ellipsoid."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.elementary import cos_sin

SEMI_MAJOR_AXIS = 6378137.0
"""m; of WGS 84 (NGA.STND.0036, table 3.1)"""
FLATTENING = 1.0 / 298.257223563
"""of the same ellipsoid"""
_ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)


class Geodetic(NamedTuple):
    """Latitude and longitude, rad, and height above the ellipsoid, m; numbers or arrays of one shape."""

    latitude: Array
    longitude: Array
    height: Array


def earth_centered(place: Geodetic) -> Array:
    """Return Cartesian coordinates (3, ...) fixed to the Earth, m (Groves 2013, section 2.4.3)."""
    (c, s), (east, north) = cos_sin(place.latitude), cos_sin(place.longitude)
    across = SEMI_MAJOR_AXIS / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * s * s)
    flat = (across + place.height) * c
    up = (across * (1.0 - _ECCENTRICITY_SQUARED) + place.height) * s
    return np.stack([flat * east, flat * north, up])


def east_north_up(places: Geodetic, origin: Geodetic) -> Array:
    """Return positions (3, R), m, in the plane tangent below the origin (Groves 2013, 2.5.2)."""
    at = Geodetic(*(np.asarray([part], dtype=float) for part in origin))
    dx, dy, dz = earth_centered(places) - earth_centered(at)
    (c, s), (cl, sl) = cos_sin(at.latitude), cos_sin(at.longitude)
    outward = cl * dx + sl * dy
    return np.stack([cl * dy - sl * dx, c * dz - s * outward, c * outward + s * dz])
