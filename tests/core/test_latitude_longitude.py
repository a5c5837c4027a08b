"""Positions on the ellipsoid against radii of curvature and one scalar program."""

import math

import numpy as np
import pytest

from trackbench.core.latitude_longitude import Geodetic, east_north_up, rotate_east_north_up


def test_places_on_the_earth() -> None:
    """Against radii of curvature near the origin, and one scalar program far from it."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    lat, lon = math.radians(50.8), math.radians(-1.1)
    w = math.sqrt(1 - e2 * math.sin(lat) ** 2)
    meridian, across = a * (1 - e2) / w**3, a / w
    step = 1e-6
    places = Geodetic(*(np.array(p) for p in ([lat + step, lat], [lon, lon + step], [0.0, 0.0])))
    east, north, up = east_north_up(places, Geodetic(lat, lon, 0.0))
    np.testing.assert_allclose(north, [meridian * step, 0.0], atol=1e-5)
    np.testing.assert_allclose(east, [0.0, across * math.cos(lat) * step], atol=1e-5)
    np.testing.assert_allclose(up, 0.0, atol=1e-5)

    def cartesian(p: float, q: float, h: float) -> tuple[float, float, float]:
        n = a / math.sqrt(1 - e2 * math.sin(p) ** 2)
        flat = (n + h) * math.cos(p)
        return flat * math.cos(q), flat * math.sin(q), (n * (1 - e2) + h) * math.sin(p)

    far = lat + 0.02, lon - 0.03, 900.0
    d = [u - v for u, v in zip(cartesian(*far), cartesian(lat, lon, 50.0), strict=True)]
    expected = (
        -math.sin(lon) * d[0] + math.cos(lon) * d[1],
        -math.sin(lat) * (math.cos(lon) * d[0] + math.sin(lon) * d[1]) + math.cos(lat) * d[2],
        math.cos(lat) * (math.cos(lon) * d[0] + math.sin(lon) * d[1]) + math.sin(lat) * d[2],
    )
    found = east_north_up(Geodetic(*(np.array([v]) for v in far)), Geodetic(lat, lon, 50.0))
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-9)


def test_vectors_at_another_place() -> None:
    """Axes of places far from the origin, one scalar at a time: along the equator, and over the pole."""
    east, north, up = np.eye(3)
    origin = Geodetic(0.0, 0.0, 0.0)
    # A quarter of the equator to the east: up there is east of the origin, east there is down.
    place = Geodetic(*(np.array([part]) for part in (0.0, math.pi / 2, 0.0)))
    for vector, expected in ((up, east), (east, -up), (north, north)):
        found = rotate_east_north_up(vector[:, None], place, origin)
        np.testing.assert_allclose(found[:, 0], expected, atol=1e-15)
    # Meridians converge by d_lambda sin(phi): 1 deg at 30 N by half a degree, against the clock.
    p, q = math.radians(30.0), math.radians(1.0)
    place = Geodetic(*(np.array([part]) for part in (p, q, 0.0)))
    found = rotate_east_north_up(north[:, None], place, Geodetic(p, 0.0, 0.0))[:, 0]
    assert math.degrees(math.atan2(-found[0], found[1])) == pytest.approx(0.5, rel=1e-3)
    # At the origin nothing turns, and lengths stay.
    vectors = np.array([[1.0, -2.0], [3.0, 0.5], [0.2, 7.0]])
    same = Geodetic(*(np.array([part] * 2) for part in (p, q, 90.0)))
    np.testing.assert_allclose(
        rotate_east_north_up(vectors, same, Geodetic(p, q, 0.0)), vectors, rtol=1e-12
    )
