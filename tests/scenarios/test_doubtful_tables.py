"""Tables whose columns are easily taken for something else: they are read right, or asked about."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.test_device_tables import (
    KNOT,
    Numbers,
    Path2,
    check_path,
    decimal,
    guessed,
    lonlat,
    table,
    whole,
)
from trackbench.errors import UserError

CAR, SHIP = Path2(rows=40), Path2(rows=40, usual_speed=6.0, every=10.0, latitude=53.5)
EAST = Path2(rows=40, usual_speed=20.0, every=2.0)
RADAR = np.array([[-2000.0], [-3000.0]])


def polar(path: Path2) -> tuple[Numbers, Numbers]:
    """Return the path's ranges, m, and its azimuths clockwise from north, deg, as the radar has them."""
    x, y = path.place - RADAR
    return np.hypot(x, y), np.degrees(np.arctan2(x, y)) % 360.0


def with_units(units: str, text: str) -> str:
    names, rows = text.split("\n", 1)
    return f"{names}\n{units}\n{rows}"


def radar_table(names: str, meters: float = 1.0, degrees: float = 1.0) -> Callable[[Path2], str]:
    """Return a table of ranges and azimuths in units of so many meters and degrees."""

    def write(path: Path2) -> str:
        ranges, azimuths = polar(path)
        return table(
            names, whole(path.t), decimal(ranges / meters, 4), decimal(azimuths / degrees, 4)
        )

    return write


def plane_table(names: str, meters: float = 1.0, seconds: float = 1.0) -> Callable[[Path2], str]:
    """Return a table of x and y in units of so many meters, and times in units of so many seconds."""

    def write(path: Path2) -> str:
        x, y = path.place / meters
        return table(names, whole(path.t / seconds), decimal(x, 2), decimal(y, 2))

    return write


def degrees_and_minutes(names: str, seconds: bool = False) -> Callable[[Path2], str]:
    """Return a table of latitudes and longitudes in columns of degrees, minutes and perhaps seconds."""

    def write(path: Path2) -> str:
        columns = [whole(path.t)]
        for degrees in path.degrees[::-1]:
            minutes = 60.0 * (degrees % 1.0)
            columns.append(whole(np.floor(degrees)))
            if seconds:
                columns += [whole(np.floor(minutes)), decimal(60.0 * (minutes % 1.0), 4)]
            else:
                columns.append(decimal(minutes, 5))
        return table(names, *columns)

    return write


def earth_centered(path: Path2) -> str:
    longitude, latitude = np.radians(path.degrees)
    normal = 6378137.0 / np.sqrt(1.0 - 0.00669437999014 * np.sin(latitude) ** 2)
    across = normal * np.cos(latitude)
    x, y = across * np.cos(longitude), across * np.sin(longitude)
    z = normal * (1.0 - 0.00669437999014) * np.sin(latitude)
    return table("time,x,y,z", whole(path.t), decimal(x, 3), decimal(y, 3), decimal(z, 3))


def two_zones(path: Path2) -> str:
    zones = ["32T"] * 20 + ["33T"] * 20
    east = path.place[0] + np.where(np.arange(path.rows) < 20, 780_000.0, 220_000.0)
    north = path.place[1] + 5_205_000.0
    names = "time,zone,easting,northing"
    return table(names, whole(path.t), zones, decimal(east, 2), decimal(north, 2))


def slant_ranges(path: Path2) -> str:
    ranges, azimuths = polar(path)
    elevations = np.degrees(np.arctan2(1500.0, ranges))
    slant = np.hypot(ranges, 1500.0)
    names = "time,slant_range_m,azimuth_deg,elevation_deg"
    columns = decimal(slant, 1), decimal(azimuths, 2), decimal(elevations, 2)
    return table(names, whole(path.t), *columns)


def scaled_speed(path: Path2) -> str:
    motion = whole(10.0 * path.speed / KNOT), whole(10.0 * path.course)
    names = "time,lat,lon,sog [0.1 kn],cog [0.1 deg]"
    return table(names, whole(path.t), *lonlat(path)[::-1], *motion)


def small_degrees(path: Path2) -> str:
    longitude, latitude = (whole(1e7 * part) for part in path.degrees)
    return with_units(
        "s,1e-7 deg,1e-7 deg", table("time,lat,lon", whole(path.t), latitude, longitude)
    )


