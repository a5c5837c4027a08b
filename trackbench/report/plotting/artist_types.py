"""matplotlib's types for signatures: it takes long to import, and only what draws has to."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
else:
    Artist = Axes = Axis = Figure = Any

__all__ = ["Artist", "Axes", "Axis", "Figure"]
