"""Blocks that hang on numpy's functions are kept apart by what these give on a machine."""

import pickle
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from tests.papers import merwe
from trackbench.core import elementary, linalg, random_variates, sums
from trackbench.core.random_streams import RunStreams
from trackbench.evaluation.block import BlockTask
from trackbench.execution import block_key, machine_fingerprint, worker
from trackbench.filters.particle_filters import PF
from trackbench.models.assumed_sensor import Assume
from trackbench.models.motions.scalar import SineGamma


@dataclass(frozen=True, kw_only=True)
class Mine(PF):
    """A filter of one's own."""


OWN = BlockTask(merwe(T=3), PF(N=4), seed=1, index=0, width=2, runs_used=2)
FOREIGN = BlockTask(merwe(T=3), Mine(N=4), seed=1, index=0, width=2, runs_used=2)
NUMPYS = BlockTask(merwe(T=3, gamma_shape=0.5), PF(N=4), seed=1, index=0, width=2, runs_used=2)
ASSUMED = replace(OWN, assume=Assume(motion=SineGamma(gamma_shape=0.5)))
KNOWN = replace(OWN, assume=Assume(motion=SineGamma()))


@pytest.mark.parametrize(
    ("task", "apart"),
    [(OWN, False), (FOREIGN, True), (NUMPYS, True), (ASSUMED, True), (KNOWN, False)],
)
def test_keys_follow_numpys_arithmetic_where_it_matters(
    task: BlockTask, apart: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(block_key, "as_config", lambda part, shown: repr(part))
    block_key._part.cache_clear()
    here = block_key.block_key(task, 2)
    monkeypatch.setattr(machine_fingerprint, "numpys", lambda: "of another processor")
    block_key._part.cache_clear()
    assert (block_key.block_key(task, 2) != here) == apart
    block_key._part.cache_clear()
    monkeypatch.setattr(machine_fingerprint, "own", lambda: "of no IEEE machine")
    assert block_key.block_key(task, 2) != here
    block_key._part.cache_clear()


def test_a_worker_refuses_what_may_come_out_otherwise() -> None:
    here = worker.environment_digests()
    other = here._replace(numpys="of another processor")
    assert worker.compute(pickle.dumps(OWN), (), other)[2].width == 2
    for task in (FOREIGN, NUMPYS, ASSUMED):
        with pytest.raises(RuntimeError, match="numpy computes otherwise on this worker"):
            worker.compute(pickle.dumps(task), (), other)
    with pytest.raises(RuntimeError, match="not that of IEEE 754"):
        worker.compute(pickle.dumps(OWN), (), here._replace(own="of another"))
    with pytest.raises(RuntimeError, match="another version"):
        worker.compute(pickle.dumps(OWN), (), here._replace(code="of another"))


OWN_FUNCTIONS = [
    *[(elementary, name) for name in ("exp", "log", "cos_sin", "arctan2")],
    *[(sums, name) for name in ("total", "dot", "product")],
    *[(linalg, name) for name in ("inverse", "matmul")],
    *[(random_variates, name) for name in ("halved_normals", "exponentials")],
    *[(RunStreams, name) for name in ("standard_normal", "standard_gamma")],
]
NUMPYS_FUNCTIONS = [
    *[
        (np, name)
        for name in ("exp", "log", "log1p", "expm1", "sin", "cos", "tan", "arctan", "sqrt")
    ],
    *[(np, name) for name in ("arctan2", "hypot", "power", "vecdot", "einsum")],
    *[(np.linalg, name) for name in ("cholesky", "inv")],
]


@pytest.mark.parametrize(
    ("digested", "home", "name"),
    [
        *[(machine_fingerprint.own, *function) for function in OWN_FUNCTIONS],
        *[(machine_fingerprint.numpys, *function) for function in NUMPYS_FUNCTIONS],
    ],
)
def test_one_bit_of_any_function_is_another_arithmetic(
    digested: Any, home: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, right = digested(), getattr(home, name)

    def wrong(*given: Any, **keys: Any) -> Any:
        return one_bit_off(right(*given, **keys))

    monkeypatch.setattr(home, name, wrong)
    assert digested.__wrapped__() != here


def one_bit_off(found: Any) -> Any:
    """An array, or several, of which a number in the middle of the last is the next larger one."""
    if isinstance(found, tuple):
        return (*found[:-1], one_bit_off(found[-1]))
    other = np.array(found)
    other.flat[other.size // 2 // 97 * 97] += np.spacing(other.flat[other.size // 2 // 97 * 97])
    return other


def test_arithmetic_is_tried_on_numbers_all_over_the_unit_interval() -> None:
    for x in machine_fingerprint._inputs():
        assert 0.0 < x.min() < 0.001 < 0.999 < x.max() < 1.0
        assert np.histogram(x, 64, (0.0, 1.0))[0].min() > 64
