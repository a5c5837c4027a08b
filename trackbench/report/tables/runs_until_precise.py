"""Table kind `precision`: how many runs each filter needed until its numbers were as exact as asked."""

from dataclasses import dataclass

from trackbench.evaluation.result_over_all_runs import FilterResult
from trackbench.execution.stop_when_precise import (
    PrecisionCheck,
    PrecisionTarget,
    check_precision,
    checkpoints,
    precise_after,
)
from trackbench.field_types import Digits
from trackbench.registry import register
from trackbench.report.kinds import TableKind
from trackbench.report.table import Cell, Table
from trackbench.report.tables_and_figures import Results
from trackbench.statistics.sample_statistics import Estimate


@register("tables", "precision")
@dataclass(frozen=True, kw_only=True)
class Precision(TableKind):
    """A row per filter and number of `until`: its value, and after how many runs it was exact enough.

    The runs are those of the second of two looks in a row that succeeded; "no" where there were none.
    """

    digits: Digits = 4
    """significant digits of the values"""

    def table(self, results: Results) -> Table:
        """Check every number of `until` at each number of runs after which the experiment checked it.

        `until` has the standard error that the config asks of each number, such as ``1%``.
        """
        config = results.config
        until = config.get("until", {})
        targets = [PrecisionTarget.read(metric, error) for metric, error in until.items()]
        stops = list(checkpoints(config["min_runs"], config["runs"]))
        heads = [*results.grid_heads, "Filter", "Number", "Standard error wanted", "Enough after"]
        table = Table(self.title, heads, ["Value"], self.digits)
        for point in results.points():
            sizes = results.facts(point).sizes
            for label in results.filters:
                values_by_metric = {}
                for (filter_label, metric), values in results.runs(point).items():
                    if filter_label == label:
                        values_by_metric[metric] = values
                if "lost" not in values_by_metric:  # the filter failed: it has no runs
                    continue
                # The check needs only the values per run of a filter's result.
                result = FilterResult(
                    per_run=values_by_metric, steps={}, run_series={}, tracks=None, timing=[]
                )
                for target in targets:
                    # The number after each number of runs; the last check gives the cell.
                    checks: list[PrecisionCheck] = []
                    for runs in stops:
                        # Windows of steps matter only for sums per step, which the result lacks.
                        checks += check_precision([target], result, sizes, windows={}, runs=runs)
                    if not checks:  # the filter does not have the number
                        continue
                    row = checks[-1].row
                    cell = Cell(Estimate(row.value, row.stderr), runs=row.runs, lost=0)
                    enough_after = precise_after(stops, [check.enough for check in checks]) or "no"
                    keys = [*point.values(), label, target.metric, until[target.metric]]
                    table.add([*map(str, keys), str(enough_after)], [cell])
        return table
