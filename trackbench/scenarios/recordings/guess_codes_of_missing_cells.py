"""Guess of the key `missing`: numbers that stand for missing cells, or for no detection."""

from collections.abc import Collection, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.errors import counted, form_for
from trackbench.field_types import DataError, Place
from trackbench.scenarios.recordings.guess_record import ColumnByQuantity
from trackbench.scenarios.recordings.guess_table_sample import TableSample
from trackbench.scenarios.recordings.missing_cells import NINES, outlying
from trackbench.scenarios.recordings.naming_of_columns import Naming
from trackbench.scenarios.recordings.outliers_and_no_fix import no_fix
from trackbench.scenarios.recordings.quantity_keys import GEODETIC, PLACE, VELOCITY, plain_name
from trackbench.scenarios.recordings.rows_and_reading_context import Rows
from trackbench.scenarios.recordings.unit_names_and_sizes import UNITS

_FEWEST_MEASURED = 5
"""rows beside which others may show that nothing was detected"""
_FEWEST_LARGEST = 3
"""equal largest ranges that may stand for none"""
_FAR_STEPS = 10.0
"""large steps between measured rows, from which on a position of zeros is none"""
_SHARE_OF_STEPS = 0.9
"""share of the steps between measured rows that are at most a large step"""


def guess_missing(
    sample: TableSample,
    columns: ColumnByQuantity,
    measured: set[str],
    user_columns: Collection[str],
) -> tuple[float, ...]:
    """Return numbers far outside the others, which stand for missing cells in all columns.

    They are whole numbers, or nines such as 9999.9. They are searched in the columns of the
    ``measured`` quantities and in latitude and longitude. ``columns`` are the columns by quantity, and
    ``user_columns`` the quantities whose columns the user named. If no number is far outside, one near
    the others that stands for no detection is returned.
    """
    # Speeds and velocities are only read because their usual numbers, such as 0, are no codes: a
    # velocity far from the others may be true.
    names = sorted((measured | {*GEODETIC[:2], "speed", *VELOCITY}) & columns.keys())
    values = {name: sample.numbers(columns[name]) for name in names}  # arrays of their own
    if "latitude" in values and "longitude" in values:
        # Rows without a fix hold nothing. They stay, so that a row's index shows its line.
        has_no_fix = no_fix(values["latitude"], values["longitude"], UNITS["deg"])
        for column in values.values():
            column[has_no_fix] = np.nan
    codes: list[float] = []
    outliers = {name: outlying(column) for name, column in values.items()}
    for name in sorted(values.keys() & (measured | {*GEODETIC[:2]})):
        if name == "azimuth":
            continue  # an azimuth of 0 may be far from others, and none of them is missing
        for value in outliers[name]:
            # A number that is a usual one in another column is no code.
            is_code = all(
                value in outliers[other] or not (values[other] == value).any() for other in values
            )
            is_written = value % 1 == 0 or NINES.fullmatch(f"{abs(value):.9g}")
            if is_written and is_code and value not in codes:
                codes.append(value)
    if not codes:
        # A number near the others, such as 0, may stand for the position or range of no detection.
        codes = _codes_of_no_detection(sample, columns, values, user_columns)
    return tuple(codes)


