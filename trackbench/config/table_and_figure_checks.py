"""Checks of tables and figures: conflicts with the grid, numbers of runs and components, key figure."""

from trackbench.config.experiment import DrawnExhibit, Exhibit, Point
from trackbench.config.mistakes import add_conflicts, unknown
from trackbench.config.plugins_of_config import exhibit_conflicts
from trackbench.config.settings import Settings
from trackbench.extension_points import is_foreign
from trackbench.registry import Group
from trackbench.yaml_source import Source


def check_key_figure(source: Source, settings: Settings) -> None:
    """Check that the report's key figure is one of the experiment's."""
    name = settings.key_figure
    if name is not None and name not in settings.figures:
        hint = "there are none: leave this key out"
        if settings.figures:
            hint = unknown(name, list(settings.figures))
        source.add_problem(("key_figure",), f"{name!r} is not a figure here; {hint}")


def check_drawable(
    source: Source, group: Group, parts: dict[str, Exhibit], points: list[Point]
) -> None:
    """Add the conflicts of tables and figures with these points.

    A plugin's exhibits are checked only once no filter has mistakes, since its code expects filters.
    """
    if not points:
        return
    is_complete = all(None not in point.filters.values() for point in points)
    for name, part in parts.items():
        if is_foreign(part) and not is_complete:
            continue
        add_conflicts(source, (group, name), exhibit_conflicts(part, points))


def check_figures(
    source: Source, settings: Settings, figures: dict[str, DrawnExhibit], points: list[Point]
) -> None:
    """Check that figures ask for no run and no component beyond the last."""
    # A component must exist at every point of the grid.
    sizes = [len(p.scenario.components) for p in points]
    limits = {"run": settings.runs, "component": min(sizes, default=1)}
    for name, figure in figures.items():
        for key in figure.numbers:
            number = getattr(figure, key)
            most = limits[key]
            if number > most:
                verb = "are" if most > 1 else "is"
                message = f"{number} is more than the {most} there {verb}"
                source.add_problem(("figures", name, key), message)
