"""Guess whether a column names sensors or runs, by the number of its different names."""

from collections.abc import Collection, Sequence

from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.guess_table_sample import TableSample

_MOST_SENSORS = 50


def drop_unlikely_labels(
    sample: TableSample,
    columns: ColumnByQuantity,
    measured: Sequence[str],
    user_columns: Collection[str],
    *,
    is_robot: bool,
    knows_landmarks: bool,
) -> None:
    """Drop, in place, columns of sensors and runs with empty cells, or an unlikely number of names.

    There are few sensors, and on average at least three rows of a run. ``measured`` are the columns of
    measured quantities. Those that the user named, by the quantities ``user_columns``, are kept. The
    rows of a robot (``is_robot``) may lack the name of a landmark. If its landmarks are known
    (``knows_landmarks``), one is enough.
    """
    most_runs = max(1, len(sample) // 3)
    for key, least, most in (("sensor", 2, _MOST_SENSORS), ("run", 1, most_runs)):
        words = set(sample.cells(columns.get(key, "")))
        if key == "sensor" and columns.get(key):
            # A sensor may begin later than the sample ends.
            words |= {*sample.further(columns[key], measured).words(columns[key])}
        if key == "sensor" and is_robot:
            words.discard("")  # of rows with odometry alone
            if knows_landmarks:
                least = 1
        if key not in user_columns and ("" in words or not least <= len(words) <= most):
            columns.pop(key, None)
