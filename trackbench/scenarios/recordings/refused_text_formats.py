"""Text files that are no tables, such as GPX and JSON, and the advice on each."""

import re

from trackbench.field_types import DataError, Place

_OTHERS = {
    "<": "XML (GPX, KML): convert it, `gpsbabel -i gpx -f FILE -o unicsv -F m.csv`",
    r"\{": "JSON: write its records as a table with a line of names",
    r"\$G": "NMEA: convert it, `gpsbabel -i nmea -f FILE -o unicsv -F m.csv`",
    "!AI": "NMEA sentences of AIS: decode them into a table with a line of names",
    r"[A-Z]{2}\d{6},[^,]*,\s*\d+,?\s*$": "HURDAT2, in which a line names the storm of the rows "
    "below it: write a table with the storm in a column `run` (docs/your-data.md has a command)",
}
"""Patterns of the first lines of files that are text, but no tables, and what to do."""
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
