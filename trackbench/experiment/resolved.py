"""A validated experiment written out again: plain data with every default, to be rerun as it is."""

import os
from collections.abc import Callable
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import Any

import yaml

from trackbench.experiment.definition import Experiment
from trackbench.experiment.source import scalar
from trackbench.experiment.validate import file_keys


def resolved(experiment: Experiment, folder: Path) -> dict[str, Any]:
    """The config as plain data with every default; a grid keeps its list of values.

    A filter that ``only`` leaves out stays in it, so that tables, figures and published numbers may
    go on naming it.

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
    every = first.filters | experiment.left_out
    filters = {label: every[label] for label in experiment.settings.filters}
    parts = {"filters": filters, "tables": experiment.tables, "figures": experiment.figures}
    for group, built in parts.items():
        out[group] = {name: as_config(part, relative) for name, part in built.items()}
    return out


def as_yaml(data: Any) -> str:
    """Plain data as YAML in the order it is given, such that `source.read` gives the same again."""
    return yaml.dump(
        data,
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=None,
        width=100,
    )


class _Dumper(yaml.SafeDumper):
    def represent_word(self, word: str) -> yaml.ScalarNode:
        """Quoted also where only YAML 1.2 takes a plain word for a number, such as 1e5."""
        quoted = "'" if scalar(word) != word else None
        return self.represent_scalar("tag:yaml.org,2002:str", word, style=quoted)


_Dumper.add_representer(str, _Dumper.represent_word)


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
