"""Lines of a CSV file as cells: its separator, comment lines, encoding, and quotes that do not close."""

import codecs
import csv
import re
from collections.abc import Iterator
from itertools import chain
from typing import TextIO

from trackbench.field_types import DataError, Place, require_regular_file

_LONGEST_LINE = 1_000_000  # characters: a file without line breaks is not read into memory
_MOST_COMMENTS = 10_000  # lines
_SEPARATORS = ",;\t|"
_NUMBER = re.compile(r"[-+]?[0-9.,]+([eE][-+]?[0-9]+)?")
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f]")


def _latin_1(error: UnicodeError) -> tuple[str, int]:
    """Read bytes that are not UTF-8 as Latin-1."""
    if not isinstance(error, UnicodeDecodeError):
        raise error
    return error.object[error.start : error.end].decode("latin-1"), error.end


codecs.register_error("trackbench.latin-1", _latin_1)


def table_lines(path: str) -> Iterator[tuple[int, list[str], str]]:
    """Yield line number, cells and separator of every line that is not blank, first the header.

    Lines of comment (#) before the header are left out, unless the last of them is the header.
    """
    try:
        file = require_regular_file(path)
        with file.open("rb") as head:
            of_16_bits = head.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        encoding = "utf-16" if of_16_bits else "utf-8-sig"
        with file.open(newline="", encoding=encoding, errors="trackbench.latin-1") as text:
            yield from _cells(path, text)
    except OSError as error:
        raise DataError(Place(path, 1, 1, (error.strerror or str(error)).lower())) from None
    except UnicodeError:
        raise DataError(Place(path, 1, 1, "is not a text file")) from None


def _cells(path: str, text: TextIO) -> Iterator[tuple[int, list[str], str]]:
    lines = iter(lambda: text.readline(_LONGEST_LINE), "")
    # Step 1: pass over comments to the first line of cells.
    skipped, separator, first, comment = -1, "", "", ""
    for skipped, first in enumerate(lines):
        if first.lower().startswith("sep=") and len(first) > len("sep="):
            separator = first[len("sep=")]
        elif first.startswith("#") and skipped < _MOST_COMMENTS:
            comment = first.lstrip("# ")
        elif first.strip():
            break
    else:
        return
    if _CONTROL.search(first):
        raise DataError(Place(path, skipped + 1, 1, "is not a text file"))
    # Step 2: the last comment is the header of a first line that holds numbers.
    separator = separator or _separator(first)
    before, cells = [_parsed(line, separator) for line in (comment, first)]
    numbers = any(_NUMBER.fullmatch(cell.strip()) for cell in cells)
    if numbers and len(before) == len(cells):
        yield skipped, before, separator
    # Step 3: read the lines.
    following: Iterator[str] = chain([first], lines)
    if separator == " ":
        following = (" ".join(line.split()) + "\n" for line in following)
    reader = csv.reader(following, delimiter=separator)
    line, width = skipped, len(cells)
    try:
        for row in reader:
            end = skipped + reader.line_num
            if end > line + 1 and _holds_rows(row, separator, width):
                what = f"a quote that opens in this line closes in line {end}, after further rows"
                raise DataError(Place(path, line + 1, 1, f"{what}: close it, or leave it out"))
            line = end
            if row:
                yield line, row, separator
    except csv.Error as error:
        what = f"not a CSV: {error}; is a quote in this line not closed?"
        raise DataError(Place(path, line + 1, 1, what)) from None


def _separator(line: str) -> str:
    """Return what separates the cells of a line, outside quotes: mostly a comma; else white space."""
    bare = re.sub('"[^"]*"', "", line.strip())
    most = max(_SEPARATORS, key=bare.count)
    return most if most in bare else " "


def _parsed(line: str, separator: str) -> list[str]:
    """Return the cells of one line."""
    if separator == " ":
        return line.split()
    return next(csv.reader([line], delimiter=separator), [])


def _holds_rows(cells: list[str], separator: str, width: int) -> bool:
    """Return whether a line inside a cell of several lines has as many cells as a row."""
    inner = separator.join(cells).splitlines()[1:]
    return any(line.count(separator) >= width - 1 for line in inner)
