"""Drawing of any figure: its style, whether it can be drawn, and the contents of its files."""

from collections.abc import Sequence

from trackbench.report.figure_cache import Files
from trackbench.report.kinds import FigureKind
from trackbench.report.output_errors import catch_errors
from trackbench.report.plotting import file_formats, style
from trackbench.report.plotting.page_formats import is_crowded
from trackbench.report.plugin_tables_and_figures import as_figure
from trackbench.report.tables_and_figures import Results


def draw_figure(spec: FigureKind, results: Results, formats: Sequence[str]) -> Files:
    """Draw a figure; return its format and the content of its file, for each of the ``formats``.

    The list is empty if the figure needs tracks and every filter failed, and if its panels are crowded
    on the page that `drawing_for` has set. Raises OutputError if the drawing fails.
    """
    with catch_errors(spec):
        # ``shown_runs`` is the number of runs whose tracks the figure draws, and ``shown`` has the
        # tracks that the results store.
        if spec.shown_runs and not results.shown:
            return []
        with style.rc_context():
            figure = as_figure(spec.with_best(results).draw(results))
            contents = []
            if not is_crowded(figure):
                # The SVG comes first, as in the results in git: after a PNG matplotlib simplifies other
                # lines.
                for form in sorted(formats, key=lambda form: form != "svg"):
                    contents.append((form, file_formats.content(figure, form)))
        file_formats.close(figure)
        return contents
