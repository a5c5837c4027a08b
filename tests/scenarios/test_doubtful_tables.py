"""Tables whose columns are easily taken for something else: they are read right, or asked about."""

import gzip
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from tests.scenarios.test_device_tables import (
    KNOT,
    MIDNIGHT,
    Numbers,
    Path2,
    check_path,
    decimal,
    guessed,
    lonlat,
    table,
    whole,
    xy,
)
from trackbench.errors import UserError
from trackbench.new_experiment_from_tables import write_config_for

CAR, SHIP = Path2(rows=40), Path2(rows=40, usual_speed=6.0, every=10.0, latitude=53.5)
EAST = Path2(rows=40, usual_speed=20.0, every=2.0)
MINUTES = Path2(rows=40, usual_speed=2.0, every=60.0)
HALF_PAST = datetime(2024, 5, 3, 9, 30, 0)
MAY = datetime(2024, 5, 13, 10, 0, 0)
RADAR = np.array([[2000.0], [3000.0]])


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


def clocked(names: str, clock: Callable[[Path2], list[list[str]]]) -> Callable[[Path2], str]:
    """Return a table of x and y with columns of times before them."""
    return lambda p: table(f"{names},x,y", *clock(p), *xy(p))


def frames(path: Path2) -> list[list[str]]:
    numbers = np.rint(25.0 * path.t).astype(int)
    return [[f"10:00:{number // 25:02}:{number % 25:02}" for number in numbers]]


def without_zeros(path: Path2) -> list[list[str]]:
    """Return seconds and milliseconds joined without the zeros between them: 0.5 is 5 ms."""
    thousandths = np.rint(1e3 * path.t).astype(int)
    return [[f"{1714730400 + number // 1000}.{number % 1000}" for number in thousandths]]


def clock_of_numbers(path: Path2) -> list[list[str]]:
    dates = path.dates("%Y%m%d", MIDNIGHT)
    return [dates, [str(int(clock)) for clock in path.dates("%H%M%S", MIDNIGHT)]]


def several_a_second(path: Path2, false_detections: int = 0) -> str:
    """Return a table of two targets in each second, or of one among false detections, without names."""
    rng = np.random.default_rng(7)
    rows = []
    for time, (x, y) in zip(path.t, path.place.T, strict=True):
        places = [(x, y), (x + 3000.0, y)]
        if false_detections:
            others = rng.uniform(-2000.0, 3000.0, (rng.poisson(false_detections), 2))
            places = [(x, y), *map(tuple, others)]
        rng.shuffle(places)
        rows += [f"{time:.0f},{east:.1f},{north:.1f}" for east, north in places]
    return "\n".join(["time,x,y", *rows]) + "\n"


def phone(path: Path2) -> str:
    speed, course = decimal(path.speed, 2), decimal(path.course, 1)
    speed[:4] = ["-1"] * 4
    course[:6] = ["-1.0"] * 6
    names = "timestamp,latitude,longitude,speed,course"
    return table(names, whole(1.7e9 + path.t), *lonlat(path)[::-1], speed, course)


def no_names(path: Path2) -> str:
    x, y = xy(path)
    rows = zip(x, y, whole(path.t), strict=True)
    return "".join(f"{east},{north},{time}\n" for east, north, time in rows)


def eight_columns(path: Path2) -> str:
    columns = xy(path), decimal(path.speed, 3), decimal(path.course, 3)
    rows = zip(whole(path.t), *columns[0], *columns[1:], strict=True)
    return "".join(f"{' '.join(row)} 1 0 3\n" for row in rows)


def date_alone(path: Path2) -> str:
    x, y = xy(path)
    return table("date,x,y", ["2024-05-03"] * 20 + ["2024-05-04"] * 20, x, y)


