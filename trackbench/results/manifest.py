"""The lock file, `requirements/run.txt`, and how far the installed packages are those that it names."""

import hashlib
import platform
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.resources import files
from pathlib import Path
from typing import Any

import trackbench
from trackbench.config.experiment import Experiment
from trackbench.execution import machine_fingerprint
from trackbench.execution.code_digest import code_digest
from trackbench.execution.runner import Outcome

_PIN = re.compile(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)(?! ;)", re.MULTILINE)
"""A package that is installed everywhere: what only some systems need has a marker behind a ``;``."""

_VERSION = re.compile(r"^Version: (\S+)$", re.MULTILINE)


def lock_file() -> Path:
    """The lock file: beside the code in a wheel, the repository's own in a checkout."""
    home = Path(str(files("trackbench")))
    inside = home / "requirements.txt"
    return inside if inside.is_file() else home.parent / "requirements" / "run.txt"


def lock() -> dict[str, Any]:
    """The lock file's digest, and what is installed in another version than it names."""
    content = lock_file().read_bytes()
    pins = dict(_PIN.findall(content.decode()))
    found = {name: _installed(name) for name in pins}
    return {
        "file": "requirements/run.txt",
        "sha256": hashlib.sha256(content).hexdigest(),
        "other": {name: found[name] for name in pins if found[name] not in (pins[name], None)},
    }


def _installed(name: str) -> str | None:
    """None for what is not there: the tools that build the package need not stay."""
    try:
        text = distribution(name).read_text("METADATA")
    except PackageNotFoundError:
        return None
    found = _VERSION.search(text or "")  # `version` would parse all of the text, thirty times
    return found.group(1) if found else version(name)


def manifest_of(experiment: Experiment, outcome: Outcome) -> dict[str, Any]:
    """Content of ``manifest.json`` but for the format and the digests of the files."""
    packages = ["numpy", "scipy", "pandas", "matplotlib", "pydantic", "PyYAML"]
    filters = experiment.points[0].filters
    steps = [len(point.scenario.steps) - 1 for point in experiment.points]
    looped = [label for label, f in filters.items() if f.loops_over_runs]
    return {
        "trackbench": trackbench.__version__,
        "commit": _commit(),
        "experiment": experiment.settings.name,
        "seed": experiment.settings.seed,
        "runs": experiment.settings.runs,
        "steps": steps[0] if len(set(steps)) == 1 else steps,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        "packages": {name: version(name) for name in packages}
        | dict(package for plugin in experiment.plugins for package in plugin.packages),
        "lock": lock(),
        "plugins": {Path(plugin.path).name: plugin.digest for plugin in experiment.plugins},
        "code": code_digest(),
        "arithmetic": {"own": machine_fingerprint.own(), "numpy": machine_fingerprint.numpys()},
        "failed": [
            {**experiment.points[i].values, "filter": label, "reason": why}
            for (i, label), why in outcome.failures.items()
        ],
        "blocks": {"computed": outcome.computed, "reused": outcome.reused},
        "wall_s": round(outcome.wall_s, 3),
    } | ({"loops_over_runs": looped} if looped else {})


def _commit() -> str | None:
    """Return the git commit of the package's own source, if it is a checkout.

    A repository that the package is merely installed in is another program's: at the top of its own
    stands the folder ``trackbench``, and the commit has its files.
    """
    here = Path(trackbench.__file__).parent
    asked = ["--show-prefix", "HEAD", "HEAD:./__init__.py"]
    try:
        found = subprocess.run(
            ["git", "-C", str(here), "rev-parse", *asked],
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    prefix, commit, _ = found.stdout.splitlines()
    return commit if prefix == f"{here.name}/" else None
