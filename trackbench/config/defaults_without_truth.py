"""Default tables and figures for recordings without ground truth."""

from typing import Any

from trackbench.config.experiment import Point, Settings
from trackbench.config.includes import override
from trackbench.errors import Mark
from trackbench.models.base import position_velocity_names
from trackbench.yaml_source import Source

_MARK = Mark("default without a truth")


def fill_in(source: Source, settings: Settings, points: list[Point]) -> None:
    """Add tables and figures of innovations if none is named and every file is written."""
    chosen = settings.metrics is not None or settings.per_step is not None
    if chosen or not points or any(p.scenario.has_truth for p in points):
        return
    if "tables" not in source.data:
        override(source, ("tables",), {"innovations": {"kind": "innovations"}}, _MARK)
    if "figures" not in source.data:
        override(source, ("figures",), _figures(points[0]), _MARK)


def _figures(point: Point) -> dict[str, Any]:
    figures: dict[str, Any] = {
        "nis": {"kind": "nis"},
        "whiteness": {"kind": "autocorrelation"},
        "estimates": {"kind": "estimates"},
    }
    if point.scenario.components[:4] == position_velocity_names(2):
        del figures["estimates"]
        figures["track"] = {"kind": "track", "filters": list(point.filters)[:4]}
    return figures
