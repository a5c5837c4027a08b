"""Tables and figures of an experiment that names none: its track; without a truth its innovations."""

from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.overrides import override
from trackbench.errors import Mark
from trackbench.models.plane_components import rows_in_plane
from trackbench.yaml_source import Source


def add_default_exhibits(source: Source, settings: Settings, points: list[Point]) -> None:
    """Add default tables and figures to a config that names none.

    With ground truth in the plane it gets a track of the first run. Without ground truth it gets tables
    if it has no key `tables`, and figures if it has no key `figures`: of innovations and estimates.
    ``points`` are those of the grid, none if all have mistakes.
    """
    # Chosen metrics may leave out those that the defaults show, such as `anis` per step.
    chooses_metrics = settings.metrics is not None or settings.per_step is not None
    if chooses_metrics or not points:
        return
    scenario = points[0].scenario
    # {}: only components px and py count, and no error `position` of the score.
    is_planar = rows_in_plane(scenario.components, {}) is not None
    # With ground truth: the track of the first run. It shows one point, so that a grid has none.
    if any(p.scenario.has_truth for p in points):
        if is_planar and not settings.grid and not settings.tables and not settings.figures:
            track = {"kind": "track"}
            override(source, ("figures",), {"track": track}, Mark("default in the plane"))
        return
    # Without ground truth: tables and figures that need only innovations.
    mark = Mark("default without ground truth")
    if "tables" not in source.data:
        override(source, ("tables",), {"innovations": {"kind": "innovations"}}, mark)
    if "figures" not in source.data:
        figures: dict[str, object] = {
            "nis": {"kind": "nis"},
            "whiteness": {"kind": "autocorrelation"},
        }
        if is_planar:
            figures["track"] = {"kind": "track"}
        else:
            figures["estimates"] = {"kind": "estimates"}
        override(source, ("figures",), figures, mark)
