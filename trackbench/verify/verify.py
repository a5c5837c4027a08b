"""Does a stored results folder come out again?

Its first runs are computed again, and everything else is made again from the stored runs: summaries,
tables, pairs and verdicts. What a folder's files give is one of three: the same bytes; the same but for
the rounding of another processor or library; or something that rounding cannot explain.

Rounding is told from a change filter by filter (`rounding.py`). Where a filter draws and so amplifies
the last bit, only a change of its means over the runs that are computed again can be found: with 20 runs
one of two standard deviations of the paired difference, with 200 one of half of that deviation.

Nobody can compute again how long a run took, and how a figure or report.html looks depends on the
versions of matplotlib and of this program: for those there are the manifest's digests.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from trackbench import api
from trackbench.report.open import (
    IncompleteResultsError,
    changed_files,
    open_results,
    explain_content_errors,
)
from trackbench.results.point_facts import POINTS_FILE, points_in, points_text, same_points
from trackbench.verify.compare import made_again
from trackbench.verify.findings import CHANGED, Finding, changed, verdict
from trackbench.verify.recompute import computed_again
from trackbench.verify.steps import follow_from_steps
from trackbench.verify.summaries import follow_from_runs
from trackbench.verify.tuning import tuning_again

__all__ = ["CHANGED", "Finding", "verdict", "verify"]


def verify(folder: Path, runs: int, allow_plugins: bool = False) -> list[Finding]:
    """What differs when so many runs are computed again; nothing if all bytes are the same.

    Raises UserError if it is no results folder, or its config is mistaken.
    """
    try:
        with explain_content_errors(folder):
            return list(_found(folder, runs, allow_plugins))
    except IncompleteResultsError as error:
        return [changed(str(line)) for line in error.problems]


def _found(folder: Path, runs: int, allow_plugins: bool) -> Iterator[Finding]:
    results = open_results(folder)
    yield from map(changed, changed_files(results))
    experiment = api.prepare(folder / "config.yaml", api.Options(allow_plugins=allow_plugins))
    places = [(point, results.index_of(point)) for point in results.points()]
    points = [(point, experiment.points[i]) for point, i in places if i is not None]
    if len(points) < len(places):
        yield changed("summary.csv: is of other points than the config's grid")
        return
    with TemporaryDirectory() as temporary:
        given = points_text(experiment.points, folder)
        stored = folder / POINTS_FILE
        if stored.is_file() and not same_points(stored.read_text(encoding="utf-8"), given):
            yield changed(f"{POINTS_FILE}: is not what the config makes of the points")
        results = replace(results, out=Path(temporary), point_facts=tuple(points_in(given)))
        yield from follow_from_runs(results, points)
        yield from follow_from_steps(results, points)
        yield from made_again(results)
        yield from tuning_again(results, experiment, runs)
        yield from computed_again(results, experiment, runs)
