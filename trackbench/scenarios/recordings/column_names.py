"""Columns that people's tables have: their quantities and units, by the words in the names."""

import re
import unicodedata
from collections.abc import Collection, Iterable
from typing import NamedTuple

from trackbench.scenarios.recordings.column_mapping import UNITS, is_unit_of

_WORDS: dict[str, str] = {
    "time": "stamp time timestamp t timesec datetime datetimeutc basedatetime utctime timeutc utc "
    "tst czas seconds secs sec elapsed secondselapsed elapsedseconds elapsedtime millis ms "
    "epoch unixtime gpstime systime timeofday tod tow gpstow itow gpst measurementtime "
    "tvsec gms sow secondsofweek updatetime hours jd juliandate mjd filetime "
    "zeit zeitstempel uhrzeit temps heure hora tiempo tempo ora tid tijd klokkeslett",
    "date": "date dateutc utcdate datum fecha data dato jour",
    "step": "step k frame scan frameid",
    "received": "received",
    "sensor": "sensor sensorid anchor anchorid beacon beaconid radar radarid station stationid "
    "sensorname anchorname device deviceid source sourceid sensortype type node nodeid",
    "run": "run mmsi sourcemmsi icao24 icao trackid track vessel vesselid objectid object vehicleid "
    "callsign individuallocalidentifier id",
    "latitude": "latitude lat latn latituden breite breitengrad breddegrad latitud latitudine "
    "breedtegraad",
    "longitude": "longitude lon lone longitudee lng long lange langengrad laenge laengengrad "
    "lengdegrad longitud longitudine lengtegraad",
    "x": "x px posx xpos tx zx mx east easting e xm rechtswert xeast ostlig",
    "y": "y py posy ypos ty zy my north northing n ym hochwert ynorth nordlig",
    "vx": "vx velx vxm xvelocity velocityx speedx eastspeed veast ve vele",
    "vy": "vy vely vym yvelocity velocityy speedy northspeed vnorth vn veln",
    "range": "range rmsd rho distance dist slantrange entfernung abstand",
    "azimuth": "azimuth az bearing theta azimut truebearing bearingtrue trueazimuth azimuthtrue brg "
    "peilung relevement",
    "speed": "speed spd sog speedoverground groundspeed gs velocity vel geschwindigkeit vitesse "
    "velocidad kts kt knots gspeed hspeed",
    "course": "course track trk gcrs cog courseoverground trackangle heading hdg direction bearing kurs "
    "cap rumbo headmot",
}
"""Names of each quantity's columns, without accents and white space, the surest first."""
_FILLERS = (
    "boot gmt cest cet field fields msg data header pose position positions pos loc location gps gnss "
    "gpsfix fix navsatfix trkpt wpt local global map world odom odometry p z rs r s meas measured "
    "measurement obs observed est hat coord coordinate coordinates point xyz enu utm wgs84 filtered "
    "raw utc value mathrm text rm obj ego target veh vehicle robot uav drone frame from sensor base "
    "enhanced osd custom tagblock"
)
"""Words that may stand beside a quantity in a name: field.pose.pose.position.x, p_RS_R_x."""
_UNITS = {
    **{unit: unit for unit in UNITS},
    **{"feet": "ft", "foot": "ft", "miles": "mi", "nm": "nmi", "metre": "m", "meter": "m"},
    **{"meters": "m", "metres": "m", "kilometers": "km", "kilometres": "km"},
    **{"degree": "deg", "degrees": "deg", "grad": "deg", "radians": "rad", "radian": "rad"},
    **{"knots": "kn", "knot": "kn", "kt": "kn", "kts": "kn", "kmh": "km/h", "kph": "km/h"},
    **{"mps": "m/s", "e7": "degE7", "dege7": "degE7", "1e7": "degE7"},
    **{"semicircles": "semicircle", "e6": "degE6", "dege6": "degE6", "1e6": "degE6"},
    **{"sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s"},
    **{"millis": "ms", "msec": "ms", "millisecond": "ms", "milliseconds": "ms"},
    **{"usec": "us", "micros": "us", "microseconds": "us", "nsec": "ns", "nanos": "ns"},
    **{"nanoseconds": "ns", "nanosecond": "ns", "hours": "h", "minutes": "min"},
}
_SUBSECONDS: dict[str, str] = {
    **dict.fromkeys(("nanosec", "nanosecs", "nsec", "nsecs", "nanos", "ns"), "ns"),
    **dict.fromkeys(("nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("usec", "usecs", "microsec", "microsecs", "micros", "us"), "us"),
    **dict.fromkeys(("microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
}
"""Last words of columns that may hold the part of a time within its second."""
_WEEKS = ("week", "gpsweek", "gwk", "wn", "weekno", "weeknumber", "gpsweekno", "gpsweeknumber")
_RANGE_TO = re.compile(
    r"(?:range|dist|distance|rng|d|r|toa|tof|uwb)(?:to|from)?([a-z]{0,2}\d+)|((?:a|anchor|beacon)\d+)"
)
_LETTERS = str.maketrans({"µ": "u", "μ": "u", "ø": "o", "ß": "s", "æ": "e"})


class NamedColumn(NamedTuple):
    """A column that may be a quantity, and the unit in its name."""

    column: str
    unit: str | None


def columns_of(names: Iterable[str]) -> dict[str, NamedColumn]:
    """Find each quantity's column: the surest name, and of equally sure ones the first."""
    words_by_name = {name: words_of(name) for name in names}
    # A name that is the quantity's own word comes before one with a unit, or with further words.
    spellings, fillers = {}, _FILLERS.split()
    for name, words in words_by_name.items():
        plain = _without_units(words)
        bare = (word for word in plain if word not in fillers)
        spellings[name] = [*map("".join, (words, plain, bare))]
    out = {}
    for quantity, text in _WORDS.items():
        known = {word: rank for rank, word in enumerate(text.split())}
        ranks = []
        for place, (name, words) in enumerate(words_by_name.items()):
            joined = next(filter(known.__contains__, spellings[name]), None)
            if joined is not None:
                # A message's stamp is nearer to the measurement than the time it was logged.
                is_late = quantity == "time" and words[-1] != "stamp"
                has_fillers = joined not in spellings[name][:2]
                ranks.append((is_late, has_fillers, known[joined], place, name))
        if ranks:
            name = min(ranks)[-1]
            words = words_by_name[name]
            is_whole = len(words) > 1 and spellings[name][0] in known  # a D of ToD is no day
            out[quantity] = NamedColumn(name, None if is_whole else unit_in(words, quantity))
    return out


def rest_of_stamp(
    names: Iterable[str], clock: str, known: Collection[str] = ()
) -> dict[str, NamedColumn]:
    """Find columns that look like further parts of a time: its GPS week, and its nanoseconds.

    Only the numbers show whether they are.
    """
    before = _words_before_unit(clock)
    out: dict[str, NamedColumn] = {}
    for name in names:
        words = words_of(name)
        if name == clock or not words:
            continue
        if "week" not in known and "".join(_without_fillers(words)) in _WEEKS:
            out.setdefault("week", NamedColumn(name, None))
        unit = _SUBSECONDS.get(words[-1])
        # Of header.stamp.nanosec the rest of the name is that of header.stamp.sec.
        if unit and "subsecond" not in known and words[:-1] in ([], before, words_of(clock)):
            out.setdefault("subsecond", NamedColumn(name, unit))
    return out


def _words_before_unit(name: str) -> list[str]:
    words = words_of(name)
    return words[:-1] if words and words[-1] in _UNITS else words


def _without_fillers(words: list[str]) -> list[str]:
    fillers = _FILLERS.split()
    return [word for word in words if word not in fillers or word == words[0]]


def ranges_of(names: Iterable[str]) -> dict[str, NamedColumn]:
    """Find columns of ranges to numbered places (d1, range_A2 [m]), by the place."""
    out = {}
    for name in names:
        words = words_of(name)
        match = _RANGE_TO.fullmatch("".join(_without_units(words)))
        if match:
            out[match[1] or match[2]] = NamedColumn(name, unit_in(words, "range"))
    return out if len(out) > 1 else {}


def unit_in(words: Collection[str], quantity: str) -> str | None:
    """Find the last word that is a unit of the quantity."""
    units = [_UNITS[word] for word in words if word in _UNITS]
    return next((unit for unit in reversed(units) if is_unit_of(quantity, unit)), None)


def words_of(name: str) -> list[str]:
    r"""Split a name into words in small letters: pos, x and km of posX_km, and vx of $\dot{x}$."""
    name = re.sub(r"\\dot\s*\{?\s*(\w)\s*\}?", r"v\1", name).translate(_LETTERS)
    name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    name = re.sub(r"([a-z])([A-Z])", r"\1 \2", name.replace("°", " deg")).lower()
    return re.findall(r"km/h|cm/s|mm/s|m/s|ft/s|[a-z0-9]+", name)


def _without_units(words: list[str]) -> list[str]:
    return [word for i, word in enumerate(words) if i == 0 or word not in _UNITS]
