"""Names and sizes of units: factors to SI, and words in names of columns, as (0.01 m)."""

import math
import re
from collections.abc import Collection
from math import pi

from trackbench.scenarios.recordings.quantity_keys import KEYS, QUATERNION, plain_name

DIMENSIONS = {
    "length": {
        "m": 1.0,
        "km": 1000.0,
        "ft": 0.3048,
        "mi": 1609.344,
        "nmi": 1852.0,
        "cm": 1e-2,
        "mm": 1e-3,
        "um": 1e-6,
    },
    "speed": {
        "m/s": 1.0,
        "km/h": 1 / 3.6,
        "kn": 1852.0 / 3600.0,
        "ft/s": 0.3048,
        "mph": 0.44704,
        "cm/s": 1e-2,
        "mm/s": 1e-3,
        "um/s": 1e-6,
        "km/s": 1e3,
        "kn/10": 1852.0 / 36000.0,
    },
    "angle": {
        "rad": 1.0,
        "mrad": 1e-3,
        "deg": pi / 180.0,
        # Whole numbers of devices: 1e-7, 1e-6 and 1e-5 deg, AIS, headings, FIT (2^31 are 180 deg), and
        # thousandths of a second of arc.
        "degE7": pi / 180.0e7,
        "degE6": pi / 180.0e6,
        "degE5": pi / 180.0e5,
        "deg/600000": pi / 180.0 / 600000.0,
        "deg/100": pi / 18000.0,
        "deg/10": pi / 1800.0,
        "semicircle": pi / 2.0**31,
        "mas": pi / 180.0 / 3.6e6,
        # Azimuth change pulses of radars: a turn has 4096.
        "acp": pi / 2048.0,
    },
    "turn rate": {
        "rad/s": 1.0,
        "deg/s": pi / 180.0,
    },
    "time": {
        "s": 1.0,
        "ms": 1e-3,
        "us": 1e-6,
        "ns": 1e-9,
        "min": 60.0,
        "h": 3600.0,
        "d": 86400.0,
        "100ns": 1e-7,
    },
}
UNITS: dict[str, float] = {}
"""SI value of each unit."""
for _units in DIMENSIONS.values():
    UNITS.update(_units)
DIMENSION_OF = {
    **dict.fromkeys(("time", "subsecond"), "time"),
    **dict.fromkeys(("x", "y", "z", "altitude", "range"), "length"),
    **dict.fromkeys(("vx", "vy", "vz", "speed", "range_rate"), "speed"),
    **dict.fromkeys(
        ("latitude", "longitude", "course", "azimuth", "elevation", "bearing"), "angle"
    ),
}
"""Dimension of each quantity; that of a plugin's own quantities may be any."""
UNIT_WORDS = {
    **{unit: unit for unit in UNITS},
    **{"feet": "ft", "foot": "ft", "miles": "mi", "nm": "nmi", "metre": "m", "meter": "m"},
    **{"meters": "m", "metres": "m", "kilometers": "km", "kilometres": "km"},
    **{"umps": "um/s", "mi/h": "mph", "nmi/h": "kn", "nm/h": "kn", "km/hr": "km/h"},
    **{"km/hour": "km/h", "mi/hr": "mph"},
    **{
        "degree": "deg",
        "degrees": "deg",
        "grad": "deg",
        "gradi": "deg",
        "grados": "deg",
        "graden": "deg",
    },
    **{"radians": "rad", "radian": "rad"},
    **{"knots": "kn", "knot": "kn", "kt": "kn", "kts": "kn", "kmh": "km/h", "kph": "km/h"},
    **{
        "kmps": "km/s",
        "kmph": "km/h",
        "fps": "ft/s",
        "cmps": "cm/s",
        "mmps": "mm/s",
        "dps": "deg/s",
    },
    **{"degps": "deg/s", "radps": "rad/s"},
    **{"mps": "m/s", "e7": "degE7", "dege7": "degE7", "1e7": "degE7"},
    **{"semicircles": "semicircle", "e6": "degE6", "dege6": "degE6", "1e6": "degE6"},
    **{"milliarcsec": "mas", "milliarcsecond": "mas", "milliarcseconds": "mas"},
    **{"sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s"},
    **{"millis": "ms", "msec": "ms", "millisecond": "ms", "milliseconds": "ms"},
    **{"usec": "us", "micros": "us", "microseconds": "us", "nsec": "ns", "nanos": "ns"},
    **{
        "nanoseconds": "ns",
        "nanosecond": "ns",
        "hours": "h",
        "minutes": "min",
        "days": "d",
        "doy": "d",
    },
}
OTHER_UNITS = frozenset(
    {"yd", "yds", "yard", "yards", "kyd", "fathom", "fathoms", "dm", "hm", "kft"}
    | {"in", "inch", "inches", "zoll", "sm"}
    | {"gon", "gons", "mil", "mils", "arcmin", "arcsec", "fpm"}
    | {"grade", "grades", "grads", "gradian", "gradians"}
)
"""Words that are units of lengths, angles and speeds, and none that a recording may have."""
OTHER_TIME_UNITS = frozenset(
    {"cs", "csec", "centisec", "centisecs", "centisecond", "centiseconds", "hundredths"}
    | {"ds", "dsec", "decisec", "deciseconds", "tenths", "ticks", "tick", "jiffies", "samples"}
)
"""Last words in the name of a column of times that are units which trackbench cannot convert."""
_PER_SECOND = re.compile(
    r"(?<![a-z])(km|m|dm|cm|mm|um|ft|deg|rad)(?:[_ ]per[_ ]|[_ .]?(?=[sh]\^?-1)|_)"
    r"(s|h)(?:\^?-1)?(?![a-z0-9])"
)
_PER_MINUTE = re.compile(
    r"(?<![a-z])(km|m|cm|mm|ft)(?:[_ ]per[_ ]|[_ .]?(?=min\^?-1)|_)min(?![a-z0-9])"
)
RATES = r"(?:km|dm|cm|mm|um|ft|mi|nmi|nm|yd|m)/(?:minutes?|min|s|hours?|hr|h|days?|d)(?![a-z0-9])"
"""Pattern of units of speeds, which are one word in spite of the slash; most are unknown."""
_NAUTICAL_MILES = re.compile(r"(?:nautical|sea)[ _-]?miles?|seemeilen?|milles? marins?")
_MICROMETERS = re.compile(r"microns?(?![a-z])|micromet(?:er|re)s?(?![a-z])")
_BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]")
_NUMBER = r"\d+(?:\.\d+)?(?:e[-+]?\d+)?(?:/\d+)?"
_UNIT = "|".join(sorted(map(re.escape, {*UNIT_WORDS, *OTHER_UNITS}), key=len, reverse=True))
_SCALED_UNITS = (
    re.compile(rf" *(?P<factor>{_NUMBER}) *[*x]? *(?P<unit>{_UNIT}) *"),
    re.compile(rf" *(?P<unit>{_UNIT}) *(?P<sign>[*x/]) *(?P<factor>{_NUMBER}) *"),
)
"""A unit with a factor, as it stands in brackets: 0.1 m, 1/256 nm, 1e-7 deg, m*100."""