RIGHT: dict[str, tuple[Path2, Callable[[Path2], str]]] = {
    "kn/10 and deg/10 in brackets": (SHIP, scaled_speed),
    "1e-7 deg in a line of units": (CAR, small_degrees),
    "hundredths of a meter": (CAR, plane_table("t,x [0.01 m],y [m/100]", 0.01)),
    "a clock of 24 hours": (CAR, plane_table("time (24h),x (m),y (m)")),
}
ASKED: dict[str, tuple[Path2, Callable[[Path2], str], str]] = {
    "yards in a line of units": (
        EAST,
        lambda p: with_units("s,yd,yd", plane_table("time,x,y", 0.9144)(p)),
        r"x: the unit yd is unknown here: write the numbers in a known unit.*units\.x=m",
    ),
    "gon in a line of units": (
        EAST,
        lambda p: with_units("s,m,gon", radar_table("time,range,azimuth", 1.0, 0.9)(p)),
        r"azimuth: the unit gon is unknown",
    ),
    "a tenth of a meter in a line of units": (
        EAST,
        lambda p: with_units("s,0.1 m,0.1 m", plane_table("time,x,y", 0.1)(p)),
        r"x: the unit 0\.1 m is unknown",
    ),
    "radar's own units": (
        EAST,
        radar_table("tod,rho [1/256 NM],theta [360/65536 deg]", 1852.0 / 256.0, 360.0 / 65536.0),
        r"theta \[360/65536 deg\]: the unit 0\.00549316 deg is unknown",
    ),
    "a tenth of a second": (
        CAR,
        plane_table("time [0.1 s],x [m],y [m]", 1.0, 0.1),
        r"the unit 0\.1 s is unknown here.*units\.time=s",
    ),
    "seconds of arc": (
        CAR,
        lambda p: table(
            "time,lat_arcsec,lon_arcsec",
            *(whole(p.t), *(decimal(3600.0 * part, 3) for part in p.degrees[::-1])),
        ),
        r"lat_arcsec: the unit arcsec is unknown",
    ),
    "degrees and minutes": (
        CAR,
        degrees_and_minutes("time,lat_deg,lat_min,lon_deg,lon_min"),
        r"m\.csv:2:1: lat_deg has whole degrees, and lat_min the rest.* lat_deg \+ lat_min / 60$",
    ),
    "degrees, minutes and seconds": (
        CAR,
        degrees_and_minutes("time,latD,latM,latS,lonD,lonM,lonS", seconds=True),
        r"latD \+ latM / 60 \+ latS / 3600$",
    ),
    "from the center of the Earth": (
        CAR,
        earth_centered,
        r"x, y and z count from the center of the Earth, 6367 km away: convert them to latitude",
    ),
    "two zones": (EAST, two_zones, r"zone has 32T, 33T: each zone counts from a meridian"),
    "slant ranges": (
        EAST,
        slant_ranges,
        r"elevation_deg usually is 18\.7 deg.* by 5\.3 %.*--set 'columns\.range=slant_range_m'",
    ),
}


@pytest.mark.parametrize("case", RIGHT)
def test_tables_are_read_right(tmp_path: Path, case: str) -> None:
    path, write = RIGHT[case]
    scenario, _ = guessed(tmp_path, write(path))
    check_path(scenario, path)


@pytest.mark.parametrize("case", ASKED)
def test_tables_are_asked_about(tmp_path: Path, case: str) -> None:
    path, write, expected = ASKED[case]
    with pytest.raises(UserError, match=expected):
        guessed(tmp_path, write(path))


@pytest.mark.parametrize(
    ("names", "miles"),
    [
        ("time,Range (nautical miles),Bearing (deg)", 1852.0),
        ("Zeit,Entfernung (Seemeilen),Peilung (Grad)", 1852.0),
        ("time,range_miles,bearing", 1609.344),
    ],
)
def test_miles_at_sea_are_others_than_on_land(tmp_path: Path, names: str, miles: float) -> None:
    scenario, _ = guessed(tmp_path, radar_table(names, miles)(EAST))
    ranges, _ = polar(EAST)
    recording = scenario.target._recording
    read = np.concatenate([recording.scans, recording.measurements], axis=1)[0, :, 0]
    np.testing.assert_allclose(read, ranges, atol=0.2)


def test_a_range_that_is_confirmed_is_read(tmp_path: Path) -> None:
    _, written = guessed(tmp_path, slant_ranges(EAST), "columns.range=slant_range_m")
    assert [sensor["kind"] for sensor in written["sensor"]] == ["range-azimuth"]
