"""Keys `bound` and `exact`: check that bounds and exact errors exist, and label them."""

from collections.abc import Collection

from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.exact_errors import is_exact, why_not_exact
from trackbench.evaluation.metric_expression import Measure
from trackbench.plugins.plugin_errors import plugin_code
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Source


def check_bound(source: Source, scenario: Scenario) -> None:
    """Check that a requested lower bound exists."""
    if source.data.get("bound") is None:
        return
    why = scenario.why_no_bound  # None if there is a bound; empty if its lack has no further reason
    if why is not None:
        message = f"scenario {scenario.kind} has no lower bounds"
        if why:
            message += f": {why}"
        source.add_problem(("bound",), message)


def check_exact(source: Source, settings: Settings, point: Point) -> None:
    """Check that the filters whose exact errors are requested are linear, and so is the scenario."""
    for i, label in enumerate(settings.exact):
        if label not in point.filters:
            continue  # `only` leaves it out
        tracker = point.filters[label]
        assume = point.assumed.get(label)
        with plugin_code(tracker, point.scenario, assume):
            # Neither the seed nor the number of runs matters.
            one_run = BlockTask(
                scenario=point.scenario,
                filter=tracker,
                seed=0,
                index=0,
                width=1,
                runs_used=1,
                assume=assume,
            )
            why = why_not_exact(one_run)
        if why is not None:
            source.add_problem(("exact", i), f"{label} has no exact errors: {why}")


def exact_label(label: str) -> str:
    """Label the exact errors of a filter in tables and figures."""
    return f"{label}, exact"


def why_not_controlled(measure: Measure, exact_labels: Collection[str]) -> str:
    """Explain why a measure ``controlled(...)`` has no exact value to correct by; empty if it has.

    ``exact_labels`` are the filters of the key `exact`.
    """
    has_exact_value = measure.other in exact_labels and is_exact(measure)
    if measure.relation != "controlled" or has_exact_value:
        return ""
    message = f"'{measure}' needs a filter of `exact` and a mean of squares"
    return f"{message}, such as rms(rmse) or anees"
