"""W2: bootstrap and regularized particle filters of a banana-shaped posterior, N = 10000, 100 scans."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from benchmarks.floors import floor
from benchmarks.harness import Bar, Entrant, Workload, timed
from benchmarks.ours import data, make, ours, shipped, steps
from benchmarks.w1_merwe import COMPILED
from trackbench.core.random_streams import block_stream
from trackbench.filters.bootstrap_pf import PF

RUNS, N = 6, 10_000
FEW = 2  # runs that a loop over runs is timed on
POSITION = (0, 2)


def workloads() -> list[Workload]:
    """PF against the peers and the floor, RPF against the floor."""
    return [_bootstrap(), _regularized()]


class _Sampled:
    """A prior that gives samples and moments only, no weighted draws of its tails."""

    def __init__(self, prior: Any) -> None:
        self.sample, self.mean, self.cov = prior.sample, prior.mean, prior.cov


@dataclass(frozen=True, kw_only=True)
class _FromSamples(PF):
    """Our bootstrap filter from samples of the prior without weights, as the peers start."""

    def init(self, model: Any, prior: Any, rng: Any) -> Any:
        """Draw the first particles."""
        return super().init(model, _Sampled(prior), rng)


def _bootstrap() -> Workload:
    scenario, tracker = shipped("banana"), _FromSamples(N=N)
    seen, model, T = data(scenario, RUNS), scenario.model, steps(scenario)
    z, times = seen.measurements, scenario.times
    start = seen.prior.sample(block_stream(1, 0), N)
    clouds = [start[:, m] for m in range(FEW)]
    F, Q, R = model.motion.F, model.motion.Q, model.sensor.R
    work = Workload(
        "W2 PF",
        f"Bootstrap filter, banana, N = {N}, {RUNS} runs x {T} steps",
        "particle-step",
        {
            "trackbench": ours(scenario, tracker, RUNS),
            "trackbench with metrics": ours(scenario, tracker, RUNS, whole=True),
            "floor": floor(N, RUNS, T, normals=4),
            "floor with our normals": floor(N, RUNS, T, normals=4, own=True),
        },
        bars=[
            Bar("trackbench", "floor", 2.0, at_most=True),
            Bar("trackbench with metrics", "floor", 2.0, at_most=True),
            Bar("Stone Soup", "trackbench", 5.0),
            Bar("filterpy", "trackbench", 5.0),
            Bar("particles", "trackbench", 1.0),
            Bar("JAX by hand", "trackbench", 1.0),
            Bar("numba", "trackbench", 1.0),
            Bar("trackbench", "C", 1.5, at_most=True),
        ],
        truth=seen.truth[:, 1:],
        position=POSITION,
    )
    units = float(FEW * N * T)

    def stonesoup() -> Entrant:
        peer = import_module("benchmarks.peers.stonesoup_")
        return timed(lambda: peer.banana_pf(scenario.target.motion.q, R, clouds, z, times), units)

    def filterpy() -> Entrant:
        peer = import_module("benchmarks.peers.filterpy_")
        return timed(lambda: peer.banana_pf(F, Q, R, clouds, z), units)

    def particles() -> Entrant:
        peer = import_module("benchmarks.peers.particles_")
        return timed(lambda: peer.banana_pf(F, Q, R, clouds, z), units)

    def compiled(module: str) -> Callable[[], Entrant]:
        def load() -> Entrant:
            peer = import_module(f"benchmarks.peers.{module}")
            return timed(lambda: peer.banana_pf(F, Q, R, start, z), float(RUNS * N * T))

        return load

    work.add("Stone Soup", stonesoup)
    work.add("filterpy", filterpy)
    work.add("particles", particles)
    for name, module in COMPILED.items():
        work.add(name, compiled(module))
    return work


def _regularized() -> Workload:
    scenario, tracker = shipped("banana"), make("filters", "rpf", N=N)
    T = steps(scenario)
    return Workload(
        "W2 RPF",
        f"Regularized particle filter, banana, N = {N}, {RUNS} runs x {T} steps",
        "particle-step",
        {
            "trackbench": ours(scenario, tracker, RUNS),
            "trackbench with metrics": ours(scenario, tracker, RUNS, whole=True),
            "floor": floor(N, RUNS, T, normals=8, uniforms=2),
            "floor with our normals": floor(N, RUNS, T, normals=8, uniforms=2, own=True),
        },
        bars=[
            Bar("trackbench", "floor", 1.7, at_most=True),
            Bar("trackbench with metrics", "floor", 1.7, at_most=True),
        ],
        truth=data(scenario, RUNS).truth[:, 1:],
        position=POSITION,
    )
