"""Check that a stored results folder is reproduced.

The first runs are recomputed, and tables, pairs and verdicts are made again from the stored runs. A
clone has digests in place of the runs: there all runs are recomputed. The verdict on a folder is one of
three: the same bytes, the same but for the rounding of another processor or library, or changed.

`compare.py` tells rounding from a change, filter by filter. For a filter that draws and so amplifies the
last bit, only a change of its means over the recomputed runs is detected: with 20 runs a change of two
standard deviations of the paired difference, with 200 runs of half of that deviation. Statistics over
all runs are compared only if all runs are recomputed.

CPU times cannot be recomputed, and figures and report.html depend on the versions of matplotlib and of
this program. The manifest's digests protect these.
"""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from trackbench import api
from trackbench.config.experiment import Experiment
from trackbench.report.open import (
    IncompleteResultsError,
    changed_files,
    explain_content_errors,
    open_results,
)
from trackbench.report.results import Results
from trackbench.results.point_facts import POINTS_FILE, points_in, points_text, same_points
from trackbench.verify.compare import (
    CHANGED,
    Finding,
    changed,
    compare_derived,
    compare_digests,
    verdict,
)
from trackbench.verify.recompute import compare_runs, drawing_filters, recompute
from trackbench.verify.tuning import compare_tuning

__all__ = ["CHANGED", "Finding", "verdict", "verify"]


def verify(folder: Path, runs: int, allow_plugins: bool = False) -> list[Finding]:
    """Recompute so many runs and return what differs; nothing if all bytes are the same.

    Raises UserError if the folder has no results, or its config is invalid.
    """
    try:
        with explain_content_errors(folder):
            results = open_results(folder)
            options = api.Options(allow_plugins=allow_plugins)
            findings = [changed(line) for line in changed_files(results)]
            experiment = api.prepare(folder / "config.yaml", options)
            return findings + list(_compare(results, experiment, runs))
    except IncompleteResultsError as error:
        return [changed(str(line)) for line in error.problems]


def _compare(results: Results, experiment: Experiment, runs: int) -> Iterator[Finding]:
    folder = results.folder
    if any(results.index_of(point) is None for point in results.points()):
        yield changed("summary.csv: is of other points than the config's grid")
        return
    points = points_text(experiment.points, folder)
    stored = folder / POINTS_FILE
    if stored.is_file() and not same_points(stored.read_text(encoding="utf-8"), points):
        yield changed(f"{POINTS_FILE}: is not what the config makes of the points")
    with TemporaryDirectory() as temporary:
        target, recomputed = Path(temporary, "made"), Path(temporary, "again")
        target.mkdir()
        recomputed.mkdir()
        results = replace(results, out=target, point_facts=tuple(points_in(points)))
        yield from compare_tuning(results, experiment, runs)
        if (folder / "per_run.csv").is_file():
            yield from compare_derived(results, folder)
            yield from _compare_first_runs(results, experiment, recomputed, runs)
            return
        again = recompute(experiment, recomputed, experiment.settings.runs, tracks=False)
        if (folder / "tuning.csv").is_file():
            shutil.copy(folder / "tuning.csv", recomputed)
        facts = {**results.manifest, **(again.run_facts or {})}
        again = replace(again, out=target, run_facts=facts)
        yield from compare_digests(results, again, drawing_filters(experiment))


def _compare_first_runs(
    results: Results, experiment: Experiment, folder: Path, runs: int
) -> Iterator[Finding]:
    numbers = {len(x) for point in results.points() for x in results.runs(point).values()}
    if numbers - {experiment.settings.runs}:
        # As many runs as the config asks for may take for ever.
        yield changed("per_run.csv: has not as many runs of every metric as the config asks for")
        return
    has_tracks = (results.folder / "tracks.npz").is_file()
    again = recompute(experiment, folder, min(runs, experiment.settings.runs), has_tracks)
    yield from compare_runs(results, again, experiment)
