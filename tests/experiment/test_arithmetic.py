"""Blocks that hang on numpy's functions are kept apart by what these give on a machine."""

import pickle
from dataclasses import dataclass, replace

import pytest

from tests.papers import merwe
from trackbench.evaluation.block import BlockTask
from trackbench.experiment.computing import worker
from trackbench.experiment.planning import arithmetic, digest
from trackbench.filters.bootstrap import PF
from trackbench.models.assumed import Assume
from trackbench.models.motions.scalar import SineGamma


@dataclass(frozen=True, kw_only=True)
class Mine(PF):
    """A filter of one's own."""


OWN = BlockTask(merwe(T=3), PF(N=4), seed=1, index=0, width=2, used=2)
FOREIGN = BlockTask(merwe(T=3), Mine(N=4), seed=1, index=0, width=2, used=2)
NUMPYS = BlockTask(merwe(T=3, gamma_shape=0.5), PF(N=4), seed=1, index=0, width=2, used=2)
ASSUMED = replace(OWN, assume=Assume(motion=SineGamma(gamma_shape=0.5)))
KNOWN = replace(OWN, assume=Assume(motion=SineGamma()))


@pytest.mark.parametrize(
    ("task", "apart"),
    [(OWN, False), (FOREIGN, True), (NUMPYS, True), (ASSUMED, True), (KNOWN, False)],
)
def test_keys_follow_numpys_arithmetic_where_it_matters(
    task: BlockTask, apart: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(digest, "as_config", lambda part, shown: repr(part))
    digest._part.cache_clear()
    here = digest.block_key(task, 2)
    monkeypatch.setattr(arithmetic, "numpys", lambda: "of another processor")
    digest._part.cache_clear()
    assert (digest.block_key(task, 2) != here) == apart
    digest._part.cache_clear()
    monkeypatch.setattr(arithmetic, "own", lambda: "of no IEEE machine")
    assert digest.block_key(task, 2) != here
    digest._part.cache_clear()


def test_a_worker_refuses_what_may_come_out_otherwise() -> None:
    here = worker.ground()
    other = here._replace(numpys="of another processor")
    assert worker.compute(pickle.dumps(OWN), (), other)[2].width == 2
    for task in (FOREIGN, NUMPYS, ASSUMED):
        with pytest.raises(RuntimeError, match="numpy computes otherwise on this worker"):
            worker.compute(pickle.dumps(task), (), other)
    with pytest.raises(RuntimeError, match="not that of IEEE 754"):
        worker.compute(pickle.dumps(OWN), (), here._replace(own="of another"))
    with pytest.raises(RuntimeError, match="another version"):
        worker.compute(pickle.dumps(OWN), (), here._replace(code="of another"))
