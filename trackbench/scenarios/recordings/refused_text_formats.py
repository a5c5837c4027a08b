"""Text files that are no tables, such as GPX and JSON, and the advice on each."""

import re

from trackbench.field_types import DataError, Place

_OTHERS = {
    "<": "XML (GPX, KML): convert it, `gpsbabel -i gpx -f FILE -o unicsv -F m.csv`",
    r"\{": "JSON: write its records as a table with a line of names",
    r"[A-Z]{2}\d{6},[^,]*,\s*\d+,?\s*$": "HURDAT2, in which a line names the storm of the rows "
    "below it: write a table with the storm in a column `run` (docs/your-data.md has a command)",
}
"""Patterns of the first lines of files that are text, but no tables, and what to do."""
_NMEA = re.compile(r"[$!](?P<talker>[A-Z]{2})(?P<type>[A-Z]{3}),.*\d|[$]P[A-Z0-9]{3,},.*\d")
"""Sentence of NMEA 0183, also a maker's own (P). The name of a column may begin so, but a line of names
hardly has digits."""
_POSITIONS = ("RMC", "GGA", "GLL")
"""types of sentences from which gpsbabel reads positions"""
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f]")
_ARCHIVES = (".gz", ".zip", ".bz2", ".xz")


def explain_no_text(path: str) -> str:
    """Return the message on a file that is no text: it may be compressed."""
    if path.endswith(_ARCHIVES):
        return "is compressed: unpack it first"
    return "is not a text file"


def check_first_line(path: str, number: int, line: str) -> None:
    """Raise DataError if the first ``line`` of a file, with this ``number``, is that of no table."""
    if _CONTROL.search(line):
        raise DataError(Place(path, number, 1, explain_no_text(path)))
    for pattern, message in _OTHERS.items():
        if re.match(pattern, line):
            raise DataError(Place(path, number, 1, f"is no table but {message}"))
    sentence = _NMEA.match(line)
    if sentence is not None:
        message = f"is no table but {_explain_sentence(sentence)}"
        raise DataError(Place(path, number, 1, message))


def _explain_sentence(sentence: re.Match[str]) -> str:
    """Return words for a sentence of NMEA, a match of `_NMEA`, and the way to a table."""
    talker = sentence["talker"] or ""
    if talker.startswith("G") or sentence["type"] in _POSITIONS:
        return "NMEA: convert it, `gpsbabel -i nmea -f FILE -o unicsv -F m.csv`"
    if sentence[0].startswith("!"):
        return "NMEA sentences of AIS: decode them into a table with a line of names"
    name = sentence[0].partition(",")[0]
    return f"NMEA sentences ({name}): write their fields into a table with a line of names"
