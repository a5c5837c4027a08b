"""Names of columns with ranges to several places, such as d1 and dist_north."""

import re
from collections.abc import Iterable, Sequence

from trackbench.scenarios.recordings.label_column_names import NO_LABELS, PLACES, QUALITY_WORDS
from trackbench.scenarios.recordings.recognize_column_names import (
    WORDS_OF_QUANTITIES,
    NamedColumn,
    words_of,
    words_without_units,
)
from trackbench.scenarios.recordings.unit_names_and_sizes import (
    OTHER_UNITS,
    UNIT_WORDS,
    is_unit_of,
    unit_in,
)

_RANGE_TO = re.compile(
    r"(?:range|dist|distance|rng|d|r|toa|tof|uwb)(?:to|from)?([a-z]{0,2}\d+)|((?:a|anchor|beacon)\d+)"
)
_RANGE_WORDS = frozenset(("range", "ranges", "rng", "dist", "distance", "d", "r"))
"""Words of which names of ranges to places that have no numbers must have one, as range_A has."""
_WORDS_BESIDE_LABELS = frozenset(("to", "from", "of", "slant", "meas", "measured", "raw", "uwb"))
"""Further words that names of ranges to several places may have in common."""
_COMPASS = frozenset(("north", "east", "south", "west"))
"""Words that are axes elsewhere, and names of places where there are at least three."""
_FEWEST_LABELED = 3
"""ranges to places that have no numbers; two columns may differ for another reason"""


def ranges_of(names: Iterable[str]) -> dict[str, NamedColumn]:
    """Return the columns of ranges to several places, such as d1 and range_A2 [m], by the place: 1, a2.

    Places without a number, as those of range_A, range_B and range_C, must be at least three. There are
    no ranges if only one column looks like one.
    """
    names = list(names)
    ranges = {}
    for name in names:
        words = words_of(name)
        match = _RANGE_TO.fullmatch("".join(words_without_units(words)))
        if match:
            place = match[1] or match[2]
            ranges[place] = NamedColumn(column=name, unit=unit_in(words, "range"))
    if len(ranges) < 2:
        return _labeled_ranges_of(names)
    return ranges


def _labeled_ranges_of(names: Iterable[str]) -> dict[str, NamedColumn]:
    """Return the columns of ranges to places without numbers, such as dist_north [m], by the place.

    The words of their names are equal but for one, which is the place. There are no ranges if fewer
    than three columns look like that, or if one of the words is a statistic, an axis or a unit.
    """
    # Step 1: group the columns whose names differ in the word at one position.
    groups: dict[tuple[str, ...], dict[str, str]] = {}
    for name in names:
        words = words_of(name)
        for position, label in enumerate(words):
            others = (*words[:position], "", *words[position + 1 :])
            groups.setdefault(others, {}).setdefault(label, name)
    # Step 2: take the largest group of ranges.
    ranges: dict[str, NamedColumn] = {}
    for others, column_by_label in groups.items():
        common = [word for word in others if word]
        if len(column_by_label) < _FEWEST_LABELED or len(column_by_label) <= len(ranges):
            continue
        if not _are_ranges_to_places(common, list(column_by_label)):
            continue
        unit = unit_in(common, "range")
        ranges = {
            label: NamedColumn(column=column, unit=unit)
            for label, column in column_by_label.items()
        }
    return ranges


def _are_ranges_to_places(common: Sequence[str], labels: Sequence[str]) -> bool:
    """Test whether columns are ranges to places by the words ``common`` to their names, and by labels.

    ``labels`` are the words in which the names differ: north, east and south of r_north, r_east and
    r_south. Letters a, b, c, ... may be labels though some of them are units or axes, and then the names
    may have a word such as anchor in place of one such as range.
    """
    is_series = list(labels) == [chr(ord("a") + number) for number in range(len(labels))]
    words_of_ranges = _RANGE_WORDS | PLACES if is_series else _RANGE_WORDS
    if words_of_ranges.isdisjoint(common):
        return False
    allowed = _RANGE_WORDS | PLACES | _WORDS_BESIDE_LABELS | OTHER_UNITS
    for word in common:
        if word not in allowed and not is_unit_of("range", UNIT_WORDS.get(word, "")):
            return False
    if is_series:
        return True
    # A d or an r alone may be a difference or a ratio, unless all labels are sides of the compass.
    has_one_letter = all(len(word) == 1 for word in _RANGE_WORDS.intersection(common))
    if has_one_letter and not {*labels} <= _COMPASS:
        return False
    # Words of other meanings name no place. North and east are axes elsewhere, but places here.
    no_places = NO_LABELS | QUALITY_WORDS | OTHER_UNITS | UNIT_WORDS.keys()
    for text in WORDS_OF_QUANTITIES.values():
        no_places |= {*text.split()}
    no_places -= _COMPASS
    return all(re.fullmatch("[a-z]+", label) and label not in no_places for label in labels)
