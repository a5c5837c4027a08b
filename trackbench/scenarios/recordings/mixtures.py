"""Columns whose words split the rows of one run: several targets or several sensors in one table."""

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Literal

import numpy as np

from trackbench.core.arrays import Array, Index, Mask
from trackbench.scenarios.recordings.column_names import words_of
from trackbench.scenarios.recordings.csv_lines import is_value

Split = Literal["apart", "errors", "one", "unknown"]
"""Parts are apart, have errors of different sizes, agree as one, or cannot be compared."""

_MOST_WORDS = 50
"""of a column whose name says nothing"""
_MOST_PARTS = 12
"""that are compared, the largest"""
_MOST_ROWS = 20_000
_MOST_NUMBERS = 12
"""values of a column of numbers that may name targets though its own name does not say so"""
_FEWEST = 8
"""rows of a part that can be compared with another part"""
_APART = 4.0
"""distance between parts, in distances of a row from the line between its neighbors of the same part"""
_ERRORS = 3.0
"""ratio of the sizes of two parts' errors"""
_JUMP = 20.0
"""jump from one part to the next, in usual steps"""
_LONGEST_GAP = 2.5
"""usual intervals between two rows of a part within which the other part's rows are compared"""


def _word_set(text: str) -> frozenset[str]:
    return frozenset(text.split())


_QUALITY = _word_set(
    "fix fixtype quality qual q status state mode ns nsat nsats sats satellites numsat hdop pdop vdop "
    "gdop valid validity flag flags solution sol soltype accuracy acc battery health error class level "
    "confidence conf snr rssi amplitude gear switch armed"
)
"""Words in the names of columns that say how good a row is, not whose it is."""
_SENSORS = _word_set(
    "sensor source src provider device radar station receiver tracker camera lidar antenna instrument "
    "quelle fuente fonte bron kilde capteur sensore geber"
)
_PLACES = _word_set(
    "anchor beacon landmark landmarks marker tower reflector fiducial aruco apriltag"
)
"""Words for things at places of their own."""
_TARGETS = _word_set(
    "mmsi icao icao24 hex callsign flight tail vessel ship boat vehicle car truck bus drone uav "
    "aircraft plane robot object target track trackid objectid person player animal bird "
    "individual agent tag pedestrian bike rider runner schiff boot fahrzeug flugzeug navire bateau "
    "avion buque barco nave skib schip vliegtuig"
)


LANDMARK_WORDS = _word_set(
    "tag tagid id marker markerid feature featureid lm code signature subject target object"
)
"""Words in the name of a column that names landmarks, if the table is the log of a robot."""


def joined_and_single_words(name: str) -> set[str]:
    """Return the words of a column's name, and all of them joined to one."""
    words = words_of(name)
    return {*words, "".join(words)}


def role_of(name: str) -> Literal["quality", "sensor", "place", "target", ""]:
    """Return what the words of a column's name say that it names; empty if they say nothing."""
    # The words without and with their digits, and all words as one.
    words = {word.rstrip("0123456789") for word in words_of(name)} | joined_and_single_words(name)
    if words & _QUALITY:
        return "quality"
    if words & _PLACES:
        return "place"
    if words & _SENSORS:
        return "sensor"
    if words & _TARGETS:
        return "target"
    return ""


def may_split(name: str, cells: Sequence[str]) -> bool:
    """Test whether a column may name the target or sensor of each row, by its name and first cells.

    The cells must be words that are repeated, and no measured numbers. Rows may be sorted by target, so
    that all of these cells are one word: then the name of the column must say that it names targets.
    """
    words = {cell for cell in cells if cell}
    role = role_of(name)
    if role == "quality" or _has_decimals(words):
        return False
    if role:
        return 0 < len(words) < len(cells)
    if not 2 <= len(words) <= _MOST_WORDS or len(cells) < 2 * len(words):
        return False
    # Many different numbers are rather measured ones.
    return len(words) <= _MOST_NUMBERS or not all(map(is_value, words))


