"""How cost grows with runs, particles and steps: ``python -m benchmarks.growth``."""

import statistics
from typing import Any

from benchmarks.harness import Skip
from benchmarks.ours import make, ours, shipped, steps

ROUNDS = 7


RUNS, SIZES = (10, 100, 500, 1000, 2000), (10, 100, 1000, 10_000)
LENGTHS, GENERATIONS = (50, 100, 200, 400), (0, 5, 10, 20, 40)
KALMAN_RUNS = (1, 10, 100, 1000)
MANY = 200


def main() -> None:
    """Print tables of CPU milliseconds and of nanoseconds per particle-step (or filter-step)."""
    merwe = shipped("merwe")
    for runs in RUNS:
        _row(f"runs {runs}, N = 10", merwe, make("filters", "pf", N=10), runs)
    for N in SIZES:
        _row(f"N = {N}, {MANY} runs", merwe, make("filters", "pf", N=N), MANY)
    for T in LENGTHS:
        scenario = shipped("merwe", last=T)
        _row(f"T = {T}, N = 100, {MANY} runs", scenario, make("filters", "pf", N=100), MANY)
    for G in GENERATIONS:
        _row(f"HDEPF, G = {G}, {MANY} runs", merwe, make("filters", "hdepf", N=10, G=G), MANY)
    try:
        target = shipped("maneuver")
        for runs in KALMAN_RUNS:
            _row(f"Kalman filter, {runs} runs", target, make("filters", "kf"), runs, runs)
    except Skip as reason:
        print(f"not run: {reason}")


def _row(name: str, scenario: Any, tracker: Any, runs: int, width: int | None = None) -> None:
    entrant = ours(scenario, tracker, runs, whole=True, width=width)
    entrant()
    seconds = statistics.median(entrant().seconds for _ in range(ROUNDS))
    each = 1e9 * seconds / (runs * steps(scenario) * tracker.particle_count)
    print(f"| {name} | {1e3 * seconds:.3g} | {each:.3g} |", flush=True)


if __name__ == "__main__":
    main()
