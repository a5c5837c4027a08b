"""Question on dates whose day and month may be in either order, which differs between two files."""

import re
from collections.abc import Sequence

from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.naming_of_columns import Naming


def check_order_of_days(path: str, guess: Guess, others: Sequence[Naming]) -> None:
    """Raise DataError if day and month may be in either order, and another file does not show which.

    `Guess.format_of_other_order` is set only if both orders give the same times since the first row, as
    of dates within one day. They then matter beside other files alone. ``path`` is the file of
    ``guess``, and ``others`` have the formats of the other files.
    """
    date_format = guess.naming.time_format
    order = _order_of_days(date_format)
    if not guess.format_of_other_order or all(
        _order_of_days(o.time_format) == order for o in others
    ):
        return
    message = "dates may be a day in either order, which matters beside the other file: say which, "
    remedy = f"`--set 'time_format=\"{date_format}\"'` or "
    remedy += f"`--set 'time_format=\"{guess.format_of_other_order}\"'`"
    raise DataError(Place(path, 1, 1, message + remedy))


def _order_of_days(date_format: str) -> str:
    """Return the letters of day, month and year in a format of dates: dmy of %d/%m/%y."""
    return "".join(re.findall("%([dmy])", date_format.replace("%Y", "%y")))
