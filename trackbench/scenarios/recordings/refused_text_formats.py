"""Text files that are no tables, such as GPX and JSON, and the advice on each."""

import re

from trackbench.field_types import DataError, Place

_OTHERS = {
    "<": "XML (GPX, KML): convert it, `gpsbabel -i gpx -f FILE -o unicsv -F m.csv`",
    "{": "JSON: write its records as a table with a line of names",
    "$G": "NMEA: convert it, `gpsbabel -i nmea -f FILE -o unicsv -F m.csv`",
    "!AI": "NMEA sentences of AIS: decode them into a table with a line of names",
}
"""First letters of files that are text, but no tables, and what to do."""
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
    for letters, message in _OTHERS.items():
        if line.startswith(letters):
            raise DataError(Place(path, number, 1, f"is no table but {message}"))
