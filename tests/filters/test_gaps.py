"""A missing measurement is predicted over by every filter; without any, the motion alone is left."""

from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from tests.papers import banana, merwe
from trackbench.config.filter_requirements import meets_requirement
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.evaluation.run_filter import run_filter
from trackbench.evaluation.simulated_runs import simulate
from trackbench.models.motions.kinematic import WhiteAcceleration
from trackbench.registry import kinds

SCENARIO = merwe(T=6, R=0.1)
RUNS = 400
# A cloud bred towards high fitness is no sample of the prediction.
BRED = {"pfde", "hdepf"}
KINDS = [
    k
    for k, cls in kinds("filters").items()
    if cls.__module__.startswith("trackbench.")  # those of other tests may be registered
    and k not in ("grid-2d", "external")  # of two components; of a program's own
    and all(meets_requirement(SCENARIO, need) for need in getattr(cls, "requires", ()))
]


def track(kind: str, gaps: slice, runs: int = RUNS) -> FilterOutput:
    tracker = make_filter(kind, **({"nodes": 48} if kind == "grid" else {}))
    task = BlockTask(SCENARIO, tracker, 1, index=0, width=runs, runs_used=runs)
    data = simulate(SCENARIO, 1, 0, runs)
    seen = data.measurements.copy()
    seen[:, gaps] = np.nan
    with np.errstate(all="ignore"):
        return run_filter(task, data._replace(measurements=seen), runs)


@pytest.mark.parametrize("kind", KINDS)
def test_without_any_measurement_the_motion_alone_is_left(kind: str) -> None:
    """Linear motion: the exact mean and variance are those of `prior-mean`."""
    runs = 20 if kind == "grid" else RUNS  # a grid has the same density in every run
    mine, exact = track(kind, slice(None), runs), track("prior-mean", slice(None), runs)
    assert np.isfinite(mine.mean).all()
    if kind in BRED:
        return
    error = (mine.mean - exact.mean)[0, 1:]
    spread = error.std(axis=1, ddof=1) / np.sqrt(runs)
    assert (np.abs(error.mean(axis=1)) <= 4.5 * spread + 1e-5).all()
    assert mine.cov is not None
    assert exact.cov is not None
    variance = mine.cov[0, 0, 1:]
    stderr = variance.std(axis=1, ddof=1) / np.sqrt(runs)
    # A cloud of N has a variance that is short by 1/N a step (its center is its own).
    short = exact.cov[0, 0, 1:, 0] * len(SCENARIO.steps) / getattr(make_filter(kind), "N", 1e9)
    off = np.abs(variance.mean(axis=1) - exact.cov[0, 0, 1:, 0])
    assert (off <= 4.5 * stderr + short + 1e-4).all()


@pytest.mark.parametrize("kind", KINDS)
def test_one_gap_leaves_every_run_finite_and_the_past_as_it_was(kind: str) -> None:
    mine, whole = track(kind, slice(2, 3), 20), track(kind, slice(0, 0), 20)
    assert np.isfinite(mine.mean).all()
    np.testing.assert_array_equal(mine.mean[:, :3], whole.mean[:, :3])


@pytest.mark.parametrize("kind", ["rpf", "mpf", "mmpf"])
def test_no_particle_is_jittered_without_a_measurement(kind: str) -> None:
    """A jitter at each step of a gap would widen the cloud without bound."""
    scenario = SCENARIO if kind == "rpf" else banana()
    keys: dict[str, Any] = {}
    if kind == "mmpf":
        keys = {"motions": (WhiteAcceleration(q=1e-3),) * 2, "transition": ((0.9, 0.1),) * 2}
    covariances = []
    for scale in (1.0, 0.0):
        tracker = make_filter(kind, bandwidth_scale=scale, **keys)
        task = BlockTask(scenario, tracker, 1, index=0, width=3, runs_used=3)
        data = simulate(scenario, 1, 0, 3)
        # One run has all its measurements.
        seen = data.measurements.copy()
        seen[:, :, 1:] = np.nan
        output = run_filter(task, data._replace(measurements=seen), 3)
        assert output.cov is not None
        covariances.append(output.cov)
    regularized, plain = covariances
    np.testing.assert_array_equal(regularized[..., 1:], plain[..., 1:])
    assert (regularized[..., -1, 0] != plain[..., -1, 0]).any()
