"""Best filters, which a figure that compares several filters shows although they are not named."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from trackbench.report.findings.ranking import rankings

if TYPE_CHECKING:
    from trackbench.report.tables_and_figures import Results


def with_best_filters(results: "Results", labels: Sequence[str]) -> tuple[str, ...]:
    """Return the ``labels`` of a figure, and behind them the best filter of each scenario.

    If no filter is best in a scenario, it is the one with the best number.
    """
    shown = [*labels]
    for ranking in rankings(results):
        leader = ranking.best or next(iter(ranking.order), None)
        if leader is not None and leader.label not in shown:
            shown.append(leader.label)
    return tuple(dict.fromkeys(shown))
