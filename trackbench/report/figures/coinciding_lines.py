"""Lines of a figure of which one hides another: the caption names them."""

from collections.abc import Mapping, Sequence

import numpy as np

from trackbench.core.arrays import Array
from trackbench.report.findings.phrases import joined, named

_WIDTH_OF_LINE = 0.006
"""Width of a line, as a share of the height of a panel."""


def coinciding_lines(panels: Sequence[Mapping[str, Array]], log: bool) -> str:
    """Return sentences that name lines of which one hides the other.

    Two lines coincide if their distance is below the width of a line throughout all panels.

    Parameters
    ----------
    panels
        values (n,) of each line by its label, for each panel
    log
        True if the vertical axis is logarithmic

    Returns
    -------
    str
        sentences for a caption, each after a space; empty if no lines coincide
    """
    panels_of_axis = []  # the values as places on the axis
    for panel in panels:
        with np.errstate(divide="ignore", invalid="ignore"):
            places = {label: np.log10(y) if log else y for label, y in panel.items()}
        panels_of_axis.append({label: y for label, y in places.items() if np.isfinite(y).any()})
    labels = list(dict.fromkeys(label for panel in panels_of_axis for label in panel))
    text = ""
    grouped: set[str] = set()  # labels that a sentence names as coinciding with one before
    for i, label in enumerate(labels):
        if label in grouped:
            continue
        others = [b for b in labels[i + 1 :] if _have_one_place(panels_of_axis, label, b)]
        if others:
            grouped.update(others)
            text += f" The lines of {joined([named(name) for name in [label, *others]])} coincide."
    return text


def _have_one_place(panels: Sequence[Mapping[str, Array]], first: str, second: str) -> bool:
    """Test whether two lines lie on each other in all panels; ``panels`` have places on the axis."""
    for panel in panels:
        if (first in panel) != (second in panel):
            return False
        if first not in panel:
            continue
        a = panel[first]
        b = panel[second]
        is_known = np.isfinite(a)
        if len(a) != len(b) or (is_known != np.isfinite(b)).any():
            return False
        every_place = np.concatenate(list(panel.values()))
        height = np.ptp(every_place[np.isfinite(every_place)])
        if np.abs(a[is_known] - b[is_known]).max() > _WIDTH_OF_LINE * height:
            return False
    return True
