"""Key of a block in the cache: a digest of all that its numbers depend on."""

import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from trackbench.component_parts import Part, walk_parts
from trackbench.config.component_as_config import as_config
from trackbench.evaluation.block_task import BlockTask
from trackbench.execution import arithmetic_digests
from trackbench.execution.block_file import FORMAT
from trackbench.execution.code_digests import code_digest, foreign_code


def block_key(task: BlockTask, used: int) -> str:
    """Return the key of a block of which the first ``used`` runs count: its file name in the cache.

    It is a SHA-256 digest of everything that the stored numbers depend on: scenario and filters with the
    code of their plugins, the requested metrics, the runs, the package's code with the versions of
    Python, numpy and scipy, and results of the package's own arithmetic on this machine.
    """
    # Copy the kept digest of what is equal for all blocks of the filter, then add the rest.
    digest = _digest_without_runs(
        (task.scenario, task.filter, task.reference, task.reference_assume, task.assume),
        (task.keep_steps, task.predictive_metrics, task.hold_out),
    ).copy()
    runs_with_tracks = task.runs_with_tracks_among(used)
    has_covariances = task.keep_covariance and runs_with_tracks > 0
    runs = [task.seed, task.index, task.width, used, runs_with_tracks, has_covariances]
    code = [FORMAT, code_digest(), arithmetic_digests.own_arithmetic()]
    digest.update(repr([runs, code]).encode())
    return digest.hexdigest()


_KEPT_DIGESTS = 1000
_digests: dict[tuple[Any, ...], tuple[tuple[Any, ...], Any]] = {}
"""By the identities of components and by what is requested: the components, and their SHA-256 object."""


def _digest_without_runs(components: tuple[Any, ...], requests: tuple[Any, ...]) -> Any:
    """Return the SHA-256 object that begins the keys of all blocks that differ in their runs alone.

    ``components`` are the scenario, the filter, the reference, and what these two assume; ``requests``
    name what is computed from the estimates. The object is kept: update a copy of it.
    """
    # Components are looked up by identity, because their hashes take longer than the rest of the key.
    # They are kept beside the digest, so that no other object gets the identity of one of them.
    lookup_key = (*map(id, components), *requests)
    entry = _digests.get(lookup_key)
    if entry is None:
        facts: list[Any] = [_facts_of(component) for component in components]
        facts.append(requests)
        entry = components, hashlib.sha256(json.dumps(facts).encode())
        if len(_digests) >= _KEPT_DIGESTS:
            _digests.clear()
        _digests[lookup_key] = entry
    # Another thread may have cleared the digests: the entry is not looked up again.
    _, digest = entry
    return digest


@lru_cache(maxsize=1000)
def _facts_of(component: Any) -> list[Any] | None:
    """Return what the numbers of a filter or scenario depend on; None if ``component`` is None.

    These are its keys with digests of its data files, digests of plugin code, and, if it computes with
    numpy's functions, the digest of numpy's arithmetic.
    """
    if component is None:
        return None
    code: list[str] = []
    contents: dict[str, str] = {}
    for inner in walk_parts(component):
        if isinstance(inner, type):  # a class is no part that computes, and has no keys
            continue
        code += foreign_code(type(inner))
        if isinstance(inner, Part):
            contents |= inner.contents

    def content_digest(path: str) -> str:
        """Return the digest of a data file, which the keys then have in place of its path."""
        # The numbers depend on the content that was read; the file may have been edited since.
        return contents.get(path) or hashlib.sha256(Path(path).read_bytes()).hexdigest()

    keys = as_config(component, content_digest)
    arithmetic = None
    if code or arithmetic_digests.uses_numpy_arithmetic(component):
        arithmetic = arithmetic_digests.numpy_arithmetic()
    return [keys, code, arithmetic]
