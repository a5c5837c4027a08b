"""W1: the bootstrap filter on the scalar model of the hdepf paper, 200 runs of 50 steps."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from benchmarks.floors import floor
from benchmarks.harness import Bar, Entrant, Workload, timed
from benchmarks.ours import data, make, numbers, ours, shipped, steps
from trackbench.core.arrays import Array

RUNS = 200
MANY = 2000
SLOW = {10: 20, 100: 20, 1000: 10}  # runs that a loop per run is timed on
BARS = {  # at least so many times as long as we
    "particles": {10: 100.0, 100: 5.0, 1000: 5.0},
    "Stone Soup": {10: 20.0, 100: 20.0, 1000: 20.0},
    "filterpy": {10: 1.0, 100: 1.0, 1000: 1.0},
}
PEERS = {"particles": "particles_", "Stone Soup": "stonesoup_", "filterpy": "filterpy_"}
COMPILED = {"JAX by hand": "jax_", "numba": "numba_", "C": "c_"}  # these get all runs


def workloads() -> list[Workload]:
    """Three sizes of the cloud, each against the peers and the floor; N = 10 with many runs too."""
    return [_against_peers(N) for N in (10, 100, 1000)] + [_many_runs()]


def _against_peers(N: int) -> Workload:
    scenario, tracker = shipped("merwe"), make("filters", "pf", N=N)
    seen = data(scenario, RUNS)
    z, T = seen.measurements, steps(scenario)
    work = Workload(
        f"W1 N={N}",
        f"Bootstrap filter, Merwe model, N = {N}, {RUNS} runs x {T} steps",
        "particle-step",
        {
            "trackbench": ours(scenario, tracker, RUNS),
            "trackbench with metrics": ours(scenario, tracker, RUNS, whole=True),
            "floor": floor(N, RUNS, T, gammas=1),
            "floor with our gammas": floor(N, RUNS, T, gammas=1, own=True),
        },
        truth=seen.truth[:, 1:],
    )
    few = z[..., : SLOW[N]]
    work.add("numpy, a loop over runs", _peer("plain", scenario, few, N))
    for name, module in PEERS.items():
        work.add(name, _peer(module, scenario, few, N))
        work.bars.append(Bar(name, "trackbench", BARS[name][N]))
    _add_compiled(work, scenario, z, N)
    if N >= 100:
        work.bars.append(Bar("trackbench", "C", 1.5, at_most=True))
        work.bars += _floor_bars(1.6, "trackbench", "trackbench with metrics")
    return work


def _peer(module: str, scenario: Any, z: Array, N: int) -> Callable[[], Entrant]:
    def load() -> Entrant:
        found = import_module(f"benchmarks.peers.{module}")
        return timed(lambda: found.merwe_pf(numbers(scenario), z, N), float(z[0].size * N))

    return load


def _add_compiled(work: Workload, scenario: Any, z: Array, N: int) -> None:
    for name, module in COMPILED.items():
        work.add(name, _peer(module, scenario, z, N))
    work.bars += [Bar(name, "trackbench", 1.0) for name in ("JAX by hand", "numba")]


def _many_runs() -> Workload:
    scenario, tracker = shipped("merwe"), make("filters", "pf", N=10)
    work = Workload(
        "W1 many runs",
        f"Bootstrap filter, Merwe model, N = 10, {MANY} runs x {steps(scenario)} steps",
        "particle-step",
        {
            "trackbench": ours(scenario, tracker, MANY),
            "trackbench with metrics": ours(scenario, tracker, MANY, whole=True),
            "trackbench, block: 2000": ours(scenario, tracker, MANY, width=MANY),
            "floor": floor(10, MANY, steps(scenario), gammas=1),
            "floor with our gammas": floor(10, MANY, steps(scenario), gammas=1, own=True),
        },
        bars=_floor_bars(3.0, "trackbench", "trackbench with metrics", "trackbench, block: 2000"),
    )
    _add_compiled(work, scenario, data(scenario, MANY).measurements, 10)
    return work


def _floor_bars(factor: float, *ours: str) -> list[Bar]:
    """Against the floor of our own faster gammas, the strict one, and of numpy's."""
    floors = ("floor with our gammas", "floor")
    return [Bar(name, floor, factor, at_most=True) for floor in floors for name in ours]