def is_unit_of(quantity: str, unit: str) -> bool:
    """Test whether a unit is one of the quantity's dimension; False for quantities of any dimension."""
    return unit in DIMENSIONS.get(DIMENSION_OF.get(plain_name(quantity), ""), ())


def usual_unit(quantity: str) -> str:
    """Return a common unit of the quantity, for an example: deg of an angle, else that of the SI."""
    dimension = DIMENSION_OF.get(plain_name(quantity), "length")
    if dimension == "angle":
        return "deg"
    return next(iter(DIMENSIONS[dimension]))


def have_one_dimension(unit: str, other: str) -> bool:
    """Test whether two units are of one dimension, such as km and ft."""
    return any(unit in units and other in units for units in DIMENSIONS.values())


def mistaken_unit(key: str, unit: str, is_scalar: bool) -> str | None:
    """Return the reason why a quantity, or another column, cannot have this unit; None if it can.

    ``key`` is the quantity, or the key of a column that has no unit, such as run. The x and z of a
    scalar state (``is_scalar``), which is no position, may have any unit.
    """
    if key in (*KEYS, *QUATERNION) and key not in DIMENSION_OF:
        return f"a {key} has no unit: leave it out"
    if is_scalar and key in ("x", "z"):
        return None
    dimension = DIMENSION_OF.get(plain_name(key))
    if dimension is None or unit in DIMENSIONS[dimension]:
        return None
    allowed = ", ".join(DIMENSIONS[dimension])
    return f"{unit!r} is not a unit of {dimension}, which {key} has; allowed: {allowed}"


def unit_in(words: Collection[str], quantity: str) -> str | None:
    """Return the last unit of the quantity's dimension that one of the words names; None without one."""
    last = None
    for word in words:
        if word in UNIT_WORDS and is_unit_of(quantity, UNIT_WORDS[word]):
            last = UNIT_WORDS[word]
    return last


def is_other_unit(word: str) -> bool:
    """Test whether a word is a unit that trackbench cannot convert, such as yd and 0.1*m."""
    is_rate = re.fullmatch(RATES, word) is not None
    return word in OTHER_UNITS or "*" in word or (is_rate and word not in UNIT_WORDS)


def spell_units(name: str) -> str:
    """Return a column's name, in small letters, in which units are written as in `UNIT_WORDS`."""
    name = _MICROMETERS.sub("um", name)
    # m_s, m per s and m s^-1 are m/s.
    name = _PER_SECOND.sub(r"\1/\2", name)
    name = _PER_MINUTE.sub(r"\1/min", name)
    name = _NAUTICAL_MILES.sub("nmi", name)
    # [0.01 m] is cm; [0.1 m], which has no name, is one word, 0.1*m.
    return _BRACKETS.sub(_name_scaled_unit, name)


def _name_scaled_unit(match: re.Match[str]) -> str:
    """Return the known unit, in brackets, for a unit with a factor in brackets: (cm) for [0.01 m].

    Without a known unit of this size it becomes one word, such as (0.1*m). Other brackets stay.
    """
    text = re.sub(r"10\^(-?\d+)", r"1e\1", match[1].replace(" x 10^", "*10^"))
    for pattern in _SCALED_UNITS:
        scaled = pattern.fullmatch(text)
        if scaled is None:
            continue
        number, _, divisor = scaled["factor"].partition("/")
        factor = float(number) / float(divisor or 1)
        if "sign" in scaled.groupdict():
            # A number in m*100 or m/100 counts hundredths of a meter.
            factor = 1.0 / factor
        unit = UNIT_WORDS.get(scaled["unit"], "")
        if unit == "h" and factor in (12.0, 24.0):
            return ""  # a clock of 12 or 24 hours
        for other, size in UNITS.items():
            if (
                unit
                and math.isclose(size, factor * UNITS[unit])
                and have_one_dimension(unit, other)
            ):
                return f"({other.lower()})"
        return f"({factor:g}*{scaled['unit']})"
    return match[0]