def late_missing_numbers(
    sample: TableSample,
    naming: Naming,
    quantities: Sequence[Sequence[str]],
    rows_by_sensor: Sequence[Rows],
) -> tuple[float, ...]:
    """Return whole numbers far outside the others in all rows of a table, as `guess_missing` does.

    They are late, as they occur only after the first rows, which `guess_missing` reads. ``quantities``
    are those of each sensor in ``rows_by_sensor``, in SI. Only quantities with a column of their own in
    ``naming`` count, and no angles. A usual number of another column of the ``sample``, such as a speed
    of 0, is none.
    """
    parts: dict[str, list[Array]] = {}
    for names, rows in zip(quantities, rows_by_sensor, strict=True):
        for name, values_in_si in zip(names, rows.values, strict=True):
            if name in naming.columns and plain_name(name) not in ("azimuth", "bearing"):
                values = values_in_si / naming.scale(name)
                parts.setdefault(naming.columns[name], []).append(values)
    numbers = {column: np.concatenate(values) for column, values in parts.items()}
    outliers = {column: outlying(values) for column, values in numbers.items()}
    others_in_sample = [
        sample.numbers(column)
        for name, column in naming.columns.items()
        if name in (*GEODETIC[:2], "speed", *VELOCITY) and column not in numbers
    ]
    # A velocity far from the others may be true, so that no number of a velocity's column is a code.
    velocities = {naming.columns.get(name) for name in VELOCITY}
    codes: list[float] = []
    for column in sorted(outliers.keys() - velocities):
        for value in outliers[column]:
            # The conversion to SI and back may have rounded it.
            code = float(np.rint(value))
            is_code = np.isclose(value, code, rtol=1e-12, atol=0.0) and all(
                value in outliers[other] or not (numbers[other] == value).any() for other in numbers
            )
            is_usual = any((values == code).any() for values in others_in_sample)
            if is_code and not is_usual and code not in codes:
                codes.append(code)
    return tuple(codes)


def _codes_of_no_detection(
    sample: TableSample,
    columns: ColumnByQuantity,
    values: dict[str, Array],
    user_columns: Collection[str],
) -> list[float]:
    """Return the number that stands for a position or range if nothing was detected, in a list.

    The list is empty if no number does. The number is 0, -1 or the largest range, and its rows lie far
    from the measured rows before and after. ``columns`` are the columns and ``values`` (R,) the numbers
    by quantity. Raises DataError if only some rows with 0 or -1 lie far, or if another quantity has the
    number, too. Columns that the user named, whose quantities are in ``user_columns``, are measured in
    all rows.
    """
    for group in (PLACE, ("range",)):
        if not all(name in values for name in group) or not {*group}.isdisjoint(user_columns):
            continue
        positions = np.stack([values[name] for name in group])
        codes = [0.0, -1.0]
        if group == ("range",) and np.isfinite(positions).any():
            # Some radars write their largest range if nothing was detected.
            largest = float(np.nanmax(positions))
            if (positions == largest).sum() >= _FEWEST_LARGEST:
                codes.append(largest)
        for code in codes:
            is_code = (positions == code).all(axis=0)
            measured = np.flatnonzero(np.isfinite(positions).all(axis=0) & ~is_code)
            if not is_code.any() or len(measured) < _FEWEST_MEASURED:
                continue
            # Compare the distance from the nearer one of two measured neighbors with the usual steps.
            steps = np.sqrt(np.square(np.diff(positions[:, measured], axis=1)).sum(axis=0))
            rows = np.flatnonzero(is_code)
            after = np.searchsorted(
                measured, rows
            )  # the next measured row, as an index into `measured`
            distances = np.full(len(rows), np.inf)
            for neighbor in (after - 1, after):
                inside = (neighbor >= 0) & (neighbor < len(measured))
                nearest = positions[:, measured[neighbor[inside]]]
                distance = np.sqrt(np.square(nearest - code).sum(axis=0))
                distances[inside] = np.minimum(distances[inside], distance)
            is_far = distances > _FAR_STEPS * np.quantile(steps, _SHARE_OF_STEPS)
            # Some rows may be measured there, as those at the start of a path that begins at zero. Some
            # targets are measured at the largest range: it is a code only if all its rows are far.
            if not is_far.any() or (code not in (0.0, -1.0) and not is_far.all()):
                continue
            others = [name for name, column in values.items() if (column[~is_code] == code).any()]
            # The code counts for all columns, so that no other column may have it as a usual number.
            if not others and is_far.all():
                return [code]
            rows = rows[is_far]
            shown = " and ".join(columns[name] for name in group)
            verb = form_for(len(rows), "lies", "lie")
            message = (
                f"{counted(len(rows), 'row')} with {shown} = {code:g} {verb} far from the rows"
            )
            message += " before and after"
            remedy = "empty these cells if nothing was measured"
            option = " ".join(f"--set 'columns.{name}={columns[name]}'" for name in group)
            advice = f"{remedy}; if they are measured, say {option}"
            line = sample.lines[int(rows[0])]
            raise DataError(Place(sample.path, line, 1, f"{message}: {advice}"))
    return []
