"""The quadrature filter stops where its nodes do not resolve the posterior, and only there."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.conftest import make_filter
from tests.papers import merwe
from trackbench.core.arrays import Array
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.base import WrongReturnError
from trackbench.models.base import Model
from trackbench.scenarios.starts.gaussian import GaussianStart

WIDE, NARROW = GaussianStart(sigma=(30.0,)), GaussianStart(sigma=(1.0,))


@cache
def means(nodes: int, R: float, start: GaussianStart) -> Array:
    scenario = replace(merwe(R=R, T=6), start=start)
    task = BlockTask(scenario, make_filter("grid", nodes=nodes), 1, 0, 8, 8)
    with np.errstate(all="ignore"):
        return run_filter(task, task.data).mean[0, 1:]


@pytest.mark.parametrize("nodes", [8, 32])
def test_too_few_nodes_are_refused(nodes: int) -> None:
    with pytest.raises(WrongReturnError, match=rf"does not resolve .* `nodes: {nodes}`; raise"):
        means(nodes, 1e-5, WIDE)


@pytest.mark.parametrize("nodes", [16, 32, 64])
@pytest.mark.parametrize("R", [1e-5, 0.1, 1.0])
def test_nodes_are_doubled_until_they_do(nodes: int, R: float) -> None:
    np.testing.assert_allclose(means(nodes, R, NARROW), means(160, R, NARROW), atol=2e-6)


def test_a_motion_without_a_density_is_refused_before_anything_runs() -> None:
    scenario = merwe(R=0.1, T=3)
    motion: Any = SimpleNamespace(
        components=("x",), transition=lambda x, k: SimpleNamespace(mean=x), support=0, origins=0
    )
    scene: Any = SimpleNamespace(model=Model(motion, scenario.model.sensor), steps=scenario.steps)
    tracker: Any = make_filter("grid")
    assert "`prob`" in tracker.conflicts(scene)[""]
    assert tracker.conflicts(scenario) == {}
