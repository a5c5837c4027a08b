"""Names of the files of a results folder, and the columns of its CSV files.

Git keeps the files that every machine writes again byte for byte and that are small. It has the digests
of the large ones (`DATA_FILES`). What one run adds on one machine stands apart (`is_of_one_run`): CPU
times, versions and dates in ``run/``, ``report.html``, and formats that an option asks for.
"""

from pathlib import Path

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
PER_STEP_ARRAYS = "per_step.npz"
"""File of the numbers per step, if the runs are very long."""
PER_RUN_ARRAYS = "per_run.npz"
"""File of the numbers per run, if there are very many runs."""
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


def is_of_one_run(name: str) -> bool:
    """Test whether a file depends on the machine or on options of the run, by its name in the folder."""
    is_optional = name.endswith((".png", ".pdf", ".tex")) or name in ("report.html", "tracks.npz")
    return is_optional or name.startswith("run/")


def is_in_git(name: str) -> bool:
    """Test whether git keeps a file, by its name in the folder.

    A results folder is complete without all other files.
    """
    return name not in DATA_FILES and not is_of_one_run(name)


def output_folder(group: str, shows_cpu_times: bool) -> str:
    """Return the folder of a table or figure within a results folder; ``group`` is tables or figures.

    One with CPU times is not reproducible, and has another folder than those that are.
    """
    return f"run/{group}" if shows_cpu_times else group


def file_of_runs(folder: Path) -> str:
    """Return the name of the file with the numbers per run: arrays if there are very many runs."""
    if (folder / PER_RUN_ARRAYS).is_file():
        return PER_RUN_ARRAYS
    return "per_run.csv"


def file_of_steps(folder: Path) -> str:
    """Return the name of the file with the numbers per step: arrays if the runs are very long."""
    if (folder / PER_STEP_ARRAYS).is_file():
        return PER_STEP_ARRAYS
    return "per_step.csv"
