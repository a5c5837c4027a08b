"""What `trackbench list experiments` says of times, from results/; written by `make reproduce-tables`.

``experiments/times.csv`` goes where results/ does not: into the wheel. Two digits are kept, so that it
does not change with every run.
"""

import csv
import json
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent.parent
FILE = HERE / "experiments" / "times.csv"
HEADER = ["experiment", "cpu_s"]


def measured() -> dict[str, float]:
    """Seconds on one processor that the blocks of each shipped experiment took, with those of tuning."""
    names = sorted(path.stem for path in FILE.parent.glob("[!_]*.yaml"))
    manifests = {name: HERE / "results" / name / "manifest.json" for name in names}
    return {
        name: float(f"{json.loads(path.read_bytes())['cpu_s']:.2g}")
        for name, path in manifests.items()
        if path.is_file()
    }


def written() -> dict[str, float]:
    """What the file says."""
    with FILE.open(encoding="utf-8", newline="") as file:
        return {row["experiment"]: float(row["cpu_s"]) for row in csv.DictReader(file)}


def main() -> int:
    """Write the file anew."""
    with FILE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows((name, f"{seconds:g}") for name, seconds in measured().items())
    return 0


if __name__ == "__main__":
    sys.exit(main())
