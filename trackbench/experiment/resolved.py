"""A validated experiment written out again: plain data with every default, to be rerun as it is."""

import os
from collections.abc import Callable
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

from trackbench.experiment.definition import Experiment
from trackbench.experiment.validate import file_keys


def resolved(experiment: Experiment, folder: Path) -> dict[str, Any]:
    """The config as plain data with every default; a grid keeps its list of values.

    Paths are relative to ``folder``, where the config is to be written.
    """
    first = experiment.points[0]
    out = asdict(experiment.settings)

    def relative(path: str) -> str:
        return os.path.relpath(path, folder)

    out["plugins"] = [relative(plugin.path) for plugin in experiment.plugins]
    # A results folder holds copies of the files under these names, so that it stands alone.
    out["published"] = [f"published/{name}" for name in experiment.published.files]
    out["scenario"] = as_config(first.scenario, relative)
    parts = {"filters": first.filters, "tables": experiment.tables, "figures": experiment.figures}
    for group, built in parts.items():
        out[group] = {name: as_config(part, relative) for name, part in built.items()}
    return out


def as_config(part: Any, shown: Callable[[str], str] = str) -> dict[str, Any]:
    """A registered dataclass as the mapping that makes it; ``shown`` is how paths are written."""
    files = file_keys(type(part))
    out = {"kind": part.kind}
    for key in fields(part):
        value = getattr(part, key.name)
        if key.name in files and value is not None:
            value = shown(value)
        out[key.name] = _plain(value, shown)
    return out


def _plain(value: Any, shown: Callable[[str], str]) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return as_config(value, shown) if hasattr(value, "kind") else _plain(asdict(value), shown)
    if isinstance(value, dict):
        return {k: _plain(v, shown) for k, v in value.items()}
    return [_plain(v, shown) for v in value] if isinstance(value, list | tuple) else value
