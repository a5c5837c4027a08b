"""Legend below the axes of a figure: its columns, height and order."""

from collections.abc import Collection, Sequence
from math import ceil
from typing import Any

from trackbench.report.plotting.style import SPREAD, Figure, wrap_label


def legend_outside(
    figure: Figure, without: Collection[str] = (), order: Sequence[str] = ()
) -> None:
    """Draw one legend below the axes, each label once, in as many columns as fit.

    The figure grows by the height of the legend.

    Parameters
    ----------
    figure
        figure with everything drawn; it is changed
    without
        labels that are left out
    order
        labels that come first, in this order
    """
    handles = _handles_by_label(figure, without)
    if not handles:
        return
    first = {label: handles[label] for label in map(wrap_label, order) if label in handles}
    handles = first | handles
    columns = _count_legend_columns(list(handles), figure.get_figwidth())
    rows = ceil(len(handles) / columns)
    # Every row is as high as the label with the most lines.
    text_lines = rows * (1 + max(label.count("\n") for label in handles))
    # 0.1 inches keep the legend apart from the axes.
    figure.set_figheight(figure.get_figheight() + _LINE_IN * text_lines + 0.1)
    figure.legend(
        handles.values(),
        handles.keys(),
        loc="outside lower center",
        ncols=columns,
        columnspacing=1.5,
    )


_LETTER_IN = 0.066
"""Width of a letter in a legend."""
_LINE_IN = 0.165
"""Height of a line in a legend."""
_HANDLE_IN = 0.55
"""Width of a drawn line in a legend, with the space beside it."""


def _count_legend_columns(labels: Sequence[str], width_in: float) -> int:
    """Return the largest number of legend columns, which are filled downwards, that fit the width."""
    widths = []
    for label in labels:
        letters = max(len(text_line) for text_line in label.split("\n"))
        widths.append(_HANDLE_IN + _LETTER_IN * letters)
    # The fewest rows that fit; if none do, one column.
    for rows in range(1, len(labels) + 1):
        columns = [widths[first : first + rows] for first in range(0, len(labels), rows)]
        if sum(max(column) for column in columns) <= width_in:
            break
    return ceil(len(labels) / rows)


def _handles_by_label(figure: Figure, without: Collection[str]) -> dict[str, Any]:
    """Return the first drawn artist of each label in the figure, by the label as `wrap_label` writes it.

    Labels in ``without`` are left out. The label of two standard errors comes last.
    """
    handles: dict[str, Any] = {}
    for ax in figure.axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            if label not in without:
                handles.setdefault(wrap_label(label), handle)
    if SPREAD in handles:
        handles[SPREAD] = handles.pop(SPREAD)
    return handles