def moving(
    place: Callable[[Path2], list[list[str]]], knots: bool = False
) -> Callable[[Path2], str]:
    """Return a table of latitudes and longitudes from ``place``, speeds and courses."""

    def write(path: Path2) -> str:
        speed = path.speed / KNOT if knots else path.speed
        motion = decimal(speed, 2), decimal(path.course, 1)
        return table("time,lat,lon,speed,course", whole(path.t), *place(path), *motion)

    return write


def other_signs(latitude: float, longitude: float) -> Callable[[Path2], list[list[str]]]:
    """Return latitudes and longitudes times these factors."""
    return lambda p: [
        decimal(latitude * p.degrees[1], 7),
        decimal(longitude * p.degrees[0], 7),
    ]


RIGHT: dict[str, tuple[Path2, Callable[[Path2], str]]] = {
    "kn/10 and deg/10 in brackets": (SHIP, scaled_speed),
    "1e-7 deg in a line of units": (CAR, small_degrees),
    "hundredths of a meter": (CAR, plane_table("t,x [0.01 m],y [m/100]", 0.01)),
    "a clock of 24 hours": (CAR, plane_table("time (24h),x (m),y (m)")),
    "hours and minutes as a number": (
        MINUTES,
        clocked("time", lambda p: [p.dates("%H%M", HALF_PAST)]),
    ),
    "a clock without zeros": (CAR, clocked("date,time", clock_of_numbers)),
    "a.m. and p.m.": (
        CAR,
        clocked("time", lambda p: [[f"{d} a. m." for d in p.dates("%d/%m/%Y %I:%M:%S", MAY)]]),
    ),
    "measurements beside a truth": (
        CAR,
        lambda p: table("time,x,y,zx,zy", whole(p.t), whole(9.0 * p.t), whole(5.0 * p.t), *xy(p)),
    ),
    "northings beside a height": (
        CAR,
        lambda p: table(
            "time,x,y,z",
            *(whole(p.t), decimal(652e3 + p.place[0], 2), decimal(6.3e6 + p.place[1], 2)),
            ["35.2"] * p.rows,
        ),
    ),
    "zones that are areas": (
        CAR,
        lambda p: table("time,x,y,zone", whole(p.t), *xy(p), [1] * 20 + [2] * 20),
    ),
    "a moored ship": (
        Path2(rows=40, usual_speed=0.02, every=60.0),
        lambda p: table(
            "time,mmsi,lat,lon,sog,cog",
            *(whole(1.7e9 + p.t), [1] * p.rows, *lonlat(p)[::-1], ["0.0"] * p.rows),
            decimal(p.course, 1),
        ),
    ),
    "translations": (
        CAR,
        lambda p: table("timestamp,translation_x,translation_y", whole(p.t), *xy(p)),
    ),
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
    "numbers of frames": (
        Path2(rows=60, every=0.04),
        clocked("time", frames),
        r"m\.csv:2:1: '10:00:00:00' may end with the number of a frame.*%H:%M:%S:%f",
    ),
    "no zeros behind the point": (
        Path2(rows=60, every=0.005),
        clocked("time", without_zeros),
        r"m\.csv:4:1: '1714730400\.10' comes after '1714730400\.5': are there no zeros behind",
    ),
    "two targets without names": (
        CAR,
        several_a_second,
        r"m\.csv:3:1: rows of one time are far apart, and near those of other times.*same_time=spread",
    ),
    "two targets in each frame": (
        CAR,
        lambda p: several_a_second(p).replace("time", "frame"),
        r"m\.csv:3:1: rows of one time are far apart, and near those of other times",
    ),
    "false detections": (
        EAST,
        lambda p: several_a_second(p, 2),
        r"rows of one time are far apart, .* or false detections\?",
    ),
    "days alone": (CAR, date_alone, r"time 0 s is there twice, as are 37 more"),
    "no names, the time last": (CAR, no_names, r"no line names the columns: name all 3"),
    "eight columns without names": (CAR, eight_columns, r"no line names the columns: name all 8"),
    "latitude and longitude exchanged": (
        CAR,
        moving(lambda p: [*lonlat(p)], knots=True),
        r"lat and lon agree with speed and course only if they are exchanged: say .*latitude=lon",
    ),
    "positive degrees to the west": (
        Path2(rows=40, latitude=37.8, longitude=-122.4),
        moving(other_signs(1.0, -1.0)),
        r"lon agrees with speed and course only with the opposite sign: .* west as negative",
    ),
    "positive degrees to the south": (
        Path2(rows=40, latitude=-33.8, longitude=151.0),
        moving(other_signs(-1.0, 1.0)),
        r"lat agrees with speed and course only with the opposite sign: .* south as negative",
    ),
    "a clock that was set late": (
        CAR,
        clocked(
            "time",
            lambda p: [["1980-01-06 00:00:05"] * 2 + p.dates("%Y-%m-%d %H:%M:%S", MAY)[2:]],
        ),
        r"m\.csv:4:1: time rises by 44\.4 years, where rows usually are 1 s .* rows before \(2\)",
    ),
    "degrees in x and y": (
        CAR,
        lambda p: table("time,x,y", whole(p.t), *lonlat(p)),
        r"or in degrees, --set 'columns\.longitude=x' --set 'columns\.latitude=y', or if x is the"
        r" latitude, --set 'columns\.latitude=x' --set 'columns\.longitude=y'$",
    ),
    "bearings from a ship": (
        EAST,
        lambda p: table(
            "time,lat,lon,bearing", whole(p.t), *lonlat(p)[::-1], decimal(120.0 + 0.3 * p.t, 1)
        ),
        r"bearing is not the direction in which lat and lon move.*--set 'columns\.azimuth=bearing'",
    ),
    "a longitude called latitude": (
        Path2(rows=40, latitude=35.0, longitude=139.0),
        lambda p: table("time,lat,lon", whole(p.t), *lonlat(p)),
        r"a latitude is within -90 and 90 deg: .*, or exchange latitude and longitude$",
    ),
    "coordinates called ECEF": (
        CAR,
        lambda p: earth_centered(p).replace("x,y,z", "ecefX,ecefY,ecefZ"),
        r"coordinates from the center of the Earth \(ECEF\) are not read",
    ),
    "gon without a name": (
        EAST,
        lambda p: table(
            "time,range,azimuth",
            *(whole(p.t), decimal(polar(p)[0], 1), decimal((polar(p)[1] + 130.0) / 0.9, 2)),
        ),
        r"beyond a whole turn.*: if a turn has 400 gon, write degrees",
    ),
    "two zones": (EAST, two_zones, r"zone has 32T, 33T: each zone counts from a meridian"),
    "slant ranges": (
        EAST,
        slant_ranges,
        r"elevation_deg usually is 28\.4 deg.* by 12 %.*--set 'columns\.range=slant_range_m'",
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


def test_codes_of_phones_are_missing_cells(tmp_path: Path) -> None:
    scenario, written = guessed(tmp_path, phone(CAR))
    check_path(scenario, CAR)
    assert [sensor["kind"] for sensor in written["sensor"]] == ["position", "velocity"]
    measured = scenario.target._recording.measurements[2:, :, 0]
    has_velocity = np.isfinite(measured).all(axis=0)
    assert has_velocity.sum() == CAR.rows - 6
    away = np.hypot(*(measured - CAR.velocity[:, 1:]))[has_velocity]
    assert away.max() < 0.1
    (tmp_path / "g.yaml").unlink()
    # A course of -1 deg among others below zero is one.
    course = decimal((CAR.course + 180.0) % 360.0 - 180.0 - 36.0, 1)
    course[3] = "-1"
    text = table("time,x,y,speed,course", whole(CAR.t), *xy(CAR), decimal(CAR.speed, 2), course)
    scenario, _ = guessed(tmp_path, text, "columns.speed=speed", "columns.course=course")
    assert not any("course -1" in note for note in scenario.cautions)


@pytest.mark.parametrize("code", ["0", "-1.00"])
def test_positions_without_a_detection_are_missing(tmp_path: Path, code: str) -> None:
    x, y = (decimal(2000.0 + part, 2) for part in CAR.place)
    for row in (5, 6, 20):
        x[row] = y[row] = code
    scenario, written = guessed(tmp_path, table("time,x,y", whole(CAR.t), x, y))
    assert written["target"]["missing"] == [float(code)]
    measured = scenario.target._recording.measurements[:2, :, 0]
    assert np.isfinite(measured).all(axis=0).sum() == CAR.rows - 4
    # The user may know better; and a path through 0, 0 has this place.
    (tmp_path / "g.yaml").unlink()
    text = table("time,x,y", whole(CAR.t), x, y)
    _, written = guessed(tmp_path, text, "columns.x=x", "columns.y=y")
    assert "missing" not in written["target"]


def test_ranges_without_a_detection_are_missing(tmp_path: Path) -> None:
    ranges, azimuths = polar(EAST)
    cells = decimal(ranges, 1), decimal(azimuths, 2)
    for row in (5, 20):
        cells[0][row] = cells[1][row] = "0.0"
    _, written = guessed(tmp_path, table("time,range_m,azimuth_deg", whole(EAST.t), *cells))
    assert written["target"]["missing"] == [0.0]


def test_a_course_that_is_no_direction_of_the_positions_is_left_out(tmp_path: Path) -> None:
    course = decimal((CAR.course + 50.0) % 360.0, 1)
    text = table("time,x,y,speed,course", whole(CAR.t), *xy(CAR), decimal(CAR.speed, 2), course)
    _, written = guessed(tmp_path, text)
    assert [sensor["kind"] for sensor in written["sensor"]] == ["position"]
    assert "velocities are left out" in (tmp_path / "g.yaml").read_text()


def test_a_bearing_along_the_way_is_no_question(tmp_path: Path) -> None:
    course = decimal(CAR.course, 1)
    _, written = guessed(
        tmp_path, table("time,lat,lon,bearing", whole(CAR.t), *lonlat(CAR)[::-1], course)
    )
    assert [sensor["kind"] for sensor in written["sensor"]] == ["position"]


def test_the_largest_range_stands_for_no_detection(tmp_path: Path) -> None:
    ranges, azimuths = polar(EAST)
    cells = decimal(ranges, 1)
    for row in (5, 6, 20):
        cells[row] = "10000.0"
    text = table("time,range_m,azimuth_deg", whole(EAST.t), cells, decimal(azimuths, 2))
    _, written = guessed(tmp_path, text)
    assert written["target"]["missing"] == [10000.0]


def test_a_code_of_ten_digits_is_written_in_full(tmp_path: Path) -> None:
    longitude, latitude = (whole(1e7 * part) for part in CAR.degrees)
    latitude[5] = longitude[5] = "2147483647"
    text = table("time,lat,lon", whole(CAR.t), latitude, longitude)
    options = ("units.latitude=degE7", "units.longitude=degE7")
    scenario, written = guessed(tmp_path, text, *options)
    assert written["target"]["missing"] == [2147483647]
    assert np.isnan(scenario.target._recording.measurements[0, 4, 0])


def test_a_compressed_table_is_named_so(tmp_path: Path) -> None:
    (tmp_path / "m.csv.gz").write_bytes(gzip.compress(b"time,x,y\n0,1,2\n"))
    with pytest.raises(UserError, match=r"m\.csv\.gz:1:1: is compressed: unpack it first"):
        write_config_for(tmp_path / "m.csv.gz", "g", tmp_path)


def test_steps_have_an_interval_that_the_user_writes(tmp_path: Path) -> None:
    frame_numbers = [str(3 * k) for k in range(CAR.rows)]
    places = [decimal(0.01 * part, 4) for part in CAR.place]
    _, written = guessed(tmp_path, table("frame,x_m,y_m", frame_numbers, *places))
    assert written["target"]["units"] == {"x": "m", "y": "m"}
    assert written["T"] == 1


def test_a_course_over_ground_may_be_called_true(tmp_path: Path) -> None:
    motion = decimal(SHIP.speed / KNOT, 1), decimal(SHIP.course + 10.0, 1), decimal(SHIP.course, 1)
    names = "time,lat,lon,SOG (kn),COG (Mag),COG (True)"
    text = table(names, whole(SHIP.t), *lonlat(SHIP)[::-1], *motion)
    _, written = guessed(tmp_path, text)
    assert written["target"]["columns"]["course"] == "COG (True)"
    assert [sensor["kind"] for sensor in written["sensor"]] == ["position", "velocity"]


def test_tenths_of_degrees_of_a_radar_count_from_north(tmp_path: Path) -> None:
    write = radar_table("time,range (m),azimuth (0.1 deg)", 1.0, 0.1)
    _, written = guessed(tmp_path, write(EAST))
    assert written["target"]["units"]["azimuth"] == "deg/10"
    assert written["target"]["clockwise"] == ["azimuth"]


@pytest.mark.parametrize("name", ["acp", "azimuth_acp", "theta_acp"])
def test_pulses_of_a_radar_are_azimuths_from_north(tmp_path: Path, name: str) -> None:
    write = radar_table(f"time,range (m),{name}", 1.0, 360.0 / 4096.0)
    _, written = guessed(tmp_path, write(EAST))
    assert written["target"]["columns"]["azimuth"] == name
    assert written["target"]["units"]["azimuth"] == "acp"
    assert written["target"]["clockwise"] == ["azimuth"]
    assert (
        "acp  # guess: a turn has 4096 azimuth change pulses" in (tmp_path / "g.yaml").read_text()
    )


def test_a_number_for_no_detection_leaves_the_parts_of_a_second(tmp_path: Path) -> None:
    """0 and 0 are no place here, and 0 nanoseconds are a whole second."""
    path = Path2(rows=80, every=0.25)
    x, y = xy(path)
    for row in (5, 42):
        x[row] = y[row] = "0"
    x = [str(float(cell) + 900.0) if cell != "0" else cell for cell in x]
    seconds = 1_700_000_000 + path.t.astype(int)
    nanoseconds = np.rint(1e9 * (path.t % 1.0)).astype(int)
    text = table("stamp.sec,stamp.nanosec,x,y", seconds, nanoseconds, x, y)
    scenario, written = guessed(tmp_path, text)
    assert written["target"]["missing"] == [0]
    assert written["target"]["columns"]["subsecond"] == "stamp.nanosec"
    assert np.diff(scenario.times) == pytest.approx(0.25)
    assert len(scenario.times) == path.rows


def test_a_question_on_rows_names_their_line(tmp_path: Path) -> None:
    """Comments and blank lines count, and rows without a fix stand before the row, too."""
    path = Path2(rows=60)
    x, y = (decimal(part + 2000.0, 1) for part in path.place)
    x[30] = y[30] = "0"
    speeds = decimal(path.speed, 1)
    speeds[50] = "0"
    latitude, longitude = lonlat(path)[::-1]
    for row in range(4):
        latitude[row] = longitude[row] = "0"
    columns = (whole(path.t), latitude, longitude, x, y, speeds)
    lines = table("time,lat,lon,x,y,speed", *columns).splitlines()
    lines[3:3] = ["# the receiver starts", ""]
    # Names, two lines more, and 30 rows stand before.
    with pytest.raises(UserError, match=r"m\.csv:34:1: 1 row with x and y = 0 lies far"):
        guessed(tmp_path, "\n".join(lines) + "\n")
