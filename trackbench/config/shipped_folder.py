"""Folder of the shipped experiments, their data and the suites, in a wheel or a checkout."""

from importlib import resources
from pathlib import Path

TIMES = "times.csv"
SUITES = "suites"


def folder() -> Path:
    """Find the folder that holds the folders of the shipped experiments, the data and the suites."""
    package = Path(str(resources.files("trackbench")))
    in_package = package / "experiments"
    if in_package.is_dir():
        return in_package
    return package.parent / "experiments"
