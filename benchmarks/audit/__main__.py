"""Judge every adapter with every release: `make audit` replaces benchmarks/audit/results.csv.

Packages are those of the environment; `build/audit-releases/NAME==VERSION` has further releases.
Names of adapters on the command line restrict the run to these, and keep the rows of others.
"""

import csv
import json
import os
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent
ROOT = FOLDER.parent.parent
RESULTS = FOLDER / "results.csv"
RELEASES = ROOT / "build" / "audit-releases"
HEADER = [
    "package",
    "version",
    "filter",
    "good",
    "bad",
    "left out",
    "mean_off",
    "covariance_off",
    "nonlinear_off",
    "problems",
    "shown by",
    "first finding",
]
_TIMEOUT = 1800.0
_LONGEST = 160  # characters of a finding


def judge(adapter: Path, release: Path | None) -> list[dict[str, Any]]:
    """Return the rows of an adapter's filters with the package of the environment or of a folder."""
    package = adapter.stem.replace("_", "-")
    paths = [str(p) for p in (release, ROOT) if p]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.audit.judge", str(adapter)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        timeout=_TIMEOUT,
        check=False,
    )
    if done.returncode:
        sys.exit(f"{package}: {done.stderr.strip().splitlines()[-1]}")
    out = json.loads(done.stdout.splitlines()[-1])
    for row in out["rows"]:
        row["first finding"] = row["first finding"][:_LONGEST]
    return [{"package": package, "version": out["version"]} | row for row in out["rows"]]


def releases(adapter: Path) -> list[Path | None]:
    """Return the folders of an adapter's package, and None for that of the environment, if any."""
    package = adapter.stem.replace("_", "-")
    here: list[Path | None] = [None] if any(distributions(name=package)) else []
    return [*here, *sorted(RELEASES.glob(f"{package}==*"))]


def stored() -> list[dict[str, str]]:
    """Return the rows of results.csv."""
    if not RESULTS.is_file():
        return []
    with RESULTS.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def main() -> None:
    chosen = sys.argv[1:]
    rows: list[dict[str, Any]] = []
    for adapter in sorted((FOLDER / "adapters").glob("*.py")):
        if chosen and adapter.stem not in chosen:
            rows += [r for r in stored() if r["package"] == adapter.stem.replace("_", "-")]
            continue
        for release in releases(adapter):
            of_release = judge(adapter, release)
            faulty = sum(bool(row["shown by"]) for row in of_release)
            print(
                f"{adapter.stem} {of_release[0]['version']}: {len(of_release)} filters, {faulty} bad"
            )
            rows += [row for row in of_release if row not in rows]
    with RESULTS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, HEADER, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
