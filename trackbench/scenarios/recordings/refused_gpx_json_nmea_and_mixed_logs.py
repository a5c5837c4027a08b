"""Text files that are no tables, such as GPX, JSON, NMEA and mixed logs, and the advice on each."""

import re
from collections.abc import Mapping

from trackbench.field_types import DataError, Place

_OTHERS = {
    r"(?i)<(!doctype )?html\b": "HTML, a page of the web: download the table itself",
    "<": "XML (GPX, KML): convert it, `gpsbabel -i gpx -f FILE -o unicsv -F m.csv`",
    r"\{|\[\s*([{\[]|$)": "JSON: write its records as a table with a line of names",
    r"[A-Z]{2}\d{6},[^,]*,\s*\d+,?\s*$": "HURDAT2, in which a line names the storm of the rows "
    "below it: write a table with the storm in a column `run` (docs/your-data.md has a command)",
}
"""Patterns of the first lines of files that are text, but no tables, and what to do."""
_TAG_BLOCK = r"\\[^\\]{1,200}\\"  # \s:rx1,c:1700000000*01\
_TIME = r"[\[(]?\d[\dTZ\s:./+-]{0,60}(?:,\d{3})?[\])]?[\s,;|:\"]{0,9}"
_SENTENCE = r"[$!](?P<talker>[A-Z]{2})(?P<type>[A-Z]{3}),.*\d|[$]P[A-Z0-9]{3,},.*\d"
_NMEA = re.compile(rf"(?P<before>(?:{_TIME})?(?:{_TAG_BLOCK})?)(?P<sentence>{_SENTENCE})")
"""Sentence of NMEA 0183, also a maker's own (P), perhaps behind a tag block or the time of its receipt.
The name of a column may begin so, but a line of names hardly has digits. Repetitions are bounded, so
that a long line of numbers takes no time."""
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


def _explain_sentence(match: re.Match[str]) -> str:
    """Return words for a sentence of NMEA, a match of `_NMEA`, and the way to a table."""
    talker = match["talker"] or ""
    has_prefix = match["before"] != ""
    if talker.startswith("G") or match["type"] in _POSITIONS:
        if has_prefix:
            # gpsbabel skips lines that begin otherwise than with $, and reads nothing.
            way = "`sed 's/^[^$]*//' FILE | gpsbabel -i nmea -f - -o unicsv -F m.csv`"
            return (
                f"NMEA behind other text ({match['before'].strip()}): convert the sentences, {way}"
            )
        return "NMEA: convert it, `gpsbabel -i nmea -f FILE -o unicsv -F m.csv`"
    sentence = match["sentence"]
    way = "into a table with a line of names"
    if has_prefix:
        way += ", and the time before each sentence"
        # The c of a tag block is a UNIX time by the standard (NMEA 0183).
        way += " (`c:`, a UNIX time)" if re.search(r"[\\,]c:\d", match["before"]) else ""
        way += " into its column `time`"
    if sentence.startswith("!"):
        return f"NMEA sentences of AIS: decode them {way}"
    name = sentence.partition(",")[0]
    return f"NMEA sentences ({name}): write their fields {way}"


def check_kinds_of_rows(path: str, cells: Mapping[int, list[str]], separator: str) -> None:
    """Raise DataError for a file with rows of several kinds, such as those of an IMU and of GPS.

    Each row then begins with a word for its kind, and all rows of one kind have the same number of
    cells. ``cells`` are those of the first lines, by line number, and ``separator`` stands between two
    cells.
    """
    # Widths of the rows by their first word.
    kinds: dict[str, set[int]] = {}
    for row in cells.values():
        first_word = row[0].strip() if row else ""
        kinds.setdefault(first_word, set()).add(len(row))
    all_widths = set().union(*kinds.values())
    is_word = all(re.fullmatch("[A-Za-z$][A-Za-z0-9_]*", kind) for kind in kinds)
    is_exact = all(len(widths) == 1 for widths in kinds.values())
    has_many = len(cells) >= 3 * len(kinds)  # at least three lines of each kind on average
    if len(all_widths) > 1 and len(kinds) > 1 and is_word and is_exact and has_many:
        shown = ", ".join(f"{kind} ({widths.pop()} cells)" for kind, widths in kinds.items())
        first = next(iter(kinds))
        # The advice is a command that selects the rows of one kind; white space needs a class of grep.
        marks = {" ": "[[:space:]]", "\t": "[[:space:]]"}
        remedy = f"split the file, such as `grep '^{first}{marks.get(separator, separator)}'`"
        message = f"has rows of {len(kinds)} kinds: {shown[:100]}: {remedy}, and name the columns"
        raise DataError(Place(path, next(iter(cells)), 1, message))