def _has_decimals(words: Collection[str]) -> bool:
    """Test whether a word is a number with decimals, such as 0.5 or 1,5e3."""
    return any(re.fullmatch(r"[-+]?\d*[.,]\d+([eE][-+]?\d+)?", word) for word in words)


def is_word_column(cells: Sequence[str]) -> bool:
    """Test whether the cells of a column are a few repeated words, which are no measured numbers."""
    words = {cell for cell in cells if cell}
    filled = sum(cell != "" for cell in cells)
    return not _has_decimals(words) and 0 < len(words) <= _MOST_WORDS and filled >= 2 * len(words)


def split_by(codes: Index, time: Array, values: Array) -> Split:
    """Compare the parts into which codes (R,) split the rows of one run, as `Split` names the results.

    ``time`` (R,) and ``values`` (n, R) are those of the rows, which need not be sorted by time.
    """
    complete_rows = np.flatnonzero(np.isfinite(values).all(axis=0))[:_MOST_ROWS]
    order = complete_rows[np.argsort(time[complete_rows], kind="stable")]
    time = time[order]
    values = values[:, order]
    codes = codes[order]
    all_codes, counts = np.unique(codes, return_counts=True)
    largest = all_codes[np.argsort(-counts, kind="stable")][:_MOST_PARTS]
    parts = [np.flatnonzero(codes == code) for code in largest.tolist()]
    parts = [part for part in parts if len(part) >= 3]
    if len(parts) < 2:
        return "unknown"
    # Step 1: each part's own size of errors, from the lines between neighbors.
    sizes = [_own_errors(time[part], values[:, part]) for part in parts]
    compared = apart = unequal = 0
    # Step 2: rows of one part beside the line between neighboring rows of another part.
    for i, first in enumerate(parts):
        for j, other in enumerate(parts):
            if i == j:
                continue
            away = _distances_from_line(time, values, first, other)
            if away.shape[1] < min(_FEWEST, len(other) - 1):
                continue  # too few rows of the other part lie between rows of the first
            compared += 1
            middle = np.median(away, axis=1)
            noise = np.maximum(sizes[i], sizes[j])
            apart += bool((middle > _APART * noise).any())
            # The other part is less accurate than the first one: its rows are far from the line of the
            # first, and from the lines between its own rows.
            larger = (middle > _ERRORS * sizes[i]) & (sizes[j] > _ERRORS * sizes[i])
            unequal += bool(larger.any())
    if compared:
        if 2 * apart > compared:
            return "apart"
        if unequal:
            return "errors"
        return "one"
    # Step 3: parts one after the other: a jump wherever one part follows the other.
    if _jumps(time, values, codes):
        return "apart"
    return "unknown"


def is_regular(codes: Index, time: Array) -> bool:
    """Test whether the parts alternate in time, each at nearly equal intervals.

    Rows of several sensors do so; rows of good and bad quality do not. ``codes`` (R,) number the parts.
    """
    order = np.argsort(time, kind="stable")
    codes = codes[order]
    time = time[order]
    counts = np.unique(codes, return_counts=True)[1]
    changes = int((np.diff(codes) != 0).sum())
    # Two parts that alternate row by row change twice per row of the rarer one; 1.2 times is enough.
    fewest_changes = 1.2 * (len(codes) - counts.max())
    if changes < fewest_changes:
        return False
    # Seven of ten intervals of each part are within 20 % of the usual one.
    for code in np.unique(codes).tolist():
        apart = np.diff(time[codes == code])
        if (
            len(apart) < 2
            or (np.abs(apart - np.median(apart)) <= 0.2 * np.median(apart)).mean() < 0.7
        ):
            return False
    return True


