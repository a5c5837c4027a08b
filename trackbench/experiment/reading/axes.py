"""The axes of a sweep as typed: ``PATH=V1,V2``, ``PATH=a..b:n`` and ``PATH=log:a..b:n``."""

import re
from typing import Any

from trackbench.experiment.problems import Mark, Problem, UserError
from trackbench.experiment.reading.compose import split_assignment
from trackbench.experiment.reading.source import Source, dotted, scalar
from trackbench.tuning.axes import RANGE

_RANGE = re.compile(rf"{RANGE}:([0-9]{{1,9}})")
_MOST_VALUES = 1000


def add_axis(source: Source, text: str) -> None:
    """Add one ``--grid`` option to the config's grid; raises UserError."""
    keys, values, mark = split_assignment(source, text, "--grid")
    path = dotted(keys)
    if not isinstance(source.data.get("grid"), dict):
        source.data["grid"] = {}
        source.marks["grid",] = source.key_marks["grid",] = mark
    if path in source.data["grid"] and not source.mark(("grid", path)).line:
        raise UserError(Problem(mark, dotted(("grid", path)), "is given twice"))
    found = source.data["grid"][path] = axis_values(values, mark)
    for at in (("grid", path), *(("grid", path, i) for i in range(len(found)))):
        source.marks[at] = source.key_marks[at] = mark


def axis_values(text: str, mark: Mark) -> list[Any]:
    """The values of one axis: a list, or a range that is linear or logarithmic."""
    match = _RANGE.fullmatch(text)
    if match is None:
        if ".." in text:
            what = f"{text!r}: a range is a..b:n or log:a..b:n"
            raise UserError(Problem(mark, "", what))
        return [scalar(part.strip()) for part in text.split(",")]
    log, first, last, number = match.groups()
    if not 1 <= int(number) <= _MOST_VALUES:
        raise UserError(Problem(mark, "", f"{number} values: write 1 to {_MOST_VALUES}"))
    if log and not (float(first) > 0 and float(last) > 0):
        raise UserError(Problem(mark, "", "a logarithmic range has ends above zero"))
    values = _spaced(float(first), float(last), int(number), bool(log))
    if isinstance(scalar(first), int) and isinstance(scalar(last), int):
        whole = [round(v) for v in values]
        if all(abs(v - w) < 1e-9 * max(1.0, abs(v)) for v, w in zip(values, whole, strict=True)):
            return whole
    return values


def _spaced(first: float, last: float, number: int, log: bool) -> list[float]:
    """As typed, to twelve digits: 0.3 and not 0.30000000000000004."""
    share = [i / (number - 1) if number > 1 else 0.0 for i in range(number)]
    if log:
        values = [first * (last / first) ** s for s in share]
    else:
        values = [first + (last - first) * s for s in share]
    return [float(f"{value:.12g}") for value in values]
