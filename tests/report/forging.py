"""Results folders edited with a manifest made to agree, and some as of another machine."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trackbench import api
from trackbench.evaluation import cached_filter_outputs, run_filter
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.filter_output import FilterOutput
from trackbench.results.manifest import read_manifest, write_manifest


def reseal(folder: Path) -> None:
    """Write new digests of every file that the manifest names."""
    manifest = read_manifest(folder)
    write_manifest(folder, manifest, [folder / name for name in manifest["files"]])


def edit(folder: Path, name: str, old: str, new: str) -> None:
    """One word instead of another, where it first is."""
    path = folder / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    reseal(folder)


Factors = Callable[[np.random.Generator, tuple[int, ...]], Any]
"""From a shape (T + 1, M) what every error is multiplied by."""


def elsewhere(config: Path, kind: str, factors: Factors | None) -> Path:
    """The results of a machine on which filters of this kind have other errors, or draw other noise."""
    rng, estimate = np.random.default_rng(1), run_filter.run_filter
    cached_filter_outputs.run_filter_cached.cache_clear()

    def estimated(task: BlockTask, data: Any, *more: Any) -> FilterOutput:
        result = estimate(task, data, *more)
        if factors is None or task.filter.kind != kind:
            return result
        error = result.mean - data.truth
        return result._replace(mean=data.truth + factors(rng, error.shape[1:]) * error)

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACKBENCH_CACHE", str(config.parent / "elsewhere"))
        patch.setattr(cached_filter_outputs, "run_filter", estimated)
        if factors is None:
            stream = run_filter.block_stream
            patch.setattr(run_filter, "block_stream", lambda seed, index: stream(seed + 1, index))
        options = api.Options(engine="serial", quiet=True, out=config.parent / "out", formats=())
        folder = api.run(config, options).folder
    cached_filter_outputs.run_filter_cached.cache_clear()
    return folder
