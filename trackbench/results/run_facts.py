"""Facts of a run for its manifest: versions, machine, commit, digests of code and packages."""

import hashlib
import platform
import re
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.resources import files
from pathlib import Path
from typing import Any

import trackbench
from trackbench.config.experiment import Experiment
from trackbench.core import compiled
from trackbench.execution import arithmetic_digests
from trackbench.execution.code_digests import code_digest
from trackbench.execution.run_plans import Outcome

_PIN = re.compile(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)(?! ;)", re.MULTILINE)
"""A package that every system installs: one that only some systems need has a marker behind a ``;``."""
_VERSION = re.compile(r"^Version: (\S+)$", re.MULTILINE)
_PROCESSOR = re.compile(r"^model name\s*: (.+)$", re.MULTILINE)
_PACKAGES = ("numpy", "scipy", "pandas", "matplotlib", "pydantic", "PyYAML")


@cache
def _package_versions() -> dict[str, str]:
    """Return the versions of the packages that results depend on."""
    return {name: version(name) for name in _PACKAGES}


def facts_of_run(experiment: Experiment, outcome: Outcome) -> dict[str, Any]:
    """Collect the facts of both manifests, but for the folder's format and the digests of the files.

    These are manifest.json, with what every machine computes again, and run/machine.json, with what
    belongs to this run alone, such as versions and dates.
    """
    config_facts = facts_of_config(experiment)
    packages = dict(_package_versions())
    for plugin in experiment.plugins:
        packages.update(plugin.packages)
    failed = []
    for (i, label), reason in outcome.failures.items():
        failed.append({**experiment.points[i].values, "filter": label, "reason": reason})
    # Some facts of the config are named here, since the files have the facts in this order.
    facts: dict[str, Any] = {
        "trackbench": trackbench.__version__,
        "commit": _commit(),
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


def lock_file() -> Path:
    """Locate the lock file: beside the code in a wheel, in requirements/ in a checkout."""
    package = Path(str(files("trackbench")))
    in_wheel = package / "requirements.txt"
    if in_wheel.is_file():
        return in_wheel
    return package.parent / "requirements" / "run.txt"


def compare_lock() -> dict[str, Any]:
    """Return the lock file's name and digest, and the packages installed in another version.

    The packages are under ``other``, the installed version by name. A package that is not installed is
    left out.
    """
    content = lock_file().read_bytes()
    pins = dict(_PIN.findall(content.decode()))  # version by name
    installed = {name: _installed_version(name) for name in pins}
    other = {name: now for name, now in installed.items() if now not in (pins[name], None)}
    digest = hashlib.sha256(content).hexdigest()
    return {"file": "requirements/run.txt", "sha256": digest, "other": other}


def _installed_version(name: str) -> str | None:
    """Return the version of the package ``name``; None if it is not installed.

    Tools that only build trackbench may be missing.
    """
    try:
        text = distribution(name).read_text("METADATA")
    except PackageNotFoundError:
        return None
    # `version` parses the whole text, which takes too long for thirty packages.
    line = _VERSION.search(text or "")
    if line is None:
        return version(name)
    return line.group(1)


def _processor() -> str:
    """Return the processor's name; Linux has it in a file, as Python reports none there."""
    with suppress(OSError):
        line = _PROCESSOR.search(Path("/proc/cpuinfo").read_text(encoding="utf-8"))
        if line is None:
            return platform.machine()
        return line.group(1)
    return platform.processor()


def _commit() -> str | None:
    """Find the git commit of the package's own source, if it is a checkout.

    A repository around an installed package belongs to another program. In its own repository the
    package is the folder ``trackbench`` at the top, and the commit has its files.
    """
    package = Path(trackbench.__file__).parent
    try:
        # git prints three lines: the folder's path in the repository, the commit, and the digest of the
        # file, which fails if the commit does not have the file.
        words = ["rev-parse", "--show-prefix", "HEAD", "HEAD:./__init__.py"]
        command = ["git", "-C", str(package), *words]
        answer = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    prefix, commit, _ = answer.stdout.splitlines()
    if prefix != f"{package.name}/":
        return None
    return commit