def _own_errors(time: Array, values: Array) -> Array:
    """Return the size (n,) of the errors of each of the ``values`` (n, R) of a part's rows.

    It is the median distance of a row from the line between its neighbors, scaled to the standard
    deviation of one row.
    """
    share, _ = _shares(time[1:-1], time[:-2], time[2:])
    off = values[:, 1:-1] - (1.0 - share) * values[:, :-2] - share * values[:, 2:]
    # e = z_1 - (1 - s) z_0 - s z_2 has the variance sigma^2 (1 + s^2 + (1 - s)^2).
    sizes = np.abs(off) / np.sqrt(1.0 + np.square(share) + np.square(1.0 - share))
    # Numbers that lie exactly on a line still have rounding errors.
    least = 1e-9 * np.abs(values).max() + 1e-12
    return np.maximum(np.median(sizes, axis=1), least)


def _distances_from_line(time: Array, values: Array, first: Index, other: Index) -> Array:
    """Compute distances (n, B) of another part's rows from the line between neighboring rows of a part.

    ``time`` (R,) and ``values`` (n, R) are those of all rows.
    ``first`` and ``other`` are the indices of both parts' rows. Only neighbors count that are at most
    `_LONGEST_GAP` usual intervals apart, so that the path hardly bends between them. The usual interval
    is the larger one of both parts' medians.
    """
    first_times = time[first]
    after = np.searchsorted(first_times, time[other], side="left")
    has_both_neighbors = (after > 0) & (after < len(first_times))
    rows = other[has_both_neighbors]
    after = after[has_both_neighbors]
    before = after - 1
    first_interval = float(np.median(np.diff(first_times)))
    usual_interval = max(first_interval, float(np.median(np.diff(time[other]))))
    share, interval = _shares(time[rows], first_times[before], first_times[after])
    line = (1.0 - share) * values[:, first[before]] + share * values[:, first[after]]
    is_short = interval <= _LONGEST_GAP * usual_interval
    return np.asarray(np.abs(values[:, rows] - line)[:, is_short])


def _shares(time: Array, before: Array, after: Array) -> tuple[Array, Array]:
    """Return the share of each interval that has passed at a time, and the length of each interval.

    The intervals last from ``before`` to ``after``. The share of an interval of length zero is a half.
    """
    length = after - before
    share = (time - before) / np.where(length > 0.0, length, 1.0)
    return np.where(length > 0.0, share, 0.5), length


def _jumps(time: Array, values: Array, codes: Index) -> bool:
    """Test whether the values (n, R) jump at more than half of the changes from one part to another.

    ``codes`` (R,) number each row's part. A jump exceeds `_JUMP` usual steps within a part, and its
    rows are at most five usual intervals apart, as a long gap explains a large step.
    """
    steps = np.abs(np.diff(values, axis=1))
    intervals = np.diff(time)
    is_change: Mask = np.diff(codes) != 0
    usual_step = np.zeros(len(values))
    if (~is_change).any():
        usual_step = np.median(steps[:, ~is_change], axis=1)
    is_short = intervals <= 5.0 * np.median(intervals)
    is_large = (steps > _JUMP * np.maximum(usual_step, 1e-9)[:, None]).any(axis=0)
    is_jump = is_large & is_change & is_short
    return bool(is_jump.sum() > 0.5 * is_change.sum())


def as_positions(values: Mapping[str, Array]) -> Array:
    """Return quantities (R,) by name as rows (n, R) without jumps: angles as points of a circle."""
    rows = []
    # Angles are points at the measured range, or of the unit circle.
    radius: Array | float = 1.0
    ranges = [value for name, value in values.items() if name.endswith("range")]
    if ranges:
        radius = ranges[0]
    for name, value in values.items():
        plain = name.rpartition(".")[2]
        if plain in ("azimuth", "bearing", "heading", "course", "angle"):
            rows += [radius * np.cos(value), radius * np.sin(value)]
        elif np.isfinite(value).any():
            rows.append(value)
    if not rows:
        return np.empty((0, 0))
    return np.stack(rows)
