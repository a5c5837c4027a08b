"""Write the files of a run into a results folder, each whole or not at all; facts of its manifest."""

import hashlib
import platform
import re
import subprocess
import sys
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.resources import files
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

import trackbench
from trackbench.atomic_files import ensure_folder, note, within, write_bytes, write_text
from trackbench.config.dump import as_yaml, data_files, resolved
from trackbench.config.experiment import Experiment
from trackbench.config.requested_metrics import requested_contributions
from trackbench.core import compiled
from trackbench.core.sums import total
from trackbench.evaluation.block import BlockTask
from trackbench.evaluation.consistency_and_calibration import sizes
from trackbench.evaluation.error_series import LOST_BECAUSE, NOT_FINITE
from trackbench.evaluation.metric_expression import measured
from trackbench.evaluation.summary import FilterResult, with_shares
from trackbench.evaluation.timing import Measured
from trackbench.execution import code_digests
from trackbench.execution.code_digests import code_digest
from trackbench.execution.plan import Key
from trackbench.execution.runner import Outcome
from trackbench.results.csv_files import CsvFiles
from trackbench.results.folder_contents import remove_outputs
from trackbench.results.point_facts import POINTS_FILE, points_text
from trackbench.results.tracks import FigureTracks, TrackFile


class Losses(NamedTuple):
    """Number of runs of one filter, and of the lost ones by reason."""

    runs: int
    by_code: dict[float, int]
    has_distance: bool = True
    """whether the reference could be run, if there is one"""

    @classmethod
    def of(cls, result: FilterResult) -> "Losses":
        """Count the codes of the metric ``lost``."""
        codes = result.per_run["lost"]
        distances = [
            x for name, x in result.per_run.items() if measured(name).family[0].name == "rmsd"
        ]
        known = any(np.isfinite(x).any() for x in distances) or not distances or (codes > 0).all()
        by_code = {code: int((codes == code).sum()) for code in LOST_BECAUSE}
        return cls(len(codes), by_code, bool(known))

    @property
    def lost(self) -> int:
        """Runs lost for any reason."""
        return sum(self.by_code.values())

    @property
    def is_total(self) -> bool:
        """True if no run has finite estimates, so that the filter does not work here."""
        return self.by_code[NOT_FINITE] == self.runs

    def __str__(self) -> str:
        reasons = [f"{n} because {LOST_BECAUSE[code]}" for code, n in self.by_code.items() if n]
        return f"{self.lost} of {self.runs} runs lost, {', '.join(reasons)}"


def write_results(
    folder: Path,
    experiment: Experiment,
    outcome: Outcome,
    tracks: bool,
    times: Mapping[Key, Measured] = MappingProxyType({}),
) -> tuple[dict[Key, Losses], dict[str, Any]]:
    """Write the files of a run in place of what earlier runs left, from which all others are made.

    ``times`` are measured CPU times. Return the lost runs of each filter, and the facts for the
    manifest, which the caller writes after all other files.
    """
    published = experiment.published.files
    inputs = {"config.yaml", *(f"published/{name}" for name in published)}
    remove_outputs(folder, keep=inputs)  # the run may read these; they are replaced whole
    write_text(folder / "config.yaml", as_yaml(resolved(experiment, folder)))
    for name, text in published.items():
        write_text(ensure_folder(within(folder, "published")) / name, text)
    write_text(folder / POINTS_FILE, points_text(experiment.points, folder))
    for name, path in data_files(experiment, folder).items():
        if path.resolve() != (folder / name).resolve():
            write_bytes(folder / name, path.read_bytes())
        elif path.is_file():  # not so a pattern of names
            note(folder / name)
    track_files: dict[str, TrackFile] = {"shown.npz": FigureTracks(experiment)}
    if tracks:
        track_files["tracks.npz"] = TrackFile(experiment)
    ensure_folder(within(folder, "run"))
    losses, requested, settings = {}, requested_contributions(experiment), experiment.settings
    spent: dict[BlockTask, float] = {}  # several points may share a filtered block
    with ExitStack() as files:
        csv_files = CsvFiles(files, folder, experiment)
        for key, result in outcome.results():
            # Add each run's share in the requested measures; drop the series that only they need.
            scenario = experiment.points[key[0]].scenario
            steps, parts = scenario.steps.tolist(), sizes(scenario)
            shares = requested.of(key[1], steps)
            result = with_shares(result, shares, scenario.windows, steps, parts)
            series = {n: rows for n, rows in result.run_series.items() if n in settings.medians}
            result = result._replace(run_series=series, measured=times.get(key))
            losses[key] = Losses.of(result)
            passes = (task.filtering_key for task in outcome.plan.tasks[key])
            spent.update(zip(passes, (t.cpu_s for t in result.timing), strict=True))
            csv_files.add(key, result)
            for track_file in track_files.values():
                track_file.add(key, result)
        csv_files.add_numbers_without_runs()
    for name, track_file in track_files.items():
        track_file.write(folder / name)
    cpu_s = round(float(total(np.array([*spent.values()]))), 3)
    return losses, facts_of_run(experiment, outcome) | {"cpu_s": cpu_s}


