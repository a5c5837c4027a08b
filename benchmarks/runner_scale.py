"""Time and memory of the runner as the number of runs grows: it must be linear, and flat.

Runs the bootstrap filter with N = 10 on Merwe's model (T = 50) through the command line, with 2 000,
20 000 and 200 000 runs, and prints wall time and the largest resident memory of the program and of
any of its workers. Needs /proc.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

CONFIG = """
name: scale
seed: 1
scenario:
  {kind: tracking, first: 1, last: 50, target: {kind: driven, motion: sine-gamma},
   sensor: square-then-line, start: known}
filters:
  PF: {kind: pf, N: 10}
"""


RUNS = (2_000, 20_000, 200_000)


def descendants(pid: int) -> list[int]:
    """Every process below ``pid``."""
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            found += [child, *descendants(child)]
    return found


def peak_mb(pid: int) -> float:
    """Largest resident memory so far, MB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1024
    return 0.0


def measured(folder: Path, runs: int) -> tuple[float, float, float]:
    """Wall time, s; peak memory of the program and of its largest worker, MB."""
    command = [sys.executable, "-m", "trackbench", "run", "scale.yaml", "--runs", str(runs)]
    environment = {**os.environ, "TRACKBENCH_CACHE": str(folder / f"cache{runs}")}
    started = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    own = workers = 0.0
    while process.poll() is None:
        try:
            own = max(own, peak_mb(process.pid))
            workers = max([workers, *(peak_mb(pid) for pid in descendants(process.pid))])
        except OSError:
            pass  # a process that ended while we looked
        time.sleep(0.05)
    if process.returncode:
        raise SystemExit(f"the run of {runs} ended with {process.returncode}")
    return time.perf_counter() - started, own, workers


def main() -> None:
    """Print a line per number of runs."""
    print(f"{'runs':>8} {'wall s':>8} {'us per run':>11} {'program MB':>11} {'worker MB':>10}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scale.yaml").write_text(CONFIG)
        for runs in RUNS:
            wall, own, workers = measured(folder, runs)
            per_run = 1e6 * wall / runs
            print(f"{runs:>8} {wall:>8.1f} {per_run:>11.1f} {own:>11.0f} {workers:>10.0f}")


if __name__ == "__main__":
    main()
