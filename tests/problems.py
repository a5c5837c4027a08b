"""Digests of the standard problems: ``python -m tests.problems`` writes ``tests/problems.json`` anew.

A digest covers what moves a number of a problem: its resolved config but titles, tables and figures,
the recordings, and the published rows. A test fails where a digest differs: raise ``version`` in the
config's ``problem`` and run the command. Where no number moves, the command alone is enough.

Keys that are younger than the file and that a config leaves at their defaults are outside its digest.
"""

import hashlib
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

from tests.conftest import EXPERIMENT_FILES, EXPERIMENTS, shipped
from trackbench.config.experiment import Experiment
from trackbench.config.file_paths import with_parts
from trackbench.config.resolved_config import as_yaml, resolved
from trackbench.config.shipped_problems import problems as listed

FILE = Path(__file__).with_name("problems.json")
SHOWN = {
    *("title", "paper", "problem", "tables", "figures", "key_figure", "published"),
    *("metrics", "per_step", "medians"),
}
"""Settings that no number depends on."""
WORDS = {"note", "source", "claim"}
"""Columns of published rows that no verdict depends on."""


class Stored(NamedTuple):
    """Version and digest of a problem."""

    version: int
    digest: str


def names() -> list[str]:
    """Return the standard problems."""
    return [problem.name for problem in listed()]


def config_of(experiment: Experiment) -> dict[str, Any]:
    """Return what its numbers depend on, with every default."""
    whole = resolved(experiment, EXPERIMENTS)
    return {key: value for key, value in whole.items() if key not in SHOWN}


def keys_in(data: object) -> set[str]:
    """Return every key of nested mappings."""
    inner = data.values() if isinstance(data, dict) else data if isinstance(data, list) else ()
    return {*(data if isinstance(data, dict) else ())}.union(*map(keys_in, inner))


def without_young_keys(data: Any, source: Any, known: set[str]) -> Any:
    """Return the config without keys that are neither known nor in the file itself."""
    if isinstance(data, dict):
        source = source if isinstance(source, dict) else {}
        return {
            key: without_young_keys(value, source.get(key), known)
            for key, value in data.items()
            if key in known or key in source
        }
    if isinstance(data, list):
        source = source if isinstance(source, list) else [None] * len(data)
        return [without_young_keys(x, s, known) for x, s in zip(data, source, strict=False)]
    return data


def stored(name: str, known: set[str]) -> Stored:
    """Return version and digest of a problem as it is now."""
    experiment = shipped(name)
    assert experiment.settings.problem is not None
    config = without_young_keys(config_of(experiment), experiment.source.data, known)
    rows = [*experiment.published.numbers, *experiment.published.claims]
    published = [
        {key: str(x) for key, x in asdict(row).items() if x not in ("", None) and key not in WORDS}
        for row in rows
    ]
    recordings = {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(with_parts(EXPERIMENT_FILES[name]))
        if path.is_file() and path.suffix == ".csv" and path.parent.name == "data"
    }
    text = as_yaml([config, published, recordings])
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    return Stored(experiment.settings.problem.version, digest)


def read() -> tuple[set[str], dict[str, Stored]]:
    """Return the known keys and what is stored of each problem."""
    content = json.loads(FILE.read_text(encoding="utf-8"))
    return set(content["keys"].split()), {k: Stored(*v) for k, v in content["problems"].items()}


def main() -> None:
    """Write the file, and print the problems whose digest changed at the same version."""
    old = read()[1] if FILE.is_file() else {}
    configs = [config_of(shipped(name)) for name in names()]
    known = keys_in([c | {"filters": [*c["filters"].values()]} for c in configs])
    new = {name: stored(name, known) for name in names()}
    for name in new.keys() & old.keys():
        if new[name].version == old[name].version and new[name].digest != old[name].digest:
            print(f"{name} changed at version {new[name].version}: raise it if a number moves")
    content = {"keys": " ".join(sorted(known)), "problems": new}
    FILE.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
