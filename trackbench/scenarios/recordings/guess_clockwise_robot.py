"""Question whether bearings or the gyro of a robot count clockwise."""

import numpy as np

from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.rows_and_reading_context import Rows
from trackbench.scenarios.recordings.yaml_values import in_option

_LEAST_TURN = 0.05
_LARGEST_TURN = 2.0
"""rad by which a robot turns between two bearings of a landmark, so that they show the direction"""
_FEWEST_TURNS = 10
_MUCH_SMALLER = 0.5
"""ratio of two median errors that decides; errors of bearings alone make both about equal"""


def check_turns_of_robot(
    guess: Guess, odometry: Rows, bearings: list[tuple[Array, Array]], table: Guess | None
) -> None:
    """Raise DataError if bearings and a robot's turn rate count in opposite directions.

    While a robot turns to the left, landmarks move to its right: a change of the heading changes their
    bearings by as much with the other sign. ``odometry`` are rows with the values v and w. ``bearings``
    are the times, s, and the bearings, rad, of each landmark. ``table`` is the guess at the table of the
    odometry, or None if this is the table of the measurements.
    """
    if not len(odometry.time):
        return
    # The turn rate of a row holds since the row before.
    intervals = np.diff(odometry.time, prepend=odometry.time[0])
    heading = np.cumsum(odometry.values[1] * intervals)
    # Errors, rad, of the expected changes of bearings: if bearings and turn rate count in the same
    # direction, and if they count in opposite ones.
    errors_if_alike = []
    errors_if_opposite = []
    for times, angles in bearings:
        turns = np.diff(np.interp(times, odometry.time, heading))
        changes = np.diff(angles)
        # A smaller turn hides in the errors, and a larger one may as well be one in the other direction.
        is_sure = (np.abs(turns) > _LEAST_TURN) & (np.abs(turns) < _LARGEST_TURN)
        errors_if_alike += np.abs(wrap_angle(changes + turns))[is_sure].tolist()
        errors_if_opposite += np.abs(wrap_angle(changes - turns))[is_sure].tolist()
    if len(errors_if_alike) < _FEWEST_TURNS or np.median(
        errors_if_opposite
    ) > _MUCH_SMALLER * np.median(errors_if_alike):
        return
    bearing = guess.naming.columns["bearing"]
    turn_rate = (table or guess).naming.columns["w"]
    key = "columns.w" if table is None else "input_naming.columns.w"
    message = f"{bearing} and {turn_rate} agree only if one of them counts clockwise"
    of_bearings = "if the bearings do, say --set 'clockwise=[bearing]'"
    of_turn_rate = "if the turn rate does, change its signs in the file"
    neither = f"to read both as they are, say --set '{key}={in_option(turn_rate)}'"
    remedies = f"{of_bearings}; {of_turn_rate}; {neither}"
    raise DataError(Place(guess.path, 1, 1, f"{message}: {remedies}"))
