"""Recognition of columns by their names: which words stand for a quantity, a clock or a unit."""

import re
import unicodedata
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import product
from typing import NamedTuple

from trackbench.errors import first_names
from trackbench.scenarios.recordings.unit_names_and_sizes import (
    OTHER_UNITS,
    RATES,
    UNIT_WORDS,
    is_other_unit,
    is_unit_of,
    spell_units,
    unit_in,
)

WORDS_OF_QUANTITIES: dict[str, str] = {
    "time": "stamp time timestamp t timesec datetime datetimeutc basedatetime utctime timeutc utc "
    "tst czas seconds secs sec elapsed secondselapsed elapsedseconds elapsedtime millis ms "
    "epoch unixtime gpstime systime timeofday tod tow gpstow itow gpst measurementtime "
    "tvsec gms sow secondsofweek sod secondsofday secofday updatetime hours jd juliandate mjd "
    "filetime when measuredat datenum matlabtime micros micro microseconds usec timeusec timecode "
    "flytime hhmm hhmmss mmss timegenerated timelogged days minutes "
    "doy now timeover timemessagegenerated trialtime recordingtime recordingtimestamp gazetimestamp "
    "timeutcg fechayhora fechahora "
    "zeit zeitstempel uhrzeit temps heure hora tiempo tempo ora tid tijd klokkeslett",
    "date": "date dateutc utcdate datum fecha data dato jour dategenerated datelogged "
    "datemessagegenerated",
    "step": "step k frame scan frameid",
    "received": "received",
    "sensor": "sensor sensorid anchor anchorid beacon beaconid radar radarid station stationid "
    "sensorname anchorname device deviceid source sourceid sensortype type node nodeid stn stnid site "
    "siteid",
    "run": "run mmsi sourcemmsi icao24 icao hexident icaohex trackid track vessel vesselid "
    "objectid object vehicleid stormid storm cycloneid cyclone stormname callsign "
    "individuallocalidentifier id",
    "latitude": "latitude lat latn latituden breite breitengrad breddegrad latitud latitudine "
    "breedtegraad",
    "longitude": "longitude lon lone longitudee lng long lange langengrad laenge laengengrad "
    "lengdegrad longitud longitudine lengtegraad",
    "x": "zx x px posx xpos tx mx east easting e xm rechtswert xeast ostlig",
    "y": "zy y py posy ypos ty my north northing n ym hochwert ynorth nordlig",
    "vx": "vx velx vxm xvelocity velocityx speedx eastspeed veast ve vele",
    "vy": "vy vely vym yvelocity velocityy speedy northspeed vnorth vn veln",
    "range": "range rng rmsd rho distance dist slantrange slantrng rangeto entfernung abstand "
    "distanz distanza distancia afstand r",
    "azimuth": "azimuth az bearing theta azimut truebearing bearingtrue trueazimuth azimuthtrue brg "
    "brgt azimuthnorth azimuthfromnorth bearingnorth compassbearing bearingcompass "
    "peilung relevement acp angle phi",
    "speed": "speed spd sog speedoverground groundspeed gs velocity vel geschwindigkeit vitesse "
    "velocidad kts kt knots gspeed hspeed gndspeed gndspd groundspd kmh kmph kph km/h mph",
    "course": "course track trk gcrs cog courseoverground trackangle heading hdg direction bearing kurs "
    "cap rumbo headmot cogtrue cogt courseovergroundt truecourse truetrack tracktrue groundtrack "
    "gndtrack cse cset",
}
"""Names of each quantity's columns, without accents and white space, the surest first."""
_PARTNERS = {"range": ("azimuth", ("r",)), "azimuth": ("range", ("acp", "angle", "phi"))}
"""Quantity that must have a column, too, if a range or azimuth is called by such a short name."""
FILLERS = (
    "boot gmt cest cet field fields msg data header pose position positions pos loc location gps gnss "
    "gpsfix fix navsatfix trkpt wpt local global int map world odom odometry p z rs r s meas measured "
    "measurement obs observed est hat coord coordinate coordinates point xyz enu utm wgs84 filtered "
    "raw utc value mathrm text rm obj ego target veh vehicle robot uav drone frame from sensor base "
    "enhanced osd custom tagblock translation baseline noisy center centre centroid gaze norm"
)
"""Words that may stand beside a quantity in a name: field.pose.pose.position.x, p_RS_R_x."""
COORDINATES = (("x", "y"), ("latitude", "longitude"), ("vx", "vy"))
"""Pairs of quantities that have to be of one source."""
TRUTH_WORDS = frozenset(("true", "truth", "gt", "groundtruth", "ground", "ref", "reference"))
"""Words in the names of columns with a truth."""
_MEASURED_WORDS = frozenset(("meas", "measured", "measurement", "obs", "observed", "noisy"))
"""Words of a measurement, which comes before a column without such a word: that may be the truth."""
_ESTIMATED_WORDS = frozenset(("est", "hat", "filtered"))
"""Words of the result of a filter, which comes after a column without such a word."""
_SIDES = {
    "latitude": frozenset(("n", "north", "s", "south")),
    "longitude": frozenset(("e", "east", "w", "west")),
}
"""Words in the name of a coordinate's column for the side to which its numbers count."""
_NEGATIVE_SIDES = {"s": "south", "south": "south", "w": "west", "west": "west"}
_CLOCK_WORDS = re.compile(
    r"(?:unix|posix|epoch|utc|gps|gnss|time|timestamp|stamp|since|1970|t|ts|"
    r"(?:milli|micro|nano)?s(?:ec|ecs|econd|econds)?|millis|micros|nanos|msecs?|usecs?|nsecs?|[mun]s)+"
)
"""Joined words of a name that is a clock's, such as time_unix_ms, ms_since_epoch and t_unix."""
_EPOCHS = re.compile("unix|posix|epoch|since1970")
_TIME_WORDS = re.compile("time|stamp")
HOURS = frozenset(("hour", "hours", "hr", "hrs", "hh", "h"))
"""Names of columns that may have the hours of times; those of other parts follow."""
MINUTES = frozenset(("minute", "minutes", "min", "mins", "mm", "mi"))
SECONDS = frozenset(("second", "seconds", "sec", "secs", "s"))
_DAYS = frozenset(("day", "days", "doy"))
_ODOMETRY_UNITS = {"v": ("m/s", "km/h", "cm/s", "mm/s"), "w": ("rad/s", "deg/s")}
_MOST_NAMES = 24
"""names in a message"""
_MOST_LETTERS = 40
"""letters of a name in a message"""
_LETTERS = str.maketrans({"µ": "u", "μ": "u", "ø": "o", "ß": "s", "æ": "e"})