_PIN = re.compile(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)(?! ;)", re.MULTILINE)
"""A package that every system installs: one that only some systems need has a marker behind a ``;``."""
_VERSION = re.compile(r"^Version: (\S+)$", re.MULTILINE)
_PROCESSOR = re.compile(r"^model name\s*: (.+)$", re.MULTILINE)
_PACKAGES = ("numpy", "scipy", "pandas", "matplotlib", "pydantic", "PyYAML")


def facts_of_run(experiment: Experiment, outcome: Outcome) -> dict[str, Any]:
    """Collect the content of both manifests but for the format and the digests of the files."""
    filters = experiment.points[0].filters
    steps = [len(point.scenario.steps) - 1 for point in experiment.points]
    recorded = all(point.scenario.recorded_runs is not None for point in experiment.points)
    fixed = [label for label, f in filters.items() if f.deterministic and recorded]
    looped = [label for label, f in filters.items() if f.loops_over_runs]
    return {
        "trackbench": trackbench.__version__,
        "commit": _commit(),
        "date": datetime.now(UTC).date().isoformat(),
        "experiment": experiment.settings.name,
        "seed": experiment.settings.seed,
        "runs": experiment.settings.runs,
        "steps": steps[0] if len(set(steps)) == 1 else steps,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        "processor": _processor(),
        "packages": {name: version(name) for name in _PACKAGES}
        | dict(chain.from_iterable(plugin.packages for plugin in experiment.plugins)),
        "lock": compare_lock(),
        "plugins": {Path(plugin.path).name: plugin.digest for plugin in experiment.plugins},
        "code": code_digest(),
        "arithmetic": {
            "own": code_digests.own_arithmetic(),
            "numpy": code_digests.numpy_arithmetic(),
            "compiled": compiled.kernels is not None,
        },
        "failed": [
            {**experiment.points[i].values, "filter": label, "reason": why}
            for (i, label), why in outcome.failures.items()
        ],
        "blocks": {"computed": outcome.computed, "reused": outcome.reused},
        "wall_s": round(outcome.wall_s, 3),
        **({"loops_over_runs": looped} if looped else {}),
        **({"deterministic": fixed} if fixed else {}),
    }


def lock_file() -> Path:
    """Locate the lock file: beside the code in a wheel, in requirements/ in a checkout."""
    package = Path(str(files("trackbench")))
    in_wheel = package / "requirements.txt"
    return in_wheel if in_wheel.is_file() else package.parent / "requirements" / "run.txt"


def compare_lock() -> dict[str, Any]:
    """Digest the lock file; find the packages that are installed in another version."""
    content = lock_file().read_bytes()
    pins = dict(_PIN.findall(content.decode()))
    installed = {name: _installed(name) for name in pins}
    other = {name: now for name, now in installed.items() if now not in (pins[name], None)}
    digest = hashlib.sha256(content).hexdigest()
    return {"file": "requirements/run.txt", "sha256": digest, "other": other}


def _installed(name: str) -> str | None:
    """Look up a package's version; None if it is not installed, as a tool of the build may be."""
    try:
        text = distribution(name).read_text("METADATA")
    except PackageNotFoundError:
        return None
    line = _VERSION.search(text or "")  # `version` would parse the whole text, thirty times
    return line.group(1) if line else version(name)


def _processor() -> str:
    """Name the processor; Python reports none on Linux."""
    with suppress(OSError):
        line = _PROCESSOR.search(Path("/proc/cpuinfo").read_text(encoding="utf-8"))
        return line.group(1) if line else platform.machine()
    return platform.processor()


def _commit() -> str | None:
    """Find the git commit of the package's own source, if it is a checkout.

    A repository around an installed package belongs to another program. In its own repository the
    package is the folder ``trackbench`` at the top, and the commit has its files.
    """
    package = Path(trackbench.__file__).parent
    try:
        words = ["rev-parse", "--show-prefix", "HEAD", "HEAD:./__init__.py"]
        command = ["git", "-C", str(package), *words]
        answer = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    prefix, commit, _ = answer.stdout.splitlines()
    return commit if prefix == f"{package.name}/" else None
