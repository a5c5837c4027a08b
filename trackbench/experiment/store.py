"""The files of a results folder, each written whole or not at all."""

import csv
import gzip
import hashlib
import io
import json
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import trackbench
from trackbench.evaluation.derived import sizes
from trackbench.evaluation.merge import FilterResult
from trackbench.evaluation.statistics import mean
from trackbench.evaluation.summary import (
    StepRow,
    bound_steps,
    bound_summary,
    step_rows,
    summary_rows,
)
from trackbench.experiment.config import Experiment
from trackbench.experiment.runner import Outcome

Row = Iterable[Any]

FORMAT = 1
"""Counts up when a results folder changes so that older code would misread it."""
RAW = ("per_run.csv", "per_step.csv", "summary.csv", "timing.csv", "shown.npz")
"""Files that only a run writes; the manifest has their digests."""


def write_results(folder: Path, experiment: Experiment, outcome: Outcome, tracks: bool) -> None:
    """Everything that follows from the results alone; tables and figures come from these files."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").unlink(missing_ok=True)  # written last: without it nothing is read
    paths = list(experiment.settings.grid)
    write_text(folder / "config.yaml", as_yaml(experiment.resolved))
    _write_published(folder / "published", experiment.published.files)
    frames = {
        "per_run.csv": (["filter", "run", "metric", "value"], _per_run),
        "per_step.csv": (
            ["filter", "step", "time", "metric", "value", "stderr", "runs"],
            _per_step,
        ),
        "summary.csv": (["filter", "metric", "value", "stderr", "runs", "lost"], _summary),
        "timing.csv": (["filter", "runs", "cpu_s", "cpu_s_per_run", "stderr"], _timing),
    }
    for name, (header, rows) in frames.items():
        every = [*_by_filter(experiment, outcome, rows), *_bounds(experiment, name)]
        write_csv(folder / name, paths + header, every)
    _write_tracks(folder / "shown.npz", experiment, outcome, only=experiment.shown_runs)
    if tracks:
        _write_tracks(folder / "tracks.npz", experiment, outcome, only=None)
    manifest = _manifest(experiment, outcome) | {"files": digests(folder)}
    write_text(folder / "manifest.json", json.dumps(manifest, indent=2) + "\n")


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of each file that only a run writes; of the content of one that was gzipped since."""
    found = {}
    for name in RAW:
        path, packed = folder / name, folder / f"{name}.gz"
        if path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        elif packed.is_file():
            found[name] = hashlib.sha256(gzip.decompress(packed.read_bytes())).hexdigest()
    return found


def as_yaml(data: Any) -> str:
    """Plain data as YAML in the order it is given."""
    return yaml.safe_dump(
        data, sort_keys=False, allow_unicode=True, default_flow_style=None, width=100
    )


def write_csv(path: Path, header: list[str], rows: Iterable[Row]) -> None:
    """A CSV with numbers in their shortest exact form."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    write_text(path, out.getvalue())


def write_text(path: Path, text: str) -> None:
    """Write a file atomically."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Temporary file, fsync, rename: the old file stands until the new one is complete."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _write_published(folder: Path, files: dict[str, str]) -> None:
    if files:
        folder.mkdir(exist_ok=True)
    for name, text in files.items():
        write_text(folder / name, text)


def _by_filter(experiment: Experiment, outcome: Outcome, rows: Any) -> Iterator[Row]:
    for (i, label), result in outcome.results.items():
        point = experiment.points[i]
        prefix = [*point.values.values(), label]
        for row in rows(result, point.scenario):
            yield [*prefix, *row]


def _bounds(experiment: Experiment, name: str) -> Iterator[Row]:
    """The scenario's own lower bounds, as if of one more filter."""
    label = experiment.settings.bound
    for point in experiment.points if label else []:
        scenario: Any = point.scenario
        prefix = [*point.values.values(), label]
        if name == "summary.csv":
            for summary in bound_summary(scenario.bounds(), scenario.windows):
                yield [*prefix, *summary]
        if name == "per_step.csv":
            for step in bound_steps(scenario.bounds()):
                yield [*prefix, *_timed(step, scenario)]


def _timed(row: StepRow, scenario: Any) -> Row:
    k, t = scenario.steps[row.position], scenario.times[row.position]
    return _plain([k, t, *row[1:]])


def _per_run(result: FilterResult, scenario: Any) -> Iterator[Row]:
    for metric, values in result.per_run.items():
        for run, value in enumerate(values.tolist()):
            yield run, metric, value


def _per_step(result: FilterResult, scenario: Any) -> Iterator[Row]:
    for row in step_rows(result, sizes(scenario)):
        yield _timed(row, scenario)


def _summary(result: FilterResult, scenario: Any) -> Iterator[Row]:
    for row in summary_rows(result, sizes(scenario), scenario.windows):
        yield _plain(row)


def _timing(result: FilterResult, scenario: Any) -> Iterator[Row]:
    runs = sum(t.runs for t in result.timing)
    cpu_s = sum(t.cpu_s for t in result.timing)
    per_run = mean(np.array([t.cpu_s / t.runs for t in result.timing]))
    yield _plain([runs, cpu_s, cpu_s / runs, per_run.stderr])


def _plain(row: Row) -> list[Any]:
    return [x.item() if isinstance(x, np.generic) else x for x in row]


def _write_tracks(path: Path, experiment: Experiment, outcome: Outcome, only: int | None) -> None:
    """``truth``, ``measurements``, ``mean/<filter>`` and, if kept, ``cov/<filter>``."""
    arrays: dict[str, Any] = {}
    for (i, label), result in outcome.results.items():
        if result.tracks is None:
            continue
        point = f"point{i}/" if len(experiment.points) > 1 else ""
        truth, seen, mean_, cov = result.tracks
        arrays[f"{point}steps"] = experiment.points[i].scenario.steps
        arrays[f"{point}times"] = experiment.points[i].scenario.times
        arrays[f"{point}truth"] = truth[..., :only]
        arrays[f"{point}measurements"] = seen[..., :only]
        arrays[f"{point}mean/{label}"] = mean_[..., :only]
        if cov is not None:
            arrays[f"{point}cov/{label}"] = cov[..., :only]
    if arrays:
        out = io.BytesIO()
        np.savez_compressed(out, **arrays)
        write_bytes(path, out.getvalue())


def _manifest(experiment: Experiment, outcome: Outcome) -> dict[str, Any]:
    packages = ["numpy", "scipy", "pandas", "matplotlib", "pydantic", "PyYAML"]
    return {
        "format": FORMAT,
        "trackbench": trackbench.__version__,
        "commit": _commit(),
        "experiment": experiment.settings.name,
        "seed": experiment.settings.seed,
        "runs": experiment.settings.runs,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        "packages": {name: version(name) for name in packages},
        "failed": {label: why for (_, label), why in outcome.failures.items()},
        "wall_s": round(outcome.wall_s, 3),
        "cpu_s": round(sum(t.cpu_s for r in outcome.results.values() for t in r.timing), 3),
    }


def _commit() -> str | None:
    """The git commit of the package's own source, if it is a checkout."""
    here = Path(trackbench.__file__).parent
    try:
        found = subprocess.run(
            ["git", "-C", str(here), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return found.stdout.strip()