class NamedColumn(NamedTuple):
    """A column that may be a quantity, and the unit in its name."""

    column: str
    unit: str | None


class _Rank(NamedTuple):
    """Rank of a column that may be a quantity; of several columns the one with the least rank is it.

    An earlier field counts more than all later ones.
    """

    is_no_stamp: bool
    """True for a column of times that is not the stamp of a message"""
    estimate: int
    """-1 for a measured value, 1 for the result of a filter, 0 if the name says neither"""
    has_fillers: bool
    """True if the name is known only without words such as gps, which may stand beside any quantity"""
    word: int
    """place of its name in `WORDS_OF_QUANTITIES`, the surest first"""
    column_number: int
    """place of the column in the table"""
    name: str
    """name of the column"""


def columns_of(
    names: Iterable[str], given: Mapping[str, str] | None = None
) -> dict[str, NamedColumn]:
    """Return the column of each quantity that a table's columns ``names`` seem to have.

    If several columns may be one quantity, it is the one with the surest name, and otherwise the first.
    Both coordinates are of one source if possible: the y of gps_x is gps_y, and not odom_y. ``given``
    are the columns of quantities that are known.
    """
    # Step 1: spell each name in several ways, without the words that do not name a quantity.
    words_by_name = {name: words_of(name) for name in names}
    # Each name is tried in three spellings: as it is, without units, and without words that say nothing.
    fillers = FILLERS.split()
    spellings = {}
    for name, words in words_by_name.items():
        without_units = words_without_units(words)
        without_fillers = [word for word in without_units if word not in fillers]
        spellings[name] = ["".join(words), "".join(without_units), "".join(without_fillers)]
    # Step 2: rank the columns of each quantity, the least rank first.
    columns = {}
    ranks_by_quantity = {}
    joined_words = {"".join(words) for words in words_by_name.values()}
    has_parts = not joined_words.isdisjoint(HOURS) and not joined_words.isdisjoint(MINUTES)
    for quantity, text in WORDS_OF_QUANTITIES.items():
        rank_of_word = {word: place for place, word in enumerate(text.split())}
        ranks = []
        for index, (name, words) in enumerate(words_by_name.items()):
            names_of_one = spellings[name]
            # A coordinate is also spelled without the side to which it counts: lat_n is a latitude.
            if quantity in _SIDES:
                names_of_one = [*names_of_one, _without_side(words, quantity)]
            known = [spelling for spelling in names_of_one if spelling in rank_of_word]
            # Such a name of a clock comes behind all names that are known words of a time.
            if not known and quantity == "time" and _is_clock(words):
                rank = _Rank(
                    is_no_stamp=True,
                    estimate=0,
                    has_fillers=True,
                    word=len(rank_of_word),
                    column_number=index,
                    name=name,
                )
                ranks.append(rank)
            if known:
                # The stamp of a message is the time of its measurement; others may be times of logging.
                rank = _Rank(
                    is_no_stamp=quantity == "time" and words[-1] != "stamp",
                    estimate=0 if quantity == "time" else _rank_of_estimate(words),
                    has_fillers=known[0] not in spellings[name][:2],
                    word=rank_of_word[known[0]],
                    column_number=index,
                    name=name,
                )
                ranks.append(rank)
        if quantity == "time" and has_parts:
            parts = _DAYS | HOURS | MINUTES | SECONDS
            # Beside hours and minutes a column of seconds, minutes or days has a part of the time alone.
            whole_times = [rank for rank in ranks if "".join(words_by_name[rank.name]) not in parts]
            ranks = whole_times or ranks
        ranks_by_quantity[quantity] = sorted(ranks)
        if ranks:
            name = min(ranks).name
            columns[quantity] = NamedColumn(column=name, unit=unit_of(name, quantity))
    # Step 3: choose both coordinates of a pair from one source.
    for pair in COORDINATES:
        candidates = [[rank.name for rank in ranks_by_quantity[quantity]] for quantity in pair]
        for index, quantity in enumerate(pair):
            if given and quantity in given:
                candidates[index] = [given[quantity]]
        for quantity, name in zip(pair, _pair_of_one_source(*candidates), strict=False):
            columns[quantity] = NamedColumn(column=name, unit=unit_of(name, quantity))
    # Step 4: a short name such as r is a range only beside an azimuth.
    for quantity, (partner, short_names) in _PARTNERS.items():
        if quantity in columns and partner not in columns:
            name = columns[quantity].column
            if not {*spellings[name]}.isdisjoint(short_names):
                del columns[quantity]
    return columns


