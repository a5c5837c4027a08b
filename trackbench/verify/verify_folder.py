"""Check that a stored results folder is reproduced, byte for byte.

The first runs are recomputed, and tables, pairs and verdicts are made again from the stored runs. With
all runs, or in a clone, which has digests in place of the runs, everything is recomputed. The core's
arithmetic has equal bytes on every machine, so any difference is a change; its size per filter tells
rounding, of an older version or of a plugin that calls numpy's functions, from another algorithm.

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
from trackbench.report.folder_check import (
    IncompleteResultsError,
    changed_files,
    explain_content_errors,
    open_results,
)
from trackbench.report.tables_and_figures import Results
from trackbench.results.file_names import MANIFEST
from trackbench.results.manifest_facts import facts_of_config
from trackbench.results.points_json import POINTS_FILE, points_in, points_text, same_points
from trackbench.verify.compare_files import compare_all_runs, compare_first_runs
from trackbench.verify.compare_tables_and_verdicts import compare_derived
from trackbench.verify.compare_tuning import compare_tuning
from trackbench.verify.recompute import recompute


def verify(folder: Path, runs: int, allow_plugins: bool = False) -> list[str]:
    """Recompute the first ``runs`` runs of a results folder and return a line on each difference.

    The list is empty if all bytes are the same. If files are damaged, each has a line.
    Raises UserError if the folder has no results, or its config is invalid.
    """
    try:
        with explain_content_errors(folder):
            results = open_results(folder)
            options = api.Options(allow_plugins=allow_plugins)
            experiment = api.prepare(folder / "config.yaml", options)
            return changed_files(results) + list(_compare(results, experiment, runs))
    except IncompleteResultsError as error:
        return [str(line) for line in error.problems]


def _compare(results: Results, experiment: Experiment, runs: int) -> Iterator[str]:
    """Yield a line on each difference of a folder from what its config computes again.

    The first ``runs`` runs are recomputed, or all if these are not stored. Tables and verdicts are
    computed from the stored runs.
    """
    folder = results.folder
    all_runs = experiment.settings.runs
    if any(results.index_of(point) is None for point in results.points()):
        yield "summary.csv: is of other points than the config's grid"
        return
    # Facts of the manifest, which has no digest. Folders of older versions lack some.
    for key, value in facts_of_config(experiment).items():
        stored_value = results.manifest.get(key, value)
        if stored_value != value:
            yield f"{MANIFEST}: {key} is {stored_value!r}, and {value!r} by the config"
    # The points of the grid, as the config gives them now.
    points = points_text(experiment.points, folder)
    stored = folder / POINTS_FILE
    if stored.is_file() and not same_points(stored.read_text(encoding="utf-8"), points):
        yield f"{POINTS_FILE}: is not what the config makes of the points"
    with TemporaryDirectory() as temporary:
        target = Path(temporary, "derived")
        recomputed = Path(temporary, "recomputed")
        target.mkdir()
        recomputed.mkdir()
        # Outputs are written to ``target``, and the facts of the points are those of the config.
        results = replace(results, out=target, point_facts=tuple(points_in(points)))
        yield from compare_tuning(results, experiment, runs)
        has_runs = results.has_runs
        if has_runs:
            yield from compare_derived(results, folder)
            numbers_of_runs = set()
            for point in results.points():
                numbers_of_runs |= {len(values) for values in results.runs(point).values()}
            if numbers_of_runs - {all_runs}:
                # Do not recompute: a config with a wrong number of runs may take for ever.
                file = results.per_run_file
                yield f"{file}: has not as many runs of every metric as the config asks for"
                return
        tracks = (folder / "tracks.npz").is_file()
        if has_runs and runs < all_runs:
            computed = recompute(experiment, recomputed, runs, tracks)
            yield from compare_first_runs(results, computed)
            return
        computed = recompute(experiment, recomputed, all_runs, tracks)
        differences = list(compare_all_runs(results, computed))
        yield from differences
        if not has_runs and not differences:
            # Without stored runs, tables and verdicts follow from the computed ones.
            if (folder / "tuning.csv").is_file():
                shutil.copy(folder / "tuning.csv", recomputed)
            facts = {**results.manifest, **(computed.run_facts or {})}
            yield from compare_derived(replace(computed, out=target, run_facts=facts), folder)
