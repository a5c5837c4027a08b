"""Columns that name several targets or sensors: which ones split the rows, and questions on them."""

import re
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import first_names
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.compare_courses_with_movement import are_courses
from trackbench.scenarios.recordings.compare_parts_of_rows import (
    MOST_COMPARED_ROWS,
    Split,
    are_far,
    as_positions,
    is_regular,
    split_by,
)
from trackbench.scenarios.recordings.header_line import is_value
from trackbench.scenarios.recordings.label_column_names import role_of
from trackbench.scenarios.recordings.parse_numbers import number, parse_cells
from trackbench.scenarios.recordings.parse_tables import Table, WholeNumbers
from trackbench.scenarios.recordings.quantities_from_columns import Columns
from trackbench.scenarios.recordings.recognize_column_names import columns_of, words_of
from trackbench.scenarios.recordings.rows_and_reading_context import ReadingContext, Rows
from trackbench.scenarios.recordings.yaml_values import in_option

_MOST_WORDS = 50
"""different words of a column that may split rows though its name does not say so"""
_MOST_NUMBERS = 12
"""values of a column of numbers that may name targets though its own name does not say so"""
_MOST_WORDS_SHOWN = 8
REASON_FOR_LABELS = "guess: rows of one of its words agree with each other"
"""Comment in the config beside a column that was taken to name runs or sensors."""
_TRACKS = frozenset(("track", "trk", "tracks"))
"""words in the name of a column that names targets, or holds their courses"""


class MixedRowsError(DataError):
    """Rows of several targets or sensors, which a column names, would be those of one."""

    def __init__(self, place: Place, column: str, role: str, split: Split) -> None:
        """Begin with the message and its ``place``, and the ``column`` that splits the rows.

        ``role`` is what the column's name says that it names, as `role_of` returns it: "quality",
        "sensor", "place", "target", or empty. ``split`` is how the parts of the rows differ (`Split`).
        """
        super().__init__(place)
        self.column = column
        self.role = role
        self.split = split


def possible_labels(columns: Columns, of_time: Collection[str]) -> list[str]:
    """Return the unused columns that may name the target or the sensor of each row.

    They are selected in ``columns``, in place, so that their words are read with the table. The columns
    ``of_time``, which are parts of a time, are left out.
    """
    labels = []
    quantities = columns_of(columns.names)
    measured = {c.column for name, c in quantities.items() if name not in ("run", "sensor")}
    for name, cells in columns.first_cells.items():
        # A column with the name of a quantity is measured, unless it may also name targets, as a track.
        is_measured = name in of_time or (name in measured and not role_of(name))
        if not is_measured and may_split(name, cells) and columns.take_words(name):
            labels.append(name)
    return labels


def may_split(name: str, cells: Sequence[str]) -> bool:
    """Test whether a column may name the target or sensor of each row, by its name and first cells.

    The cells must be words that are repeated, and no measured numbers. A single word is enough: rows may
    be sorted by target, or the second target may come after the first cells.
    """
    words = {cell for cell in cells if cell}
    if _has_decimals(words):
        return False
    # In a column that is called after targets, sensors or places it is enough that one word is repeated.
    # One that is called after the quality of a row, such as status, is like any other column.
    if role_of(name) not in ("", "quality"):
        return 0 < len(words) < len(cells)
    return 0 < len(words) <= _MOST_WORDS and len(cells) >= 2 * len(words)


