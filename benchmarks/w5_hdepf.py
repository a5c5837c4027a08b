"""W5: the hybrid differential evolution particle filter, N = 10, 20 generations, few and many runs."""

from collections.abc import Callable
from importlib import import_module

from benchmarks.floors import floor
from benchmarks.harness import Bar, Entrant, Workload, timed
from benchmarks.ours import data, make, numbers, ours, shipped, steps

RUNS, N, G = (20, 200, 1000), 10, 20
FEW = 10
COMPILED = {"numba": "numba_", "C": "c_"}


def workloads() -> list[Workload]:
    """Few runs and many."""
    return [_workload(runs) for runs in RUNS]


def _workload(runs: int) -> Workload:
    """No public implementation exists: against scalar loops, and the same code one run at a time.

    A trial that took nothing from its mutant is its parent, which is true of 1 - CR of the trials. The
    loops compute no fitness for it. In the floor a generation takes four uniforms per particle (two
    partners, crossover, acceptance) and the exponential of the acceptance; a step takes a normal for the
    proposal.
    """
    scenario, tracker = shipped("merwe"), make("filters", "hdepf", N=N, G=G)
    T = steps(scenario)
    seen = data(scenario, runs)
    work = Workload(
        f"W5 M={runs}",
        f"HDEPF, Merwe model, N = {N}, G = {G}, {runs} runs x {T} steps",
        "particle-step",
        {
            "trackbench": ours(scenario, tracker, runs),
            "trackbench with metrics": ours(scenario, tracker, runs, whole=True),
            "floor": floor(N, runs, T, normals=1, uniforms=4 * G, exps=G + 1),
        },
        truth=seen.truth[:, 1:],
    )
    if runs == RUNS[0]:
        alone = ours(scenario, tracker, min(FEW, runs), width=1)
        work.entrants["trackbench, one run at a time"] = alone
    else:
        work.bars = [Bar("numba", "trackbench", 1.0), Bar("trackbench", "C", 3.0, at_most=True)]

    def compiled(module: str) -> Callable[[], Entrant]:
        def load() -> Entrant:
            peer = import_module(f"benchmarks.peers.{module}")
            model, z = numbers(scenario), seen.measurements
            return timed(lambda: peer.merwe_hdepf(model, tracker, z), float(runs * N * T))

        return load

    for name, module in COMPILED.items():
        work.add(name, compiled(module))
    return work
