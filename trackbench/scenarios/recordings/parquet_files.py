"""Parquet files: their recognition by name, and their cells as texts."""

from pathlib import Path
from typing import Any

from trackbench.field_types import DataError, Place
from trackbench.readable_files import require_regular_file


def is_parquet(path: str) -> bool:
    """Test whether a file is a Parquet file, by its name."""
    return Path(path).suffix.lower() in (".parquet", ".pq")


def read_parquet(path: str, columns: list[str] | None) -> Any:
    """Return a pandas data frame of these columns; if ``columns`` is None, the names of all columns."""
    try:
        from pyarrow import parquet  # type: ignore[import-not-found,unused-ignore]
    except ImportError:
        message = "reading Parquet takes pyarrow: pip install pyarrow, or write the table as CSV"
        raise DataError(Place(path, 1, 1, message)) from None
    try:
        file = require_regular_file(path)
        if columns is None:
            return parquet.read_schema(file).names
        return parquet.read_table(file, columns=columns).to_pandas()
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise DataError(Place(path, 1, 1, f"not a Parquet file: {reason}")) from None


def texts_of_cells(column: Any) -> list[str]:
    """Return the cells of a data frame's column as the texts that a CSV would have.

    A missing cell is an empty text. pandas has several values for it, such as None, NaN, NaT and NA.
    """
    cells = zip(column.tolist(), column.isna().tolist(), strict=True)
    return ["" if is_missing else str(cell) for cell, is_missing in cells]
