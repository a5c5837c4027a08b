"""How cost grows with runs, particles and steps: ``python -m benchmarks.growth``."""

import statistics
from typing import Any

from benchmarks.harness import Skip
from benchmarks.ours import make, ours, shipped, steps

ROUNDS = 7


def main() -> None:
    """Tables of CPU milliseconds and of nanoseconds per particle-step (or filter-step)."""
    merwe = shipped("merwe")
    for runs in (10, 100, 500, 1000, 2000):
        _row(f"runs {runs}, N = 10", merwe, make("filters", "pf", N=10), runs)
    for N in (10, 100, 1000, 10_000):
        _row(f"N = {N}, 200 runs", merwe, make("filters", "pf", N=N), 200)
    for T in (50, 100, 200, 400):
        scenario = shipped("merwe", last=T)
        _row(f"T = {T}, N = 100, 200 runs", scenario, make("filters", "pf", N=100), 200)
    for G in (0, 5, 10, 20, 40):
        _row(f"HDEPF, G = {G}, 200 runs", merwe, make("filters", "hdepf", N=10, G=G), 200)
    try:
        target = shipped("maneuver")
        for runs in (1, 10, 100, 1000):
            _row(f"Kalman filter, {runs} runs", target, make("filters", "kf"), runs, runs)
    except Skip as reason:
        print(f"not run: {reason}")


def _row(name: str, scenario: Any, tracker: Any, runs: int, width: int | None = None) -> None:
    entrant = ours(scenario, tracker, runs, whole=True, width=width)
    entrant()
    seconds = statistics.median(entrant().seconds for _ in range(ROUNDS))
    each = 1e9 * seconds / (runs * steps(scenario) * getattr(tracker, "N", 1))
    print(f"| {name} | {1e3 * seconds:.3g} | {each:.3g} |", flush=True)


if __name__ == "__main__":
    main()
