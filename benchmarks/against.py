"""What a change costs: this checkout against another one, `python -m benchmarks.against FOLDER W1 W3`.

Each workload's own entrants (those named trackbench) run in fresh processes that take turns, in this
checkout and in the other one, so that a busy minute of the machine hits both.
"""

import argparse
import importlib
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

HERE = Path.cwd()
WORKLOADS = ("w1_merwe", "w2_banana", "w3_kalman", "w4_upf", "w5_hdepf", "w6_imm")


def main() -> None:
    """A line per entrant: the median of the rounds' ratios, their quartiles, the ratio of the least."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.against", description=__doc__)
    parser.add_argument("folder", type=Path, help="the other checkout")
    parser.add_argument("workloads", nargs="*", metavar="W1", help="default: W1 to W6")
    parser.add_argument("--rounds", type=int, default=9, help="counted rounds (default 9)")
    parser.add_argument("--once", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    wanted = [name.lower() for name in options.workloads]
    modules = [m for m in WORKLOADS if not wanted or {m, m.partition("_")[0]} & set(wanted)]
    if options.once:
        print(json.dumps({k: v for name in modules for k, v in _seconds(name).items()}))
        return
    print("| workload | entrant | this / other | quartiles | of the least |\n|---|---|---|---|---|")
    for module in modules:
        rounds = [
            [_elsewhere(f, module) for f in (HERE, options.folder)] for _ in range(options.rounds)
        ]
        for name in rounds[0][0]:
            _report(name, [(here[name], other[name]) for here, other in rounds if name in other])


def _report(name: str, pairs: list[tuple[float, float]]) -> None:
    if len(pairs) > 1:
        ratios = [here / other for here, other in pairs]
        low, middle, high = statistics.quantiles(ratios, n=4)
        least = min(here for here, _ in pairs) / min(other for _, other in pairs)
        workload, _, entrant = name.partition(": ")
        print(f"| {workload} | {entrant} | {middle:.3f} | {low:.3f} to {high:.3f} | {least:.3f} |")


def _elsewhere(folder: Path, module: str) -> dict[str, float]:
    """Seconds by entrant in a fresh process with the packages of a checkout, this very file included."""
    code = Path(__file__).read_text(encoding="utf-8")
    command = [sys.executable, "-c", code, str(folder), module, "--once"]
    environment = os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    seconds: dict[str, float] = json.loads(done.stdout)
    return seconds


def _seconds(module: str) -> dict[str, float]:
    found = {}
    for work in importlib.import_module(f"benchmarks.{module}").workloads():
        for name, entrant in work.entrants.items():
            if name.startswith("trackbench"):
                entrant()
                found[f"{work.name}: {name}"] = min(entrant().seconds for _ in range(3))
    return found


if __name__ == "__main__":
    main()