def check_label(
    columns: Columns,
    table: Table,
    label: str,
    quantities: Mapping[str, Array],
    runs: WholeNumbers,
    time: Array,
    of_sensor: WholeNumbers | slice,
) -> str:
    """Raise MixedRowsError if a column seems to name several targets or sensors of one sensor's rows.

    The rows of the longest run are split by the words of the column ``label``. If the column's name
    says that it names targets or sensors, this is an error unless the parts agree as one. For any other
    column the parts must clearly differ. If the config says by an empty name, as in ``run: ""``, that
    the rows are mixed, it is no error: return a note if the parts lie apart, and else an empty text.

    ``quantities`` are the measured quantities (R,) by name of the sensor's R rows, ``runs`` (R,) the
    numbers of their runs, and ``time`` (R,) their times. ``of_sensor`` are the indices of these rows in
    the table. Raises DataError if rows without a word may be those of another target.
    """
    # Step 1: select the rows of the longest run that have a word.
    codes = table.columns[label][of_sensor]
    words = table.words[label]
    if not len(runs):
        return ""
    # In the header of a ROS message this is the frame of a camera, beside the names of what it sees.
    is_frame = label.replace("_", "").lower().endswith("frameid")
    if is_frame and columns.column("sensor") is not None:
        return ""
    empty = words.index("") if "" in words else -1  # code of empty cells; none has -1
    is_longest = runs == np.bincount(runs).argmax()
    rows = np.flatnonzero(is_longest & (codes != empty))
    found, counts = np.unique(codes[rows], return_counts=True)
    # Beside a single name empty cells may be those of another target.
    is_one_unnamed = len(found) == 1 and empty != -1
    if is_one_unnamed:
        rows = np.flatnonzero(is_longest)
        found, counts = np.unique(codes[rows], return_counts=True)
    values = as_positions({name: values[rows] for name, values in quantities.items()})
    # At least two words, with two rows each on average, of which two have several rows.
    is_repeated = len(found) >= 2 and len(rows) >= 2 * len(found) and (counts > 1).sum() > 1
    if not (is_repeated and len(values)):
        return ""
    # A track in whole degrees is a course, and names nothing.
    some = slice(0, MOST_COMPARED_ROWS)
    cells = [words[code] for code in codes[rows[some]].tolist()]
    if _is_track_angle(label, cells, time[rows[some]], values[:, some]):
        return ""
    # Step 2: decide whether the parts are several targets or sensors. The role is "target", "sensor",
    # "place" or "quality", or empty if the column's name does not show it.
    role = role_of(label)
    # The split is "apart", "errors" (of different sizes), "one" or "unknown".
    split = split_by(codes[rows], time[rows], values)
    # Parts that differ by the size of their errors alone are sensors only if they take turns.
    is_mixed = split == "apart" or (split == "errors" and is_regular(codes[rows], time[rows]))
    if role and not is_one_unnamed:
        is_mixed = split != "one"
    # Words for a quality, and empty cells, name targets only if these are far apart and take turns.
    # More than _MOST_NUMBERS different numbers may be measured ones, and name targets only if these take
    # turns. More than _MOST_WORDS different words of any kind name none, as Step 2 ends with.
    all_words = [words[code] for code in found.tolist()]
    are_many_numbers = not role and len(found) > _MOST_NUMBERS and all(map(is_value, all_words))
    if role == "quality" or is_one_unnamed or are_many_numbers:
        is_mixed = split == "apart" and is_regular(codes[rows], time[rows])
    if is_mixed and (role == "quality" or is_one_unnamed):
        is_mixed = are_far(codes[rows], time[rows], values)
    # The column was selected by its first cells (`may_split`). Further down it may have more words, or
    # numbers with decimals, which are measured ones.
    if not role and (len(found) > _MOST_WORDS or _has_decimals(all_words)):
        is_mixed = False
    if not is_mixed:
        return ""
    # Step 3: report it, with the keys that say what the column names.
    shown = first_names(all_words, _MOST_WORDS_SHOWN)
    values_of_label = f"column {label} has {len(found)} values ({shown})"
    mixing_key = _key_that_mixes(columns)
    if mixing_key and split != "apart":
        return ""
    if mixing_key:
        answer = f'`columns: {{{mixing_key}: ""}}`'
        return f"{values_of_label}, whose rows lie apart; they are mixed, as {answer} says"
    message = f"{values_of_label}, which would be one run and sensor"
    if split in ("apart", "errors"):
        message += "; the rows of each agree with themselves better than with the others"
    if is_one_unnamed:
        name = next(words[code] for code in found.tolist() if code != empty)
        message = f"{name} is the only name, and rows without one lie far from its rows:"
        message += " are they of another target?"
        remedy = f"Give it a name in {label}, or say --set 'columns.run=\"\"' to mix the rows"
        raise DataError(Place(columns.path, 1, 1, f"column {label}: {message} {remedy}"))
    remedy = f"say `columns: {{run: {label}}}` for a run each, `columns: {{sensor: {label}}}` for"
    mix = "run" if columns.column("run") is None else "sensor"
    remedy += f' a sensor each, or `columns: {{{mix}: ""}}` to mix them'
    # The config may have a key for this file alone, such as truth_naming; that of measurements has none.
    if columns.own_key:
        # A truth or inputs in a file of their own are those of one target.
        remedy = "leave in it the rows of the one that was measured, or say"
        remedy += f" `{columns.own_key}: {{columns: {{run: {label}}}}}` for a run each"
    raise MixedRowsError(Place(columns.path, 1, 1, f"{message}: {remedy}"), label, role, split)


