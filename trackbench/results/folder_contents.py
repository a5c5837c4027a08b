"""Files of a results folder: their names, columns and digits, and which of them the next run removes.

Git keeps the files that every machine writes again byte for byte and that are small. It has the digests
of the large ones (`DATA_FILES`). What one run adds on one machine stands apart (`is_of_one_run`): CPU
times, versions and dates in ``run/``, ``report.html``, and formats that an option asks for.
"""

import json
import re
from collections.abc import Collection, Iterator
from contextlib import suppress
from itertools import product
from pathlib import Path, PurePosixPath

from trackbench.atomic_files import remove
from trackbench.errors import UserError
from trackbench.field_types import require_regular_file
from trackbench.yaml_source import read

FORMAT = 3
"""Number of the folder's format: it grows when older code would misread a folder."""
MANIFEST = "manifest.json"
"""Facts and digests of the results."""
MACHINE = "run/machine.json"
"""Facts and digests of the one run that wrote the results."""
TIMING = "run/timing.csv"
TIME_VERDICTS = "run/time_verdicts.csv"
DATA_FILES = ("per_run.csv", "per_run.npz", "per_step.csv", "per_step.npz", "shown.npz")
"""Large files, of which git keeps the digests.

The arrays are in place of the rows if there are very many runs, or very long ones.
"""
ARRIVALS = "arrivals.csv"
"""Steps at which measurements arrive, of a scenario with delays."""
RUN_FILES = (*DATA_FILES, "summary.csv", "points.json", ARRIVALS, TIMING)
"""Files that a run writes. Tables, figures and verdicts are made from them and from the config."""
DERIVED_FILES = (
    "tracks.npz",
    "paired.csv",
    "comparison.csv",
    "comparison.md",
    "claims.csv",
    TIME_VERDICTS,
    "sweep.csv",
    "tuning.csv",
    "report.html",
)
"""Files that are made from the files of a run, beside tables and figures."""
_OLD_FILES = ("timing.csv", "time_verdicts.csv", *(f"{name}.xz" for name in RUN_FILES))
"""Files of older versions, which a run removes."""
COLUMNS = {
    "per_run.csv": ["filter", "run", "metric", "value"],
    "per_step.csv": ["filter", "step", "time", "metric", "value", "stderr", "runs"],
    "summary.csv": ["filter", "metric", "value", "stderr", "runs", "lost"],
    "timing.csv": [
        "filter",
        "runs",
        "cpu_s",
        "cpu_s_per_run",
        "stderr",
        "repeats",
        "likelihoods",
        "covariances",
    ],
}
"""Headings of the CSV files of a run, after those of the grid."""
ARRIVAL_COLUMNS = ["run", "sensor", "step", "arrived"]
"""Headings of `ARRIVALS`, after those of the grid."""
TABLE_FORMS = ("csv", "md", "tex")
FIGURE_FORMS = ("png", "svg", "pdf")
DEFAULT = "results"
"""Name of the table and of the figure of a config that asks for none."""
TRACK = "track"
"""Name of the figure that a config in the plane without tables and figures has beside it."""
_NAMED = {"tables": TABLE_FORMS, "figures": FIGURE_FORMS}
"""Folders of files that the config names, and their formats."""
_FORMS = {
    "tables": TABLE_FORMS,
    "figures": FIGURE_FORMS,
    "run/tables": TABLE_FORMS,
    "run/figures": FIGURE_FORMS,
    "published": ("csv",),
}
"""Formats of the files in each folder."""
_PARTIAL = re.compile(r"\.(.+)\.[0-9]+\.part")
"""Name of a file that is being written: that of the whole file, and the process id."""
DIGITS = {"per_run.csv": 7, "per_step.csv": 6, "summary.csv": 7}
"""Significant digits of values and standard errors, far more than the errors justify."""
EXACT_DIGITS = 15
"""Significant digits in per_run.csv if a paper prints seven or more and nothing is random."""


def output_folder(group: str, shows_cpu_times: bool) -> str:
    """Return the folder of a table or figure within a results folder; ``group`` is tables or figures.

    One with CPU times is not reproducible, and has another folder than those that are.
    """
    return f"run/{group}" if shows_cpu_times else group


def is_of_one_run(name: str) -> bool:
    """Test whether a file depends on the machine or on options of the run, by its name in the folder."""
    is_optional = name.endswith((".png", ".pdf", ".tex")) or name in ("report.html", "tracks.npz")
    return is_optional or name.startswith("run/")


def is_in_git(name: str) -> bool:
    """Test whether git keeps a file, by its name in the folder.

    A results folder is complete without all other files.
    """
    return name not in DATA_FILES and not is_of_one_run(name)


def remove_outputs(folder: Path, keep: Collection[str]) -> None:
    """Remove the files that earlier runs wrote, the manifest last; files of the user stay.

    The manifest names the files of a complete run. The config names tables and figures of an interrupted
    run, whose manifest has only the data or is missing. ``keep`` are names of files that the next run
    reads.
    """
    names = {*RUN_FILES, *DERIVED_FILES, *_OLD_FILES, MACHINE}
    names.update(_named_by_manifests(folder))
    names.update(_named_by_config(folder))
    paths = [folder / name for name in names.difference(keep)]
    # Half-written files of a killed process: the caller has locked the folder.
    for inner in ("", "run", *_FORMS):
        for path in (folder / inner).glob(".*.part"):
            whole = _PARTIAL.fullmatch(path.name)
            if whole and _is_output(PurePosixPath(inner, whole[1])):
                paths.append(path)
    for path in (*paths, folder / MANIFEST):
        # A link inside the folder may lead to files of the user. The last parent is the folder itself.
        inner_folders = path.relative_to(folder).parents[:-1]
        if path.is_file() and not any((folder / inner).is_symlink() for inner in inner_folders):
            remove(path)


def _is_output(path: PurePosixPath) -> bool:
    """Test whether any version writes files of this name into a results folder."""
    known = (*RUN_FILES, *DERIVED_FILES, *_OLD_FILES, "config.yaml", MANIFEST, MACHINE)
    forms = _FORMS.get(path.parent.as_posix(), ())
    return str(path) in known or path.suffix.removeprefix(".") in forms


def _named_by_manifests(folder: Path) -> Iterator[str]:
    """Yield the names in the manifests that a run can have written.

    Other names are left out, as anybody may have edited a manifest.
    """
    for manifest in (MANIFEST, MACHINE):
        with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
            for name in json.loads(require_regular_file(folder / manifest).read_bytes())["files"]:
                if _is_output(PurePosixPath(name)):
                    yield name


def _named_by_config(folder: Path) -> Iterator[str]:
    """Yield names of the tables and figures that the config asks for."""
    with suppress(UserError):  # a missing or unreadable config names nothing
        config = read(folder / "config.yaml").data
        if not isinstance(config, dict):
            return
        for group, forms in _NAMED.items():
            exhibits = config.get(group)
            if not isinstance(exhibits, dict):
                continue
            # A name with a slash could lead out of the folder. Without tables or figures in the config a
            # run writes one with the name `DEFAULT`.
            safe = [name for name in (*exhibits, DEFAULT) if "/" not in str(name)]
            # Files of formats that an option asks for are in `run/`.
            for place, name, form in product(("", "run/"), safe, forms):
                yield f"{place}{group}/{name}.{form}"
