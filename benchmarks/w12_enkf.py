"""W12: ensemble Kalman filters of Lorenz-96 with 40 components, all measured (Sakov & Oke 2008)."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Bar, Entrant, Workload, timed
from benchmarks.ours import data, ours, steps
from trackbench.config.load import load

CONFIG = Path(__file__).parent.parent / "experiments" / "lorenz" / "lorenz96-40.yaml"
RUNS, LAST = 40, 60
FEW = 10  # runs that DAPPER, a loop over runs, is timed on
COMPILED = {"numba": "numba_", "C": "c_"}


def workloads() -> list[Workload]:
    """Perturbed measurements with 40 members, and the transform with 24 and rotations."""
    score = "scenario.score={steps: [1, null], errors: {state: [x0]}}"
    point = load(CONFIG, overrides=[f"scenario.last={LAST}", score]).points[0]
    perturbed = _workload("W12", point.scenario, point.filters["EnKF (N=40)"])
    for name, module in COMPILED.items():
        perturbed.add(name, _peer(module, point.scenario, point.filters["EnKF (N=40)"], RUNS))
    return [perturbed, _workload("W12 ETKF", point.scenario, point.filters["ETKF (N=24)"])]


def _workload(name: str, scenario: Any, tracker: Any) -> Workload:
    n, T = len(scenario.model.sensor.h), steps(scenario)
    form = "" if tracker.form == "perturbed" else ", transform with rotations"
    work = Workload(
        name,
        f"EnKF, Lorenz-96 of {n} components, N = {tracker.N}{form}, {RUNS} runs x {T} steps",
        "member-step",
        {
            "trackbench": ours(scenario, tracker, RUNS),
            "trackbench with metrics": ours(scenario, tracker, RUNS, whole=True),
            "trackbench, ten runs": ours(scenario, tracker, min(FEW, RUNS)),
        },
        bars=[Bar("DAPPER", "trackbench", 1.0)],
        truth=data(scenario, RUNS).truth[:, 1:],
        position=tuple(range(n)),
    )
    keys = {"form": tracker.form, "rotation": tracker.rotation}
    work.add("DAPPER", _peer("dapper_", scenario, tracker, FEW, **keys))
    return work


def _peer(
    module: str, scenario: Any, tracker: Any, runs: int, **keys: Any
) -> Callable[[], Entrant]:
    def load_peer() -> Entrant:
        peer = import_module(f"benchmarks.peers.{module}")
        seen = data(scenario, RUNS)
        sigma = np.sqrt(seen.prior.cov[0, 0])
        R = scenario.model.sensor.R
        numbers = np.array([sigma, R, scenario.T, tracker.inflation])
        mean = np.array(seen.prior.mean).reshape(len(seen.truth), -1)[:, 0]
        z = np.ascontiguousarray(seen.measurements[..., :runs])
        units = float(z.shape[2] * tracker.N * steps(scenario))
        return timed(lambda: peer.lorenz96_enkf(numbers, mean, z, tracker.N, **keys), units)

    return load_peer