def _key_that_mixes(columns: Columns) -> str:
    """Return "run" or "sensor", whichever the config sets to an empty name; empty if it sets neither.

    Such a name says that all rows are of one run or sensor, whatever words they have.
    """
    named = columns.naming.columns
    return next((key for key in ("run", "sensor") if named.get(key) == ""), "")


def _is_track_angle(label: str, cells: Sequence[str], time: Array, positions: Array) -> bool:
    """Test whether a column that is called a track holds the courses of its rows, in degrees.

    The column ``label`` has the ``cells`` of R rows with ``time`` (R,) and ``positions`` (2, R).
    """
    if _TRACKS.isdisjoint(words_of(label)):
        return False
    numbers, mistakes = parse_cells(number, list(cells))
    return not mistakes and are_courses(numbers, time, positions)


def check_label_pairs(
    columns: Columns,
    table: Table,
    labels: Sequence[str],
    quantities: Mapping[str, Array],
    runs: WholeNumbers,
    time: Array,
    of_sensor: WholeNumbers | slice,
) -> None:
    """Raise DataError if two columns together name several targets, as a team and a number do.

    ``labels`` are the columns that may do so; none of them names targets alone. ``quantities`` are the
    measured quantities (R,) by name of one sensor's R rows, ``runs`` (R,) the numbers of their runs, and
    ``time`` (R,) their times. ``of_sensor`` are the indices of these rows in the table.
    """
    # The user's answer that rows are mixed is one to this question, too.
    if not len(runs) or _key_that_mixes(columns):
        return
    # The run with most rows shows it best.
    rows = np.flatnonzero(runs == np.bincount(runs).argmax())
    values = as_positions({name: values[rows] for name, values in quantities.items()})
    # A column of the rows' quality, such as fix or status, is no part of a target's name.
    named = [label for label in labels if role_of(label) != "quality"]
    codes_by_label = {label: table.columns[label][of_sensor][rows] for label in named}
    for pair in combinations(named, 2):
        # Number the pairs of words. There must be more of them than words in either column.
        both = np.stack([codes_by_label[label] for label in pair])
        pairs_of_words, codes = np.unique(both, axis=1, return_inverse=True)
        count = pairs_of_words.shape[1]
        most_words = max(len(np.unique(codes_of_one)) for codes_of_one in both)
        if not most_words < count <= _MOST_WORDS or len(rows) < 2 * count:
            continue
        codes = codes.reshape(-1)
        # The parts must lie apart, and not only differ in the size of their errors (see `Split`). They
        # must take turns at nearly equal intervals, as the detections of several targets do.
        if split_by(codes, time[rows], values) == "apart" and is_regular(codes, time[rows]):
            raise DataError(question_on_pair(columns.path, *pair))


def question_on_pair(path: str, first: str, second: str) -> Place:
    """Return the question on columns ``first`` and ``second``, whose words together split the rows.

    ``path`` is the file.
    """
    message = f"columns {first} and {second} together split the rows into parts that lie apart:"
    message += " do both name the target?"
    remedy = "Join both into one column, and say --set 'columns.run=ITS NAME'; or say"
    remedy += " --set 'columns.run=\"\"' to mix the rows"
    return Place(path, 1, 1, f"{message} {remedy}")


def key_of_labels(error: MixedRowsError) -> str:
    """Return "run" or "sensor", the key of `columns` for a column that splits the rows.

    The ``error`` has this column, its role by its name ("quality", "sensor", "place", "target", or empty
    if unknown), and its split: how the parts of its rows differ. They lie "apart", have "errors" of
    different sizes, agree as "one", or are "unknown" if they cannot be compared. Raises DataError with a
    question if role and split do not decide.
    """
    if error.role == "place":
        return "sensor"
    # Rows of one target whose errors differ in size are those of several sensors.
    if error.split == "errors" or (error.role == "sensor" and error.split == "unknown"):
        return "sensor"
    if error.role not in ("sensor", "quality"):
        return "run"
    # The column's name says sensors or a quality, and the rows say targets.
    raise DataError(question_on_parts(error.places[0].file, error.column, "run"))


def question_on_parts(path: str, label: str, mixed: str) -> Place:
    """Return the question on a column ``label`` whose words split the rows into parts that lie apart.

    ``path`` is the file. ``mixed``, run or sensor, is the key of `columns` that the user sets to nothing
    in order to mix the rows.
    """
    column = in_option(label)
    message = (
        f"column {column} splits the rows into parts that lie apart: are they several targets,"
    )
    message += " or sensors of one with a bias?"
    remedy = f"`--set 'columns.run={column}'`, `--set 'columns.sensor={column}'`, or to mix them"
    return Place(path, 1, 1, f"{message} Say {remedy} `--set 'columns.{mixed}=\"\"'`")


