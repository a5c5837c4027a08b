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

from trackbench.config.build import build_kind
from trackbench.config.includes import override
from trackbench.errors import Mark, Problem, UserError
from trackbench.models.base import position_velocity_names
from trackbench.models.sensors.base import stack
from trackbench.yaml_source import Source

if TYPE_CHECKING:
    import pandas as pd

_TARGET = ("scenario", "target")
_KINDS = "a pandas data frame, a mapping of columns, or a numpy array"


def put_tables(source: Source, tables: Mapping[str, object]) -> None:
    """Write tables by key of the target `measured` as CSV files, and name these in the config.

    A value is a data frame, a mapping of columns, an array (steps, n) or (runs, steps, n), or a list
    of them, one for each sensor. Raises UserError.
    """
    target = source.at(_TARGET) if source.has(_TARGET) else {"kind": "measured"}
    for key, value in tables.items():
        mark = Mark(f"{key}=")
        if not isinstance(target, dict) or target.get("kind") != "measured":
            kind = target.get("kind") if isinstance(target, dict) else target
            what = f"a target with {key} from Python is {{kind: measured}}, and this one is {kind}"
            raise UserError(Problem(mark, ".".join(_TARGET), what))
        several = value if isinstance(value, list | tuple) else [value]
        components, paths = _components(source, key, target, len(several)), []
        for i, one in enumerate(several):
            name = f"{key}-{i + 1}" if i else key
            of_table = components[i] if i < len(components) else ()
            paths.append(str(_written(_frame(one, of_table, Mark(name)), name)))
        if not source.has(_TARGET):
            override(source, (*_TARGET, "kind"), "measured", mark)
        override(source, (*_TARGET, key), paths if several is value else paths[0], mark)


def _components(
    source: Source, key: str, target: Mapping[str, Any], tables: int
) -> list[Sequence[str]]:
    """List the components of each table in order; empty if a sensor cannot be built."""
    if key == "truth":
        axes = target.get("axes", 2)
        of_plane = position_velocity_names(axes) if axes in (1, 2, 3) else ("x",)
        return [target.get("state") or of_plane]
    keys = ("scenario", "sensor")
    several = source.has(keys) and isinstance(source.at(keys), list)
    places = [(*keys, i) for i in range(len(source.at(keys)))] if several else [keys]
    sensors = [build_kind("sensors", source, place) for place in places if source.has(place)]
    if not sensors or None in sensors:  # the validation reports it
        return []
    stacks = [(sensor,) for sensor in sensors] if tables > 1 else [tuple(sensors)]
    return [stack(one).components for one in stacks]


def _frame(value: object, components: Sequence[str], mark: Mark) -> "pd.DataFrame":
    """Build the table with a column for each component; raises UserError."""
    import pandas as pd

    if isinstance(value, pd.DataFrame):
        names = [n for n in value.index.names if n is not None and n not in value.columns]
        return value.reset_index(level=names) if names else value
    if isinstance(value, Mapping):
        try:
            return pd.DataFrame(value)
        except (ValueError, TypeError) as error:
            raise UserError(Problem(mark, "", str(error).lower())) from None
    if not isinstance(value, np.ndarray):
        what = f"is of the type {type(value).__name__}; allowed: {_KINDS}"
        raise UserError(Problem(mark, "", what))
    if value.dtype.kind not in "fiu":
        what = f"is an array of {value.dtype}; allowed: whole numbers and floats"
        raise UserError(Problem(mark, "", what))
    n = len(components)
    if value.ndim not in (2, 3) or (n and value.shape[-1] != n):
        form = f"(steps, {n or 'n'}) or (runs, steps, {n or 'n'})"
        what = f"has the shape {value.shape}; allowed: {form}, of {', '.join(components)}"
        raise UserError(Problem(mark, "", what))
    runs = np.ma.filled(value.astype(float), np.nan)
    runs = runs[None] if runs.ndim == 2 else runs
    numbers, steps = np.indices(runs.shape[:2]).reshape(2, -1)
    cells = dict(zip(components, runs.reshape(-1, runs.shape[-1]).T, strict=False))
    return pd.DataFrame({"run": numbers, "step": steps + 1, **cells})


@cache
def _temporary() -> "TemporaryDirectory[str]":
    """Folder of the files until the program ends; a run copies its own into its results."""
    return TemporaryDirectory(prefix="trackbench-")


def _folder() -> Path:
    return Path(_temporary().name).resolve()


def _written(frame: "pd.DataFrame", name: str) -> Path:
    """Write a table's file, once for each content."""
    content = frame.to_csv(index=False, lineterminator="\n").encode()
    folder = _folder() / hashlib.sha256(content).hexdigest()[:16]
    path = folder / f"{name}.csv"
    if not path.exists():
        folder.mkdir(exist_ok=True)
        path.write_bytes(content)
    return path


def _is_from_python(path: str) -> bool:
    return _temporary.cache_info().currsize > 0 and Path(path).is_relative_to(_folder())


def path_from(path: str, folder: Path) -> str:
    """Return a data file's path relative to the results folder, which gets the files from Python."""
    return Path(path).name if _is_from_python(path) else os.path.relpath(path, folder)


def without_folders(text: str) -> str:
    """Strip folders from a message: files of tables from Python have their names alone."""
    if not _temporary.cache_info().currsize:
        return text
    return re.sub(re.escape(str(_folder())) + "/[0-9a-f]+/", "", text)


def name_rows(error: UserError) -> None:
    """Name rows of tables from Python in place of lines of their files; rows count from 0."""
    problems = list(error.problems)
    for i, problem in enumerate(problems):
        if isinstance(problem, Problem) and _is_from_python(problem.mark.file):
            row = f", row {problem.mark.line - 2}" if problem.mark.line > 1 else ""
            mark = Mark(f"{Path(problem.mark.file).stem}{row}")
            problems[i] = replace(problem, mark=mark, what=without_folders(problem.what))
    error.problems, error.args = tuple(problems), ("\n".join(map(str, problems)),)
