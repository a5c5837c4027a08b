"""Write the files of a run into a results folder, each whole or not at all: CSV, tracks, config."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from trackbench.atomic_files import ensure_folder, note, write_bytes, write_text
from trackbench.config.experiment import Experiment
from trackbench.config.requested_contributions import requested_contributions
from trackbench.config.resolved_config import as_yaml, data_files, resolved
from trackbench.core.sums import total
from trackbench.csv_writer import write_csv
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.measure_cpu_times import Measured
from trackbench.evaluation.nees import sizes
from trackbench.evaluation.run_contributions import with_shares
from trackbench.execution.plan import Key
from trackbench.execution.run_plans import Outcome
from trackbench.results.arrivals import arrival_rows
from trackbench.results.counts_of_lost_runs import Losses
from trackbench.results.file_names import ARRIVAL_COLUMNS, ARRIVALS, PER_RUN_ARRAYS, PER_STEP_ARRAYS
from trackbench.results.links import within
from trackbench.results.manifest_facts import facts_of_run
from trackbench.results.points_json import POINTS_FILE, points_text
from trackbench.results.remove_earlier_files import remove_outputs
from trackbench.results.rows_and_columns import Runs
from trackbench.results.write_csv import CsvFiles
from trackbench.results.write_tracks import FigureTracks, TrackFile


@dataclass(frozen=True, kw_only=True)
class WrittenResults:
    """Losses, facts and numbers of a run whose files are written, for its report."""

    losses: dict[Key, Losses]
    """lost runs of each filter"""
    facts: dict[str, Any]
    """facts for the manifest"""
    run_values: tuple[Runs, ...]
    """numbers of per_run.csv at each point, as they are read from it"""


def write_results(
    folder: Path,
    experiment: Experiment,
    outcome: Outcome,
    tracks: bool,
    times: Mapping[Key, Measured] = MappingProxyType({}),
) -> WrittenResults:
    """Write the files of a run, from which all other files are made, in place of earlier runs' files.

    ``outcome`` has the filters' results. With ``tracks`` the tracks of all runs are written. ``times``
    are measured CPU times of filters, by grid point and label. The caller writes the manifest after all
    other files.
    """
    # Step 1: config, published numbers and data files.
    published = experiment.published.files
    inputs = {"config.yaml"}
    inputs.update(f"published/{name}" for name in published)
    remove_outputs(folder, keep=inputs)  # the run may read these; they are replaced whole
    write_text(folder / "config.yaml", as_yaml(resolved(experiment, folder)))
    for name, text in published.items():
        write_text(ensure_folder(within(folder, "published")) / name, text)
    write_text(folder / POINTS_FILE, points_text(experiment.points, folder))
    for name, path in data_files(experiment, folder).items():
        if path.resolve() != (folder / name).resolve():
            write_bytes(folder / name, path.read_bytes())
        elif path.is_file():  # not so a pattern of names
            note(folder / name)  # it stays, and its digest is part of the manifest
    # Step 2: the numbers and tracks of each filter at each point.
    track_files: dict[str, TrackFile] = {"shown.npz": FigureTracks(experiment)}
    if tracks:
        track_files["tracks.npz"] = TrackFile(experiment)
    ensure_folder(within(folder, "run"))
    losses: dict[Key, Losses] = {}
    requested = requested_contributions(experiment)
    # By filter, as the task of its first block, and by the number of a block. Several points may share a
    # filter.
    cpu_s: dict[BlockTask, dict[int, float]] = {}
    with ExitStack() as files:
        csv_files = CsvFiles(files, folder, experiment)
        for key, outcome_result in outcome.results():
            point, label = key
            scenario = experiment.points[point].scenario
            steps = scenario.steps.tolist()
            # Add each run's share in the requested measures; drop the series that only they need. The
            # key `medians` lists those that stay: their medians over the runs are written.
            shares = requested.measures_of_filter(label, steps)
            result = with_shares(outcome_result, shares, scenario.windows, steps, sizes(scenario))
            run_series = {
                name: rows
                for name, rows in result.run_series.items()
                if name in experiment.settings.medians
            }
            result = result._replace(run_series=run_series, measured=times.get(key))
            losses[key] = Losses.from_result(result)
            # A result has a timing for each block.
            tasks = outcome.plan.tasks[key]
            cpu_s_of_blocks = cpu_s.setdefault(tasks[0].filtering_task, {})
            for task, timing in zip(tasks, result.timing, strict=True):
                cpu_s_of_blocks[task.index] = timing.cpu_s
            csv_files.add(key, result)
            for track_file in track_files.values():
                track_file.add(key, result)
        csv_files.add_numbers_without_runs()
    if csv_files.run_arrays is not None:
        csv_files.run_arrays.write(folder / PER_RUN_ARRAYS)
    if csv_files.step_arrays is not None:
        csv_files.step_arrays.write(folder / PER_STEP_ARRAYS)
    for name, track_file in track_files.items():
        track_file.write(folder / name)
    # Step 3: the arrivals of late measurements, and the facts of the run.
    if any(point.scenario.longest_delay for point in experiment.points):
        columns = [*experiment.settings.grid, *ARRIVAL_COLUMNS]
        write_csv(folder / ARRIVALS, columns, arrival_rows(experiment, outcome))
    facts = facts_of_run(experiment, outcome)
    times_of_blocks: list[float] = []
    for cpu_s_of_blocks in cpu_s.values():
        times_of_blocks += cpu_s_of_blocks.values()
    facts["cpu_s"] = round(float(total(np.array(times_of_blocks))), 3)
    return WrittenResults(losses=losses, facts=facts, run_values=tuple(csv_files.run_values))
