"""Figure that a notebook shows, and its resolution there."""

import io

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

_DPI = 150
"""Resolution of a figure in a notebook."""


class Canvas(Figure):
    """A figure that a notebook shows, whether pyplot is used in it or not."""

    def __init__(self, width_in: float, height_in: float) -> None:
        super().__init__(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasAgg(self)

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """Return the PNG file, and the width on the page in pixels, which are 1/100 in."""
        width = round(100 * self.get_figwidth())
        return png(self), {"width": width}


def png(figure: Figure) -> bytes:
    """Return a figure for a screen, as the content of a PNG file; equal figures have equal files."""
    file = io.BytesIO()
    # Without "Software", which names the version of matplotlib.
    figure.savefig(file, format="png", metadata={"Software": None}, dpi=_DPI)
    return file.getvalue()
