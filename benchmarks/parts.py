"""Where a particle filter's step goes: ``python -m benchmarks.parts``, a table for docs/performance.md.

Each part is timed alone, on the arrays of a real step; the step as a whole is dearer than their sum,
because its arrays do not stay in the cache and its branches are not foreseen.
"""

import time
import timeit
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.harness import Skip
from benchmarks.ours import data, make, shipped
from trackbench.core import particle_weights, particles, resampling
from trackbench.core.random_streams import block_stream
from trackbench.core.regularization import jitter
from trackbench.evaluation.freed_memory import keep_freed_memory
from trackbench.models.likelihood import log_likelihood

CASES = (
    ("merwe", "pf", 10, 500),
    ("merwe", "pf", 10, 2000),
    ("merwe", "pf", 100, 327),
    ("merwe", "pf", 1000, 32),
    ("banana", "pf", 10_000, 3),
    ("banana", "rpf", 10_000, 3),
)
WARM = 5


def main() -> None:
    """Nanoseconds per particle-step of each part, least of twelve rounds."""
    keep_freed_memory()
    for scenario, kind, N, runs in CASES:
        try:
            found = parts(shipped(scenario), make("filters", kind, N=N), runs)
        except Skip as reason:
            print(f"{scenario} {kind}: not run: {reason}")
            continue
        row = ", ".join(f"{name} {cost:.2f}" for name, cost in found.items())
        print(f"{scenario} {kind}, N = {N}, {runs} runs: {row}", flush=True)


def parts(scenario: Any, tracker: Any, runs: int) -> dict[str, float]:
    """Cost of each part of the sixth step."""
    model, seen, rng = scenario.model, data(scenario, runs), block_stream(1, 0)
    steps = [int(k) for k in scenario.steps[1:]]
    state = tracker.init(model, seen.prior, rng)
    for t in range(WARM):
        state = tracker.step(model, state, seen.measurements[:, t], steps[t], rng)
    z, k, old = seen.measurements[:, WARM], steps[WARM], state.particles.x
    moved = model.motion.transition(old, k)
    x = moved.sample(rng)
    log_w = log_likelihood(model.sensor, z, x, k)
    w = particle_weights.normalize(log_w).w
    index = resampling.ancestors(w, rng)
    cloud = particles.Particles(x, w)
    cov = cloud.moments().cov
    jobs: dict[str, Callable[[], object]] = {
        "transition": lambda: model.motion.transition(old, k),
        "sample": lambda: moved.sample(rng),
        "log-likelihood": lambda: log_likelihood(model.sensor, z, x, k),
        "normalize": lambda: particle_weights.normalize(log_w),
        "ancestors": lambda: resampling.ancestors(w, rng),
        "select": lambda: resampling.select(x, index),
        "moments": cloud.moments,
    }
    if hasattr(tracker, "kernel"):
        jobs["jitter"] = lambda: jitter(x, cov, tracker.kernel, rng)
    jobs["whole step"] = lambda: tracker.step(model, state, z, k, rng)
    return {name: _cost(job) / (runs * tracker.N) for name, job in jobs.items()}


def _cost(job: Callable[[], object]) -> float:
    with np.errstate(all="ignore"):
        return 1e9 * min(timeit.repeat(job, number=5, repeat=12, timer=time.process_time)) / 5


if __name__ == "__main__":
    main()
