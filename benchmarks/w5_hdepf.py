"""W5: the hybrid differential evolution particle filter, N = 10, 20 generations."""

from benchmarks.floors import floor
from benchmarks.harness import Workload
from benchmarks.ours import data, make, ours, shipped, steps

RUNS, N, G = 200, 10, 20
FEW = 10


def workloads() -> list[Workload]:
    """No public implementation exists: against the floor, and the same code one run at a time.

    A generation needs four uniforms per particle (two partners, crossover, acceptance) and the
    exponential of the acceptance; a step needs a normal for the proposal.
    """
    scenario, tracker = shipped("merwe"), make("filters", "hdepf", N=N, G=G)
    T = steps(scenario)
    return [
        Workload(
            "W5",
            f"HDEPF, Merwe model, N = {N}, G = {G}, {RUNS} runs x {T} steps",
            "particle-step",
            {
                "trackbench": ours(scenario, tracker, RUNS),
                "trackbench with metrics": ours(scenario, tracker, RUNS, whole=True),
                "floor": floor(N, RUNS, T, normals=1, uniforms=4 * G, exps=G + 1),
                "trackbench, one run at a time": ours(scenario, tracker, FEW, width=1),
            },
            truth=data(scenario, RUNS).truth[:, 1:],
        )
    ]
