"""Fonts and sizes of the letters in figures, for a screen and for a paper."""

from typing import Any


def _text_settings(
    points: float, legend_points: float, **fonts: Any
) -> tuple[tuple[str, Any], ...]:
    """Return matplotlib's settings for letters of these sizes in points, and these fonts."""
    sizes = {
        "font.size": points,
        "axes.titlesize": points,
        "axes.labelsize": points,
        "figure.titlesize": points,
        "figure.labelsize": points,
        "legend.fontsize": legend_points,
    }
    return tuple((sizes | fonts).items())


SCREEN_TEXT = _text_settings(
    points=9,
    legend_points=8,
    **{"font.family": "DejaVu Sans", "mathtext.fontset": "dejavusans"},
)
PAPER_TEXT = _text_settings(
    points=8,
    legend_points=8,
    **{"font.family": "STIXGeneral", "mathtext.fontset": "stix"},
)
