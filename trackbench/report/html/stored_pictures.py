"""Pictures of figures for pages: as they are stored in the results folder, or else drawn."""

from collections.abc import Iterator
from pathlib import Path

from trackbench.report.figure_drawing import draw_figure
from trackbench.report.kinds import FigureKind, shows_cpu_times
from trackbench.report.tables_and_figures import Results
from trackbench.results.file_names import output_folder


def key_picture(results: Results) -> bytes | None:
    """Return the SVG that the report begins with; None if there is none."""
    return next((content for _, _, content in pictures(results)), None)


def pictures(results: Results) -> Iterator[tuple[str, FigureKind | None, bytes]]:
    """Yield name, kind and SVG of each figure that is in the folder, or can be drawn.

    The key figure comes first. The kind is None if its plugin is not loaded. A figure of the config that
    is missing in the folder is drawn; the default figure is shown only if the folder has it.
    """
    specs = results.parts("figures")
    configs = results.figure_configs
    # The default figure is not in the config.
    names = [*(name for name in specs if name not in configs), *configs]
    for name in sorted(names, key=lambda name: name != results.key_figure):
        spec = specs.get(name)
        folder = "figures" if spec is None else output_folder("figures", shows_cpu_times(spec))
        content = _stored_picture(results, Path(folder) / f"{name}.svg")
        has_failed = f"figure {name}" in results.unmade
        if content is None and spec is not None and name in configs and not has_failed:
            with results.continued_after_failure(f"figure {name}"):
                # At most one file, as there is one format.
                for _, drawn in draw_figure(spec, results, ["svg"]):
                    content = drawn
        if content is not None:
            yield name, spec, content


def _stored_picture(results: Results, place: Path) -> bytes | None:
    """Read an SVG of the results folder; None if it is missing, or reached by a symbolic link.

    ``place`` is its path within the folder. Anybody may have written the folder, and a link in it may
    lead to any file.
    """
    path = results.folder / place
    # The last parent is the results folder itself, which may be a link.
    for part in (place, *place.parents[:-1]):
        if (results.folder / part).is_symlink():
            return None
    if not path.is_file():
        return None
    return path.read_bytes()
