"""The figures that are drawn: matplotlib's own, without pyplot."""

import io

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from trackbench.core.arrays import Array

_DPI = 150


class Canvas(Figure):
    """A figure that a notebook shows, whether pyplot is used in it or not."""

    def __init__(self, width_in: float, height_in: float) -> None:
        super().__init__(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasAgg(self)
        self.errors: dict[tuple[Axes, str], tuple[Array, Array]] = {}
        """abscissas and standard errors (n,) by axes and label, to be read off the page"""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the picture, and its size on the page in pixels, which are 1/100 in."""
        return png(self), {"width": round(100 * self.get_figwidth())}


def png(figure: Figure) -> bytes:
    """Return a figure for a screen."""
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None}, dpi=_DPI)
    return out.getvalue()
