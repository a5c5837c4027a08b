"""Measurements and truth from Python: CSV files that the config names and the results folder gets."""

import hashlib
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from trackbench.config.build_components import build_kind
from trackbench.config.overrides import override
from trackbench.errors import Mark, Problem, UserError
from trackbench.models.component_names import position_velocity_names
from trackbench.models.sensors.stacked import stack
from trackbench.yaml_source import Keys, Source

if TYPE_CHECKING:
    import pandas as pd

_TARGET = ("scenario", "target")
_KINDS = "a pandas data frame, a mapping of columns, or a numpy array"


def tables_by_key(measurements: object, truth: object) -> dict[str, object]:
    """Return the tables from Python by the target's key; one that is None was not given."""
    tables = {"measurements": measurements, "truth": truth}
    return {key: table for key, table in tables.items() if table is not None}


def put_tables(source: Source, tables: Mapping[str, object]) -> None:
    """Write tables from Python as CSV files, and name these under the config's target `measured`.

    ``tables`` are by key of the target: `measurements` or `truth`. A value is a data frame, a mapping of
    columns, an array (steps, n) or (runs, steps, n), or a list of them, one for each sensor. Raises
    UserError.
    """
    target: object = {"kind": "measured"}
    if source.has(_TARGET):
        target = source.value_at(_TARGET)
    for key, value in tables.items():
        mark = Mark(f"{key}=")
        if not isinstance(target, dict) or target.get("kind") != "measured":
            kind = target.get("kind") if isinstance(target, dict) else target
            message = (
                f"a target with {key} from Python is {{kind: measured}}, and this one is {kind}"
            )
            raise UserError(Problem(mark, ".".join(_TARGET), message))
        # Step 1: write a file for each table.
        is_several = isinstance(value, list | tuple)
        tables_of_key = value if isinstance(value, list | tuple) else [value]
        components = _table_components(source, key, target, len(tables_of_key))
        paths = []
        for i, table in enumerate(tables_of_key):
            name = f"{key}-{i + 1}" if i else key
            # Without known components, the mistake in the sensors is reported later.
            columns = components[i] if i < len(components) else ()
            frame = _build_frame(table, columns, Mark(name))
            paths.append(str(_write_frame(frame, name)))
        # Step 2: name the files in the config.
        if not source.has(_TARGET):
            override(source, (*_TARGET, "kind"), "measured", mark)
        override(source, (*_TARGET, key), paths if is_several else paths[0], mark)


def _table_components(
    source: Source, key: str, target: Mapping[str, Any], number_of_tables: int
) -> list[Sequence[str]]:
    """List the components that are the columns of each table for the key `truth` or `measurements`.

    ``target`` is the mapping of the config's target. The list is empty if a sensor cannot be built.
    """
    if key == "truth":
        if target.get("state"):
            return [target["state"]]
        # Another number of axes is a mistake that the validation reports.
        axes = target.get("axes", 2)
        return [position_velocity_names(axes) if axes in (1, 2, 3) else ("x",)]
    # Step 1: build the sensors.
    place = ("scenario", "sensor")
    sensor_places: list[Keys] = [place]
    if source.has(place) and isinstance(source.value_at(place), list):
        sensor_places = [(*place, i) for i in range(len(source.value_at(place)))]
    sensors = [build_kind("sensors", source, keys) for keys in sensor_places if source.has(keys)]
    if not sensors or None in sensors:  # the validation reports it
        return []
    # Step 2: a table for each sensor, or one of all.
    if number_of_tables > 1:
        return [stack((sensor,)).components for sensor in sensors]
    return [stack(tuple(sensors)).components]


