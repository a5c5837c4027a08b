"""W4: the unscented particle filter on the scalar model of the hdepf paper, N = 10."""

from collections.abc import Callable
from importlib import import_module

from benchmarks.floors import floor
from benchmarks.harness import Bar, Entrant, Workload, timed
from benchmarks.ours import data, make, numbers, ours, shipped, steps
from benchmarks.w1_merwe import COMPILED

RUNS, N = 200, 10
FEW = 10  # runs that an entrant with a loop over runs is timed on


def workloads() -> list[Workload]:
    """Against the same code one run at a time, and a filterpy UKF per particle."""
    scenario, tracker = shipped("merwe"), make("filters", "upf", N=N)
    seen = data(scenario, RUNS)
    T = steps(scenario)
    work = Workload(
        "W4",
        f"Unscented particle filter, Merwe model, N = {N}, {RUNS} runs x {T} steps",
        "particle-step",
        {
            "trackbench": ours(scenario, tracker, RUNS),
            "trackbench with metrics": ours(scenario, tracker, RUNS, whole=True),
            "floor": floor(N, RUNS, T, normals=1),
            "trackbench, one run at a time": ours(scenario, tracker, FEW, width=1),
        },
        bars=[
            Bar(name, "trackbench", 1.0)
            for name in ("filterpy, a UKF of three points per particle", "JAX by hand", "numba")
        ],
        truth=seen.truth[:, 1:],
    )

    def filterpy() -> Entrant:
        peer = import_module("benchmarks.peers.filterpy_")
        few = seen.measurements[..., :FEW]
        return timed(lambda: peer.merwe_upf(numbers(scenario), few, N), float(FEW * N * T))

    def compiled(module: str) -> Callable[[], Entrant]:
        def load() -> Entrant:
            peer, z = import_module(f"benchmarks.peers.{module}"), seen.measurements
            return timed(lambda: peer.merwe_upf(numbers(scenario), z, N), float(RUNS * N * T))

        return load

    work.add("filterpy, a UKF of three points per particle", filterpy)
    for name, module in COMPILED.items():
        work.add(name, compiled(module))
    return [work]
