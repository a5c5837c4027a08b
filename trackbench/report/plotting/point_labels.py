"""Texts beside points of a figure, where they cover no other text and no other point."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from trackbench.report.plotting.style import Axes, Figure, LineStyle

_PLACES = (
    ((4.0, 2.0), "left"),
    ((4.0, -7.0), "left"),
    ((-4.0, 2.0), "right"),
    ((-4.0, -7.0), "right"),
    ((0.0, 10.0), "center"),
    ((0.0, -15.0), "center"),
    ((0.0, 18.0), "center"),
    ((0.0, -23.0), "center"),
    ((0.0, 26.0), "center"),
)
"""Offsets of a text from its point, in points, with its alignment; the first free one is taken."""
_NEAR_PLACES = 6
"""Number of the first places, from which it is plain to which point the text belongs."""


@dataclass(frozen=True, kw_only=True)
class PointLabel:
    """A text beside a point (x, y) of an axes."""

    text: str
    point: tuple[float, float]
    look: LineStyle = field(default_factory=dict)
    """color and weight of the letters"""


def label_points(
    figure: Figure,
    ax: Axes,
    labels: Sequence[PointLabel],
    font_size: float,
    leave_out: bool = False,
) -> None:
    """Write each text beside its point, where it covers no other text and no other point.

    Each text is tried at some places around its point, the nearest first. If no place is free, the text
    is at the last one.

    Parameters
    ----------
    figure
        figure that has its legend already, which changes the places of points
    ax
        axes with the points
    labels
        texts with their points and looks
    font_size
        size of the letters in points
    leave_out
        True to try near places only, and not to write a text without a free one
    """
    figure.draw_without_rendering()  # sets the transformation from data to pixels
    dots = [ax.transData.transform(label.point) for label in labels]
    places = _PLACES[:_NEAR_PLACES] if leave_out else _PLACES
    boxes: list[Any] = []  # those of the texts so far
    for number, label in enumerate(labels):
        other_dots = dots[:number] + dots[number + 1 :]
        is_free = False
        for offset, side in places:
            text = ax.annotate(
                label.text,
                label.point,
                offset,
                textcoords="offset points",
                fontsize=font_size,
                ha=side,
                **label.look,
            )
            box = text.get_window_extent()
            covers_point = any(box.contains(*dot) for dot in other_dots)
            is_free = not covers_point and not any(box.overlaps(other) for other in boxes)
            if is_free:
                break
            is_last = (offset, side) == places[-1]
            if leave_out or not is_last:
                text.remove()
        if is_free or not leave_out:
            boxes.append(box)
