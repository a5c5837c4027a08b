"""W3: the Kalman filter of a constant-velocity target, 1700 samples, 50, 200 and 1000 runs."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks.harness import Bar, Entrant, Outcome, Skip, Workload, timed
from benchmarks.ours import data, make, ours, shipped, steps, with_assumptions
from benchmarks.w1_merwe import COMPILED
from trackbench.core.constant_matrix_cache import clear_caches

q = 0.01  # m^2/s^3
FEW = 2  # runs that a loop over runs is timed on
POSITION = (0, 2)


def motion(density: float) -> Any:
    """Continuous white noise acceleration, the motion that all packages have."""
    try:
        module = import_module("trackbench.models.motions.kinematic")
        return module.WhiteAcceleration(q=density)
    except ImportError as error:
        raise Skip("this version has no motions to choose from") from error


def anew(entrant: Entrant) -> Entrant:
    """With no gains remembered of an earlier round, as in a new process."""

    def forgetful() -> Outcome:
        clear_caches()
        return entrant()

    return forgetful


def workloads() -> list[Workload]:
    """Few runs and many."""
    return [_workload(50), _workload(200), _workload(1000)]


def _workload(runs: int) -> Workload:
    scenario, keys = with_assumptions(shipped("maneuver"), motion(q))
    tracker = make("filters", "kf", **keys)
    seen, T = data(scenario, runs), steps(scenario)
    z, mean, cov = seen.measurements, seen.prior.mean, seen.prior.cov
    sampled = motion(q).sampled(scenario.T)
    F, Q, R = sampled.F, sampled.Q, scenario.model.sensor.R
    work = Workload(
        f"W3 M={runs}",
        f"Kalman filter, constant velocity, {runs} runs in one block x {T} steps",
        "filter-step",
        {
            "trackbench": anew(ours(scenario, tracker, runs, width=runs)),
            "trackbench with metrics": anew(ours(scenario, tracker, runs, whole=True, width=runs)),
            "trackbench, a later block": ours(scenario, tracker, runs, width=runs),
        },
        truth=seen.truth[:, 1:],
        position=POSITION,
    )
    many = runs == 1000
    work.bars = [
        Bar("filterpy", "trackbench", 100.0 if many else 1.0),
        Bar("Stone Soup", "trackbench", 1.0),
        Bar("JAX by hand", "trackbench", 1.0),
        Bar("dynamax", "trackbench", 1.0),
        Bar("numba", "trackbench", 1.0),
    ]
    if runs >= 200:
        work.bars.append(Bar("trackbench", "C", 3.0, at_most=True))
    few, units = np.ascontiguousarray(z[..., :FEW]), float(FEW * T)

    def filterpy() -> Entrant:
        peer = import_module("benchmarks.peers.filterpy_")
        return timed(lambda: peer.kalman_cv(F, Q, R, mean, cov, few), units)

    def stonesoup() -> Entrant:
        peer = import_module("benchmarks.peers.stonesoup_")
        return timed(lambda: peer.kalman_cv(q, R, mean, cov, few, scenario.times), units)

    def compiled(module: str) -> Callable[[], Entrant]:
        def load() -> Entrant:
            peer = import_module(f"benchmarks.peers.{module}")
            return timed(lambda: peer.kalman_cv(F, Q, R, mean, cov, z), float(runs * T))

        return load

    work.add("filterpy", filterpy)
    work.add("Stone Soup", stonesoup)
    for name, module in ({"dynamax": "dynamax_"} | COMPILED).items():
        work.add(name, compiled(module))
    return work
