"""Tables and figures of one's own: what they say of an experiment, before anything runs."""

from collections.abc import Sequence

from trackbench.config.experiment import DrawnExhibit, Exhibit, Point
from trackbench.config.plugin_checks import asked, check_words
from trackbench.extension_points import is_foreign
from trackbench.filters.base import WrongReturnError
from trackbench.plugins.errors import located_message
from trackbench.plugins.interrupts import guarded


def conflicts(part: Exhibit, points: Sequence[Point]) -> dict[str, str]:
    """Return the conflicts of a table or figure; what a plugin raises becomes one, too."""
    if not is_foreign(part):
        return part.conflicts(points)
    try:
        found: dict[str, str] = asked(part.conflicts, dict, points)
        check_words(*found, *found.values())
        if isinstance(part, DrawnExhibit):
            _check_shown(part)
    except Exception as error:
        return {"": located_message(error, part)}
    return found


def _check_shown(part: DrawnExhibit) -> None:
    """Raise WrongReturnError unless what must be kept for a figure is said as it has to be."""
    with guarded():
        runs, components = part.shown_runs, part.shown_components
        _ = part.shown_covariances, part.shown_measurements
    if not isinstance(runs, int):
        raise WrongReturnError("shown_runs", f"shown_runs is {runs!r}, no whole number")
    if components is not None and not isinstance(components, tuple):
        what = f"shown_components is {components!r}, neither a tuple of numbers nor None"
        raise WrongReturnError("shown_components", what)
