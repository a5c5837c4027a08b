"""Digest of everything that a block's numbers depend on: the key under which the cache stores
it.
"""

import hashlib
import inspect
import json
import os
import sys
from collections.abc import Iterator
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from trackbench.config.dump import as_config
from trackbench.evaluation.block import BlockTask
from trackbench.execution import machine_fingerprint
from trackbench.execution.code_digest import add_sources, code_digest, python_files
from trackbench.extension_points import Part, walk_parts


def block_key(task: BlockTask, used: int) -> str:
    """Return the key of a block reduced to its first ``used`` runs."""
    shown = task.runs_with_tracks_among(used)
    facts = [
        _part(task.scenario),
        _part(task.filter),
        _part(task.reference) if task.reference is not None else None,
        _part(task.assume) if task.assume is not None else None,
        [task.seed, task.index, task.width, used],
        [shown, task.keep_covariance and shown > 0, task.keep_steps],
        [task.predictive_metrics, task.hold_out],
        [code_digest(), machine_fingerprint.own()],
    ]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()


@lru_cache(maxsize=1000)
def _part(part: Any) -> list[Any]:
    """Return the config keys of a filter or scenario, digests of its data files and of plugin
    code.
    """
    parts = [inner for inner in walk_parts(part) if not isinstance(inner, type)]
    code = [digest for inner in parts for digest in _foreign_code(type(inner))]
    read: dict[str, str] = {}
    for inner in parts:
        read |= inner.contents if isinstance(inner, Part) else {}
    # What was read makes the numbers: the file itself may have been edited since.
    keys = as_config(part, lambda path: read.get(path) or _content_digest(path))
    takes_numpys = bool(code) or machine_fingerprint.hangs_on_numpys(part)
    return [keys, code, machine_fingerprint.numpys() if takes_numpys else None]


def _content_digest(path: str) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


def _foreign_code(cls: type[Any]) -> Iterator[str]:
    """Yield digests of the code of classes from outside this package."""
    for base in cls.__mro__:
        name = base.__module__
        if name.partition(".")[0] in ("trackbench", "builtins", "typing"):
            continue
        module = sys.modules[name]
        plugin = getattr(module, "__plugin_digest__", None)
        yield plugin or _package_digest(name.partition(".")[0])


@cache
def _package_digest(name: str) -> str:
    """Return the digest of an installed package's source, or of a module's."""
    try:
        file = Path(inspect.getsourcefile(sys.modules[name]) or "")
    except TypeError:  # typed into an interpreter: equal to nothing that was ever kept
        return os.urandom(16).hex()
    digest = hashlib.sha256()
    sources = python_files(file.parent if file.name == "__init__.py" else file)
    add_sources(digest, file.parent, sources)
    return digest.hexdigest()
