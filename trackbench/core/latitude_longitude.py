"""Latitudes and longitudes on the ellipsoid WGS 84, projected to a local plane: east, north, up."""

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
    """Convert to Cartesian coordinates fixed to the Earth (Groves 2013, section 2.4.3).

    Parameters
    ----------
    place : Geodetic
        Latitude and longitude, rad, and height above the ellipsoid, m: numbers or arrays (R,).

    Returns
    -------
    array (3,) or (3, R)
        Coordinates, m. The first axis points to latitude and longitude zero, the third to the north
        pole.
    """
    c, s = cos_sin(place.latitude)
    cos_lon, sin_lon = cos_sin(place.longitude)
    radius = SEMI_MAJOR_AXIS / np.sqrt(1.0 - _ECCENTRICITY_SQUARED * s * s)  # of curvature
    # Distance from the Earth's axis, and height above the equatorial plane.
    to_axis = (radius + place.height) * c
    up = (radius * (1.0 - _ECCENTRICITY_SQUARED) + place.height) * s
    return np.stack([to_axis * cos_lon, to_axis * sin_lon, up])


def east_north_up(places: Geodetic, origin: Geodetic) -> Array:
    """Convert to positions in the local plane of the origin (Groves 2013, 2.5.2).

    Parameters
    ----------
    places : Geodetic
        R places: latitudes and longitudes (R,), rad, and heights above the ellipsoid (R,), m.
    origin : Geodetic
        One place, by three numbers in these units.

    Returns
    -------
    array (3, R)
        Positions along east, north and up of the origin, m.
    """
    place = _as_arrays(origin)
    return _local_axes(earth_centered(places) - earth_centered(place), place)


def rotate_east_north_up(vectors: Array, places: Geodetic, origin: Geodetic) -> Array:
    """Rotate vectors from the local axes at their own places to those at the origin.

    The axes are east, north and up. The two norths differ by the convergence of the meridians, about
    ``d_lambda sin(phi)``: half a degree after 50 km eastwards at 50 deg N. The rotation is
    ``C = C_e^o C_p^e`` of the place p, the Earth e and the origin o (Groves 2013, eq. 2.150).

    Parameters
    ----------
    vectors : array (3, R)
        Vectors in any unit, such as velocities in m/s.
    places : Geodetic
        Place of each vector: latitude and longitude (R,), rad. Heights have no effect.
    origin : Geodetic
        One place, by latitude and longitude as numbers, rad. Its height has no effect.

    Returns
    -------
    array (3, R)
        Vectors along east, north and up of the origin, in the unit of ``vectors``.
    """
    east, north, up = vectors
    c, s = cos_sin(places.latitude)
    cos_lon, sin_lon = cos_sin(places.longitude)
    # Tilt by the latitude, then turn about the Earth's axis into the meridian of longitude zero.
    outward = c * up - s * north
    along_axis = c * north + s * up
    earth = np.stack(
        [cos_lon * outward - sin_lon * east, sin_lon * outward + cos_lon * east, along_axis]
    )
    return _local_axes(earth, _as_arrays(origin))


def _as_arrays(place: Geodetic) -> Geodetic:
    """Return the place with each of its three numbers as an array (1,)."""
    return Geodetic(
        latitude=np.asarray([place.latitude], dtype=float),
        longitude=np.asarray([place.longitude], dtype=float),
        height=np.asarray([place.height], dtype=float),
    )


def _local_axes(vectors: Array, place: Geodetic) -> Array:
    """Rotate vectors (3, R) from axes fixed to the Earth to east, north and up at a place."""
    dx, dy, dz = vectors
    c, s = cos_sin(place.latitude)
    cos_lon, sin_lon = cos_sin(place.longitude)
    # Turn about the Earth's axis into the place's meridian, then tilt by its latitude.
    outward = cos_lon * dx + sin_lon * dy
    return np.stack([cos_lon * dy - sin_lon * dx, c * dz - s * outward, c * outward + s * dz])