def explain_labels(path: str, label_columns: dict[str, str]) -> list[Place]:
    """Return lines that explain which columns were taken to name runs or sensors, and how to change it.

    ``label_columns`` are these columns by their key, ``run`` or ``sensor``.
    """
    places = []
    for key, column in label_columns.items():
        name = in_option(column)
        other = "sensor" if key == "run" else "run"
        meaning = {"run": "targets", "sensor": "sensors or landmarks"}
        message = f"column {name} was taken to name {meaning[key]}, as its words split the rows"
        remedy = f"if it names {meaning[other]}, say --set 'columns.{other}={name}'"
        none = f"if neither, say --set 'columns.{key}=\"\"'"
        places.append(Place(path, 1, 1, f"{message}: {remedy}; {none}"))
    return places


def is_word_column(cells: Sequence[str]) -> bool:
    """Test whether the cells of a column are few words on two rows each on average, and no decimals."""
    words = {cell for cell in cells if cell}
    filled = sum(cell != "" for cell in cells)
    return not _has_decimals(words) and 0 < len(words) <= _MOST_WORDS and filled >= 2 * len(words)


def _has_decimals(words: Collection[str]) -> bool:
    """Test whether one of the words is a number with decimals, such as 0.5 or 1,5e3, but not 1.0."""
    decimals = r"[-+]?\d*[.,](\d*[1-9]\d*([eE][-+]?\d+)?|\d+[eE][-+]?\d+)"
    return any(re.fullmatch(decimals, word) for word in words)


def check_sensors_apart(
    path: str, column: str, kinds: Sequence[str], rows_by_sensor: Sequence[Rows]
) -> None:
    """Raise DataError if the positions of a run's sensors lie apart, as those of several targets do.

    The words in the ``column``, which are taken as names of sensors, may then name targets. ``kinds``
    are the types of the sensors, ``rows_by_sensor`` their rows in one run. Only sensors that measure
    positions are compared.
    """
    rows = [rows for kind, rows in zip(kinds, rows_by_sensor, strict=True) if kind == "position"]
    if len(rows) < 2:
        return
    # The number of each row's sensor, its time and its position.
    codes = np.repeat(np.arange(len(rows)), [len(part.time) for part in rows])
    time = np.concatenate([part.time for part in rows])
    values = np.concatenate([part.values[:2] for part in rows], axis=1)
    # Sensors of one target agree as one, or have errors of different sizes (see `Split`).
    if split_by(codes, time, values) == "apart":
        raise DataError(question_on_parts(path, column, "sensor"))


def check_runs_apart(
    context: ReadingContext, kinds: Sequence[str], rows_by_sensor: Sequence[Rows]
) -> None:
    """Raise DataError if the rows of several runs follow one path in turn, as those of sensors do.

    Their column has a name such as id, gps_id or frame_id, which may name sensors as well as targets.
    ``kinds`` are the types of the sensors, ``rows_by_sensor`` all their rows, in the order of the file.
    """
    column = context.naming.columns.get("run", "")
    words = {*words_of(column)}
    if "id" not in words or role_of(column) == "target" or len(context.runs) < 2:
        return
    for kind, rows in zip(kinds, rows_by_sensor, strict=True):
        if kind != "position" or not len(rows.run):
            continue
        # Rows of recordings one after the other are no such rows, even if all follow one way: they
        # change seldom from run to run. Rows that take turns change at least once for each row of the
        # rarer runs, which are all but the one with most rows.
        rarer = len(rows.run) - int(np.bincount(rows.run).max())
        takes_turns = int((np.diff(rows.run) != 0).sum()) >= max(1, rarer)
        # The rows of all runs lie on one path ("one"), or differ by the sizes of their errors alone
        # ("errors", see `Split`).
        split = split_by(rows.run.astype(np.intp), rows.time, rows.values[:2])
        if not takes_turns or split not in ("one", "errors"):
            continue
        name = in_option(column)
        shown = first_names(context.runs, _MOST_WORDS_SHOWN)
        message = (
            f"rows of {column} {shown} follow one path in turn: are these sensors of one target?"
        )
        remedy = f"Say --set 'columns.sensor={name}'; if they are targets, say"
        remedy += f" --set 'columns.run={name}', and to mix them --set 'columns.run=\"\"'"
        raise DataError(Place(context.files[0], 1, 1, f"{message} {remedy}"))
