"""W9: a table of fifty filters: every pair of them is compared for every column."""

import tempfile
import time
from pathlib import Path

from benchmarks.harness import Entrant, Limit, Outcome, Workload
from trackbench import api
from trackbench.report.tables_and_figures import Results

FILTERS = 50
HEAD = """name: fifty
seed: 1
runs: 100
scenario:
  kind: tracking
  last: 20
  target: {kind: driven, motion: {kind: cwna, q: 1}, launch: {vx: 10}}
  sensor: {kind: position, sigma: 5}
  start: {kind: gaussian, sigma: [10, 3, 10, 3]}
tables:
  errors:
    kind: metrics
    title: Errors
    columns:
      Position: mean(rmse_position)
      Velocity: mean(rmse_velocity)
      Position, rms: rms(rmse_position)
      Velocity, rms: rms(rmse_velocity)
      NEES: mean(nees)
      NIS: mean(nis)
filters:
"""


def workloads() -> list[Workload]:
    """Fifty Kalman filters that assume fifty sizes of the noise, in a table of six columns.

    The time is that of the table with its best values marked, from files that are read already.
    """
    folder = Path(tempfile.mkdtemp(prefix="bench-"))
    lines = []
    for i in range(FILTERS):
        sigma = 2.0 + 0.2 * i
        lines.append(
            f"  KF {i}: {{kind: kf, assume: {{sensor: {{kind: position, sigma: {sigma:g}}}}}}}\n"
        )
    config = folder / "fifty.yaml"
    config.write_text(HEAD + "".join(lines))
    out = folder / "out"
    api.run(config, api.Options(out=out, formats=(), workers=1, times=False, quiet=True))
    return [
        Workload(
            "W9",
            f"The table of {FILTERS} filters and six columns, its best values marked",
            "table",
            {"table": _table_again(out)},
            limits=[Limit("table", 0.3)],
        )
    ]


def _table_again(folder: Path) -> Entrant:
    def entrant() -> Outcome:
        results = Results(folder)
        point = results.points()[0]
        results.runs(point)
        started = time.process_time()
        (table,) = results.tables.values()
        seconds = time.process_time() - started
        assert len(table.keys) == FILTERS
        return Outcome(seconds, 1.0)

    return entrant
