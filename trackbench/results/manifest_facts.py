"""Facts of a run for its manifest: experiment, machine, failures, digests of code and arithmetic."""

import platform
import re
import sys
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import trackbench
from trackbench.config.experiment import Experiment, scenario_cautions
from trackbench.config.python_tables import without_folders
from trackbench.core import compiled
from trackbench.execution import arithmetic_digests
from trackbench.execution.code_digests import code_digest
from trackbench.execution.run_plans import Outcome
from trackbench.results.versions_and_commit import commit_of_source, compare_lock, package_versions

_PROCESSOR = re.compile(r"^model name\s*: (.+)$", re.MULTILINE)


def facts_of_run(experiment: Experiment, outcome: Outcome) -> dict[str, Any]:
    """Collect the facts of both manifests, but for the folder's format and the digests of the files.

    These are manifest.json, with what every machine computes again, and run/machine.json, with what
    belongs to this run alone, such as versions and dates.
    """
    config_facts = facts_of_config(experiment)
    packages = dict(package_versions())
    for plugin in experiment.plugins:
        packages.update(plugin.packages)
    failed = []
    for (i, label), reason in outcome.failures.items():
        failed.append({**experiment.points[i].values, "filter": label, "reason": reason})
    # Some facts of the config are named here, since the files have the facts in this order.
    facts: dict[str, Any] = {
        "trackbench": trackbench.__version__,
        "commit": commit_of_source(),
        "date": datetime.now(UTC).date().isoformat(),
        "experiment": config_facts["experiment"],
        "seed": config_facts["seed"],
        "runs": config_facts["runs"],
        "steps": config_facts["steps"],
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        "processor": _processor(),
        "packages": packages,
        "lock": compare_lock(),
        "plugins": {Path(plugin.path).name: plugin.digest for plugin in experiment.plugins},
        "code": code_digest(),
        "arithmetic": {
            "own": arithmetic_digests.own_arithmetic(),
            "numpy": arithmetic_digests.numpy_arithmetic(),
            "compiled": compiled.kernels is not None,
        },
        "failed": failed,
        "blocks": {"computed": outcome.computed, "reused": outcome.reused},
        "wall_s": round(outcome.wall_s, 3),
    }
    if experiment.runs_of_config is not None:  # an option such as --quick took fewer
        facts["experiment_runs"] = experiment.runs_of_config
    # Without notes the manifest has no such entry. Files of tables from Python have no folder in it.
    data_notes = [without_folders(text) for text in scenario_cautions(experiment.points)]
    if data_notes:
        facts["data_notes"] = data_notes
    return facts | config_facts


def facts_of_config(experiment: Experiment) -> dict[str, Any]:
    """Collect the facts of the manifest that follow from the config alone."""
    filters = experiment.points[0].filters  # every point has filters with these labels
    # Without the step of the initial state.
    steps = [len(point.scenario.steps) - 1 for point in experiment.points]
    facts: dict[str, Any] = {
        "experiment": experiment.settings.name,
        "seed": experiment.settings.seed,
        "runs": experiment.settings.runs,
        "steps": steps[0] if len(set(steps)) == 1 else steps,
    }
    looped = [label for label, tracker in filters.items() if tracker.loops_over_runs]
    if looped:
        facts["loops_over_runs"] = looped
    # A filter's numbers are free of chance if neither the filter nor the data are random.
    deterministic = [label for label, tracker in filters.items() if tracker.deterministic]
    is_recorded = all(point.scenario.recorded_runs is not None for point in experiment.points)
    if deterministic and is_recorded:
        facts["deterministic"] = deterministic
    return facts


def _processor() -> str:
    """Return the processor's name; Linux has it in a file, as Python reports none there."""
    with suppress(OSError):
        line = _PROCESSOR.search(Path("/proc/cpuinfo").read_text(encoding="utf-8"))
        if line is None:
            return platform.machine()
        return line.group(1)
    return platform.processor()