def _build_frame(value: object, components: Sequence[str], mark: Mark) -> "pd.DataFrame":
    """Return a table from Python as a data frame; raises UserError for another type or shape.

    ``value`` is a data frame, a mapping of columns, or an array (steps, n) or (runs, steps, n). The
    columns of an array are the n ``components``, after the numbers of run and step. ``mark`` is the
    place of mistakes.
    """
    import pandas as pd

    if isinstance(value, pd.DataFrame):
        index_names = [n for n in value.index.names if n is not None and n not in value.columns]
        if index_names:
            return value.reset_index(level=index_names)
        return value
    if isinstance(value, Mapping):
        try:
            return pd.DataFrame(value)
        except (ValueError, TypeError) as error:
            raise UserError(Problem(mark, "", str(error).lower())) from None
    if not isinstance(value, np.ndarray):
        message = f"is of the type {type(value).__name__}; allowed: {_KINDS}"
        raise UserError(Problem(mark, "", message))
    if value.dtype.kind not in "fiu":
        message = f"is an array of {value.dtype}; allowed: whole numbers and floats"
        raise UserError(Problem(mark, "", message))
    n = len(components)
    if value.ndim not in (2, 3) or (n and value.shape[-1] != n):
        form = f"(steps, {n or 'n'}) or (runs, steps, {n or 'n'})"
        message = f"has the shape {value.shape}; allowed: {form}, of {', '.join(components)}"
        raise UserError(Problem(mark, "", message))
    # Rows (runs * steps, n), each with the numbers of its run and step.
    values = np.ma.filled(value.astype(float), np.nan)
    if values.ndim == 2:
        values = values[None]
    run_numbers, step_numbers = np.indices(values.shape[:2]).reshape(2, -1)
    # Runs count from 0 and steps from 1, as in the files of results, where step 0 is the initial state.
    # Without known components, of mistaken sensors, there are no columns of values.
    columns = dict(zip(components, values.reshape(-1, values.shape[-1]).T, strict=False))
    return pd.DataFrame({"run": run_numbers, "step": step_numbers + 1, **columns})


@cache
def _temporary_directory() -> "TemporaryDirectory[str]":
    """Make the directory of the files until the program ends; a run copies its own into its results."""
    return TemporaryDirectory(prefix="trackbench-")


def _temporary_folder() -> Path:
    return Path(_temporary_directory().name).resolve()


def _has_tables() -> bool:
    """Test whether this process has tables from Python; it makes no directory for the answer."""
    return _temporary_directory.cache_info().currsize > 0


def _write_frame(frame: "pd.DataFrame", name: str) -> Path:
    """Write a table's file, once for each content; return its path."""
    content = frame.to_csv(index=False, lineterminator="\n").encode()
    folder = _temporary_folder() / hashlib.sha256(content).hexdigest()[:16]
    path = folder / f"{name}.csv"
    if not path.exists():
        folder.mkdir(exist_ok=True)
        path.write_bytes(content)
    return path


def _is_from_python(path: str) -> bool:
    return _has_tables() and Path(path).is_relative_to(_temporary_folder())


def path_from(path: str, folder: Path) -> str:
    """Return a data file's path relative to the results folder, which gets the files from Python."""
    if _is_from_python(path):
        return Path(path).name
    return os.path.relpath(path, folder)


def without_folders(text: str) -> str:
    """Return a message in which files of tables from Python have no folder."""
    if not _has_tables():
        return text
    return re.sub(re.escape(str(_temporary_folder())) + "/[0-9a-f]+/", "", text)


def name_rows(error: UserError) -> None:
    """Change an error in place: name rows of tables from Python in place of lines of their files.

    Rows count from 0.
    """
    problems = []
    for problem in error.problems:
        if isinstance(problem, Problem) and _is_from_python(problem.mark.file):
            place = Path(problem.mark.file).stem
            # Line 1 of the file has the names of the columns, line 2 is row 0 of the table.
            if problem.mark.line > 1:
                place += f", row {problem.mark.line - 2}"
            problem = replace(problem, mark=Mark(place), message=without_folders(problem.message))
        problems.append(problem)
    error.problems = tuple(problems)
    error.args = ("\n".join(map(str, problems)),)
