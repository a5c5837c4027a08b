"""Record the CPU times of the last runs: `make record-times`.

Every run writes its times into ``results/NAME/run/``, which git ignores. The times that the docs quote
are those of one named machine. They stand in ``results/times/`` until this command replaces them: a
folder for each experiment that measures times, one for each suite, and ``README.md`` with the verdicts.
The seconds that `trackbench list experiments` shows stand in ``experiments/times.csv``.
"""

import csv
import shutil
import sys
from pathlib import Path

from trackbench.config import shipped_experiments
from trackbench.config.shipped_suites import suite_names
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.cpu_time_verdicts import time_verdicts
from trackbench.report.verdicts.verdict_tables import time_tables
from trackbench.results.file_names import TIMING

HERE = Path(__file__).resolve().parent.parent
RESULTS, RECORD = HERE / "results", HERE / "results" / "times"
SECONDS = HERE / "experiments" / "times.csv"
SUITE_SECONDS = HERE / "experiments" / "suites" / "times.csv"
HEADER = ["experiment", "cpu_s"]


def seconds() -> dict[str, float]:
    """Return the recorded seconds on one processor of each shipped experiment, tuning included."""
    with SECONDS.open(encoding="utf-8", newline="") as file:
        return {row["experiment"]: float(row["cpu_s"]) for row in csv.DictReader(file)}


def record() -> None:
    """Replace the record by the times in ``results/``; raises SystemExit unless all runs are there."""
    names = shipped_experiments.names()
    missing = [name for name in names if not (RESULTS / name / TIMING).is_file()]
    if missing:
        raise SystemExit(f"no times of {', '.join(missing)}: run `make reproduce` first")
    suites = suite_names()
    for name in suites:
        if not (RESULTS / name / "costs.csv").is_file():
            raise SystemExit(f"no times of the suite {name}: run `make suite` first")
    results = [Results(RESULTS / name) for name in names]
    shutil.rmtree(RECORD, ignore_errors=True)
    record_suite_times(suites)
    for one in filter(_has_measured, results):
        _copy(one.folder / "run", RECORD / one.folder.name)
    (RECORD / "README.md").write_text(_page(results), encoding="utf-8")
    with SECONDS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows((one.folder.name, f"{one.manifest['cpu_s']:.2g}") for one in results)


def record_suite_times(suites: list[str]) -> None:
    """Write the seconds of each suite's problems, which `trackbench suite --dry-run` shows.

    Of each problem there is a row for the suite's runs, and one for those of `--quick`. A row whose
    results are not there stays.
    """
    # Step 1: the rows by suite, problem and runs, with those of the results in place of older ones.
    with SUITE_SECONDS.open(encoding="utf-8", newline="") as file:
        seconds_of = {
            (r["suite"], r["problem"], int(r["runs"])): r["cpu_s"] for r in csv.DictReader(file)
        }
    for name in suites:
        # A single problem has a folder of its own: standard-linear-quick.
        of_parts = sorted(RESULTS.glob(f"{name}-*-quick"))
        for folder in (RESULTS / name, RESULTS / f"{name}-quick", *of_parts):
            for manifest in sorted(folder.glob("*/manifest.json")):
                facts = Results(manifest.parent).manifest
                seconds_of[name, manifest.parent.name, facts["runs"]] = f"{facts['cpu_s']:.2g}"
    # Step 2: write them.
    with SUITE_SECONDS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["suite", "problem", "runs", "cpu_s"])
        writer.writerows([*key, text] for key, text in sorted(seconds_of.items()))


def _has_measured(results: Results) -> bool:
    """Return whether a table, a figure or something published names CPU times."""
    return any(results.columns("timing")["repeats"])


def _copy(run: Path, to: Path) -> None:
    for path in run.rglob("*"):
        if path.suffix in (".csv", ".md", ".svg"):
            (to / path.relative_to(run)).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, to / path.relative_to(run))


def _page(results: list[Results]) -> str:
    run = results[0].manifest
    tables = time_tables(verdict for one in results for verdict in time_verdicts(one))
    versions = ", ".join(f"{name} {run['packages'][name]}" for name in ("numpy", "scipy"))
    head = (
        "# CPU times of one machine\n\n"
        f"Recorded on {run['date']} with `make record-times`: {run['processor']}, {run['platform']}, "
        f"Python {run['python']}, {versions}. Other machines write their own times to "
        "`results/NAME/run/`, and these files stay as they are."
    )
    return "\n\n".join([head, *(table.markdown().rstrip() for table in tables)]) + "\n"


if __name__ == "__main__":
    sys.exit(record())
