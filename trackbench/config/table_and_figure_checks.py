"""Checks of tables and figures: conflicts, declared tracks, runs and components, key figure."""

from collections.abc import Sequence

from trackbench.component_parts import is_foreign
from trackbench.config.experiment import DrawnExhibit, Exhibit, Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.key_mistakes import add_conflicts, unknown
from trackbench.filters.base import WrongReturnError
from trackbench.plugins.checks import call_hook, check_words
from trackbench.plugins.errors import PluginError, plugin_code
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
    source: Source, group: Group, exhibits: dict[str, Exhibit], points: list[Point]
) -> None:
    """Add the conflicts of tables and figures with these points.

    A plugin's exhibits are checked only once no filter has mistakes, since its code expects filters.
    """
    if not points:
        return
    is_complete = all(None not in point.filters.values() for point in points)
    for name, exhibit in exhibits.items():
        if is_foreign(exhibit) and not is_complete:
            continue
        add_conflicts(source, (group, name), exhibit_conflicts(exhibit, points))


def check_figures(
    source: Source, settings: Settings, figures: dict[str, DrawnExhibit], points: list[Point]
) -> None:
    """Check that figures ask for no run and no component beyond the last.

    ``figures`` are by name. Their keys ``run`` and ``component`` count from 1.
    """
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


def exhibit_conflicts(exhibit: Exhibit, points: Sequence[Point]) -> dict[str, str]:
    """Collect the conflicts of a table or figure; for plugins also what would stop the runner."""
    if not is_foreign(exhibit):
        return exhibit.conflicts(points)
    try:
        with plugin_code(exhibit):
            conflicts: dict[str, str] = call_hook(exhibit.conflicts, dict, points)
            check_words(*conflicts, *conflicts.values())
            if isinstance(exhibit, DrawnExhibit):
                _check_shown(exhibit)
    except PluginError as error:
        return {"": str(error)}
    return conflicts


def _check_shown(exhibit: DrawnExhibit) -> None:
    """Raise WrongReturnError unless a figure declares properly which tracks it needs."""
    runs = exhibit.shown_runs
    components = exhibit.shown_components
    # These are read only so that an error in them is reported here.
    _ = exhibit.shown_covariances
    _ = exhibit.shown_measurements
    if not isinstance(runs, int):
        raise WrongReturnError("shown_runs", f"shown_runs is {runs!r}, no whole number")
    if components is not None and not isinstance(components, tuple):
        message = f"shown_components is {components!r}, neither a tuple of numbers nor None"
        raise WrongReturnError("shown_components", message)
