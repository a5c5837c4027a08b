"""Names of columns of labels: words for a sensor, a target, a place or the quality of each row."""

import re
from typing import Literal

from trackbench.scenarios.recordings.recognize_column_names import words_of


def _word_set(text: str) -> frozenset[str]:
    return frozenset(text.split())


QUALITY_WORDS = _word_set(
    "fix fixtype quality qual q status state mode ns nsat nsats sats satellites numsat hdop pdop vdop "
    "gdop valid validity flag flags solution sol soltype accuracy acc battery health error class level "
    "confidence conf snr rssi amplitude gear switch armed"
)
"""Words in the names of columns that say how good a row is, not whose it is."""
_SENSORS = _word_set(
    "sensor source src provider device radar station receiver tracker camera lidar antenna instrument "
    "quelle fuente fonte bron kilde capteur sensore geber"
)
NO_LABELS = _word_set(
    "min max mean avg average median std stdev stddev var sigma variance cov covariance rms rmse sum "
    "total count num number cum err error errors bias offset noise residual res resolution rate dot "
    "delta diff change raw true truth gt ref reference value meas measured measurement obs observed "
    "est estimate estimated hat filtered filt smooth smoothed corrected corr uncorrected predicted pred "
    "calibrated cal prev previous last next first index idx u z up down height alt altitude elevation "
    "elev horizontal vertical lateral longitudinal front rear back left right forward ahead side roll "
    "pitch yaw travelled traveled driven unit units name type"
)
"""Words that tell names of columns apart, and name no place: statistics, axes and sides."""
PLACES = _word_set(
    "anchor beacon landmark landmarks marker tower reflector fiducial aruco apriltag"
)
"""Words for things at places of their own."""
_TARGETS = _word_set(
    "mmsi icao icao24 hex callsign flight tail vessel ship boat vehicle car truck bus drone uav "
    "aircraft plane robot object target track trackid objectid person player animal bird "
    "individual agent tag storm cyclone hurricane typhoon pedestrian bike rider runner schiff boot "
    "fahrzeug flugzeug navire bateau avion buque barco nave skib schip vliegtuig"
)
_OBJECTS = ("mmsi", "icao24", "icao", "callsign", "trackid", "vessel", "object")
"""Names of columns that divide a table into runs if the config names no column of runs."""
LANDMARK_WORDS = _word_set(
    "tag tagid id marker markerid feature featureid lm code signature subject target object"
)
"""Words in the name of a column that names landmarks, if the table is the log of a robot."""


def joined_and_single_words(name: str) -> set[str]:
    """Return the words of a column's name, and all of them joined to one."""
    words = words_of(name)
    return {*words, "".join(words)}


def role_of(name: str) -> Literal["quality", "sensor", "place", "target", ""]:
    """Return what a column names in each row, by the words of its own name; empty if unknown.

    It names the quality of the row, its sensor, a place such as a landmark, or its target.
    """
    # The words without and with their digits, and all words joined.
    words = {word.rstrip("0123456789") for word in words_of(name)} | joined_and_single_words(name)
    if words & QUALITY_WORDS:
        return "quality"
    if words & PLACES:
        return "place"
    if words & _SENSORS:
        return "sensor"
    if words & _TARGETS:
        return "target"
    return ""


def names_object(name: str) -> bool:
    """Test whether the column of this name, such as MMSI, names what moves in each row."""
    plain = re.sub("[^a-z0-9]", "", name.lower())
    return plain in _OBJECTS