def _without_side(words: list[str], quantity: str) -> str:
    """Return the joined words of a coordinate's name without units, fillers and sides such as north.

    Fillers are words that may stand beside any quantity, such as gps.
    """
    ignored = _SIDES[quantity].union(FILLERS.split())
    return "".join(word for word in words_without_units(words) if word not in ignored)


def negative_side_of(name: str, quantity: str) -> str:
    """Return "south" or "west" if the name of a coordinate's column ends so; empty otherwise.

    ``quantity`` is latitude or longitude.
    """
    last = words_of(name)[-1]
    if last not in _SIDES[quantity]:
        return ""
    return _NEGATIVE_SIDES.get(last, "")


def _rank_of_estimate(words: Collection[str]) -> int:
    """Return the rank of a column by its name's words: -1 if measured, 1 if estimated, else 0."""
    if not _MEASURED_WORDS.isdisjoint(words):
        return -1
    return int(not _ESTIMATED_WORDS.isdisjoint(words))


def _pair_of_one_source(first: Iterable[str], second: Iterable[str]) -> tuple[str, ...]:
    """Return the columns of two coordinates that are of one source; empty if there are none.

    Their names then have the same further words, such as gps. ``first`` and ``second`` are the possible
    columns of each coordinate, the surest first.
    """
    fillers = FILLERS.split()
    for name, other in product(first, second):
        words, other_words = (
            {word for word in words_of(column) if word in fillers} for column in (name, other)
        )
        if words == other_words:
            return name, other
    return ()


