"""W6: an interacting multiple model filter of two motions on the maneuvering target's track."""

from collections.abc import Callable
from importlib import import_module

import numpy as np

from benchmarks.harness import Bar, Entrant, Workload, timed
from benchmarks.ours import data, make, ours, shipped, steps
from benchmarks.w3_kalman import motion

RUNS, FEW = 50, 2
DENSITIES = (0.001, 0.5)  # m^2/s^3, quiet and turning
STAY = ((0.98, 0.02), (0.02, 0.98))


def workloads() -> list[Workload]:
    """Against filterpy's IMM of the same two motions, and loops that are compiled for them."""
    scenario = shipped("maneuver")
    motions = tuple(motion(density) for density in DENSITIES)
    tracker = make("filters", "imm", motions=motions, transition=STAY)
    seen, T = data(scenario, RUNS), steps(scenario)
    work = Workload(
        "W6",
        f"IMM of two motions, maneuvering target, {RUNS} runs x {T} steps",
        "filter-step",
        {
            "trackbench": ours(scenario, tracker, RUNS, width=RUNS),
            "trackbench with metrics": ours(scenario, tracker, RUNS, whole=True, width=RUNS),
        },
        bars=[
            Bar("filterpy", "trackbench", 1.0),
            Bar("JAX by hand", "trackbench", 1.0),
            Bar("numba", "trackbench", 1.0),
        ],
        truth=seen.truth[:, 1:],
        position=(0, 2),
    )

    def filterpy() -> Entrant:
        peer = import_module("benchmarks.peers.filterpy_")
        sampled = [m.sampled(scenario.T) for m in motions]
        models = [(s.F, s.Q) for s in sampled]
        mean, cov, R = seen.prior.mean, seen.prior.cov, scenario.model.sensor.R
        z = seen.measurements[..., :FEW]
        return timed(lambda: peer.imm(models, np.array(STAY), R, mean, cov, z), float(FEW * T))

    def compiled(module: str) -> Callable[[], Entrant]:
        def entrant() -> Entrant:
            peer = import_module(module)
            sampled = [m.sampled(scenario.T) for m in motions]
            F = np.array([s.F for s in sampled])
            Q = np.array([s.Q for s in sampled])
            mean, cov, R = seen.prior.mean, seen.prior.cov, scenario.model.sensor.R
            z = seen.measurements
            return timed(
                lambda: peer.imm_cv(F, Q, R, np.array(STAY), mean, cov, z), float(RUNS * T)
            )

        return entrant

    work.add("filterpy", filterpy)
    work.add("JAX by hand", compiled("benchmarks.peers.jax_"))
    work.add("numba", compiled("benchmarks.peers.numba_"))
    work.add("C", compiled("benchmarks.peers.c_"))
    return [work]
