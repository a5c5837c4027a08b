"""What a results folder says of the run that made it: versions, seed, code, what failed."""

import platform
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import trackbench
from trackbench.experiment.computing.runner import Outcome
from trackbench.experiment.planning import arithmetic
from trackbench.experiment.planning.code import code_digest
from trackbench.experiment.reading.definition import Experiment
from trackbench.experiment.storing.environment import lock


def manifest_of(experiment: Experiment, outcome: Outcome) -> dict[str, Any]:
    """Content of ``manifest.json`` but for the format and the digests of the files."""
    packages = ["numpy", "scipy", "pandas", "matplotlib", "pydantic", "PyYAML"]
    filters = experiment.points[0].filters
    steps = [len(point.scenario.steps) - 1 for point in experiment.points]
    looped = [label for label, f in filters.items() if f.one_by_one]
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
        "arithmetic": {"own": arithmetic.own(), "numpy": arithmetic.numpys()},
        "failed": [
            {**experiment.points[i].values, "filter": label, "reason": why}
            for (i, label), why in outcome.failures.items()
        ],
        "blocks": {"computed": outcome.computed, "reused": outcome.reused},
        "wall_s": round(outcome.wall_s, 3),
    } | ({"one_by_one": looped} if looped else {})


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