def _is_clock(words: list[str]) -> bool:
    """Test whether the words of a name are those of a clock alone, in any order: unix_ms, time_gps_s.

    The name has unix, posix, epoch or since1970 in it. Or it has time, stamp or ts, as in time_ms. Or it
    has utc, gps or gnss beside t or a unit of a time, as in gps_s.
    """
    name = "".join(words)
    if not _CLOCK_WORDS.fullmatch(name):
        return False
    if _EPOCHS.search(name):
        return True
    has_unit = any(is_unit_of("time", UNIT_WORDS.get(word, "")) for word in words)
    # time, stamp and ts count in both conditions, so that one of these words is enough.
    has_time = has_unit or bool({"t", "ts"} & {*words}) or bool(_TIME_WORDS.search(name))
    return has_time and bool({"utc", "gps", "gnss", "ts"} & {*words} or _TIME_WORDS.search(name))


def unit_of(name: str, quantity: str) -> str | None:
    """Return the unit in the ``name`` of a quantity's column; None without one.

    Only units of the quantity's dimension count.
    """
    words = words_of(name)
    if quantity in _ODOMETRY_UNITS:
        # The first word is the quantity's.
        units = [UNIT_WORDS[word] for word in words[1:] if word in UNIT_WORDS]
        return next((unit for unit in units if unit in _ODOMETRY_UNITS[quantity]), None)
    # If all words together are a known name of the quantity, none is a unit: the D of ToD is no day.
    # But if the name without its last word is known as well, as x of x_m is, this word is a unit.
    known = WORDS_OF_QUANTITIES.get(quantity, "").split()
    if len(words) > 1 and "".join(words) in known and "".join(words[:-1]) not in known:
        return None
    return unit_in(words, quantity)


def looks_like(name: str, quantity: str) -> bool:
    """Test whether a column's name has a word or a unit of ``quantity``, a range or an azimuth.

    Words of one or two letters, such as r, do not count.
    """
    words = words_of(name)
    known = [word for word in WORDS_OF_QUANTITIES[quantity].split() if len(word) > 2]
    return not {*words}.isdisjoint(known) or unit_in(words[1:], quantity) is not None


def other_unit_of(name: str) -> str | None:
    """Return the last word of a column's name if it is a unit that trackbench cannot convert."""
    words = words_of(name)
    if len(words) > 1 and is_other_unit(words[-1]):
        return words[-1]
    return None


def other_unit_in_line(cell: str) -> str | None:
    """Return the unit in a cell of a line of units if trackbench cannot convert it; else None."""
    # In brackets, as units in the names of columns are.
    words = words_of(f"({cell})")
    if words and is_other_unit(words[-1]):
        return words[-1]
    return None


_DEGREE_SIGN = re.compile(r"[°˚](?! *[CF]\b)|(?<=[\[(])º(?=[\])/])")
"""Sign of a degree of an angle, and not of a temperature; º, as in Nº, is one alone in brackets."""


def words_of(name: str) -> list[str]:
    r"""Split a name into words in small letters: pos, x and km of posX_km, and vx of $\dot{x}$.

    A name without Latin letters and digits is one word.
    """
    whole_name = name.strip().lower()
    # In LaTeX, \dot{x} is vx.
    name = re.sub(r"\\dot\s*\{?\s*(\w)\s*\}?", r"v\1", name).translate(_LETTERS)
    name = _DEGREE_SIGN.sub(" deg", name)
    # Letters lose their accents, and signs that are no letters are lost.
    name = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    # posX is pos x.
    name = re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower()
    name = spell_units(name)
    # Some units are one word in spite of the slash, and so is a unit with a factor, such as 0.1*m.
    units = r"rad/s|deg/s|km/h|km/s|cm/s|mm/s|um/s|m/s|ft/s|deg/600000|deg/100|deg/10|kn/10"
    words = re.findall(rf"[0-9.e/+-]+\*[a-z0-9/]+|{RATES}|{units}|[a-z0-9]+", name)
    return words or [whole_name]


def words_without_units(words: list[str]) -> list[str]:
    """Return the words without units; the first word stays."""
    units = OTHER_UNITS.union(UNIT_WORDS)
    return [
        word for i, word in enumerate(words) if i == 0 or not (word in units or is_other_unit(word))
    ]


def shown_names(names: Sequence[str]) -> str:
    """Return names for a message: the first ones, shortened, and the number of the others."""
    return first_names([name[:_MOST_LETTERS] for name in names], _MOST_NAMES)
