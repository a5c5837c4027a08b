"""Default metrics of tables and figures: errors of the scenario in place of errors that it lacks."""

from collections.abc import Sequence

from trackbench.config.experiment import Point
from trackbench.config.overrides import override
from trackbench.evaluation.metric_expression import Measure
from trackbench.registry import Group, of_kind
from trackbench.scenarios.base import error_names
from trackbench.yaml_source import Source


def fill_default_metrics(group: Group, source: Source, points: Sequence[Point]) -> None:
    """Override the default metric of a table or figure where the scenario lacks it.

    The default metric of some kinds is an error such as the RMSE of the position. An entry of ``group``
    without `metric` gets the scenario's first error then.
    """
    if not points or not points[0].scenario.has_truth:
        return
    errors = error_names(points[0].scenario)
    if not errors:
        return
    for name, entry in (source.data.get(group) or {}).items():
        if not isinstance(entry, dict) or "metric" in entry:
            continue
        # The default of a dataclass's key is an attribute of the class.
        default = getattr(of_kind(group, str(entry.get("kind"))), "metric", None)
        if not isinstance(default, Measure):
            continue
        if default.metric.startswith("rmse") and default.metric not in errors:
            metric = str(default).replace(default.metric, errors[0])
            override(source, (group, name, "metric"), metric, source.mark((group, name)))
