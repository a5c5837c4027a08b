"""Option `--grid`: values of a key as a list or a range, added to the grid of a config."""

import re
from collections.abc import Sequence

from trackbench.config.overrides import override, split_assignment
from trackbench.config.tuning_axes import RANGE
from trackbench.errors import Mark, Problem, UserError
from trackbench.yaml_scalars import scalar
from trackbench.yaml_source import Source, dotted

_RANGE = re.compile(rf"{RANGE}:([0-9]{{1,9}})")
_MOST_VALUES = 1000


def add_axis(source: Source, text: str) -> None:
    """Add one ``--grid`` option to the config's grid; raises UserError."""
    keys, values, mark = split_assignment(source, text, "--grid")
    path = dotted(keys)
    if not isinstance(source.data.get("grid"), dict):
        override(source, ("grid",), {}, mark)
    # A mark without a line is that of an earlier option.
    if path in source.data["grid"] and not source.mark(("grid", path)).line:
        raise UserError(Problem(mark, dotted(("grid", path)), "is given twice"))
    override(source, ("grid", path), axis_values(values, mark), mark)


def axis_values(text: str, mark: Mark) -> Sequence[object]:
    """Read the values of one axis: a list, or a range that is linear or logarithmic."""
    match = _RANGE.fullmatch(text)
    if match is None:
        if ".." in text:
            message = f"{text!r}: a range is a..b:n or log:a..b:n"
            raise UserError(Problem(mark, "", message))
        # A list may stand in brackets, as in a file.
        in_brackets = re.fullmatch(r"\[([^\[\]]*)\]", text)
        values_text = in_brackets[1] if in_brackets else text
        return [scalar(part.strip()) for part in values_text.split(",")]
    # a..b:n, or log:a..b:n
    log, first, last, number = match.groups()
    if not 1 <= int(number) <= _MOST_VALUES:
        raise UserError(Problem(mark, "", f"{number} values: write 1 to {_MOST_VALUES}"))
    if log and not (float(first) > 0 and float(last) > 0):
        raise UserError(Problem(mark, "", "a logarithmic range has ends above zero"))
    low = float(first)
    high = float(last)
    intervals = max(int(number) - 1, 1)
    values = []
    for i in range(int(number)):
        share = i / intervals
        value = low + (high - low) * share
        if log:
            value = low * (high / low) ** share
        values.append(float(f"{value:.12g}"))  # 0.3, not 0.30000000000000004
    # Between whole ends, values that are whole except for rounding are whole numbers, as a key may need:
    # N=100..500:5 gives whole numbers of particles.
    if isinstance(scalar(first), int) and isinstance(scalar(last), int):
        whole = [round(value) for value in values]
        distances = [abs(value - near) for value, near in zip(values, whole, strict=True)]
        limits = [1e-9 * max(1.0, abs(value)) for value in values]
        if all(distance < limit for distance, limit in zip(distances, limits, strict=True)):
            return whole
    return values
