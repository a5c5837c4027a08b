"""Standard problem: the key `problem`, the citation, and changes after which it is none."""

from collections.abc import Mapping
from typing import Any

from trackbench.config.chosen_filters import add_label_problem
from trackbench.config.experiment_keys import Settings
from trackbench.errors import counted
from trackbench.yaml_source import Source

PROBLEM_KEYS = {"scenario", "filters", "grid"}
"""Overridden keys after which an experiment is no longer the standard problem of its name."""


def check_problem(source: Source, settings: Settings) -> None:
    """Check that a standard problem's reference is a filter or the bound."""
    if settings.problem is None:
        return
    label = settings.problem.reference
    if label is not None and label not in (*settings.filters, settings.bound):
        add_label_problem(source, settings, ("problem", "reference"), label)


def citation_of(config: Mapping[str, Any]) -> str:
    """Cite the results of a standard problem: ``trackbench/ungm v1, 400 runs``; else an empty text.

    ``config`` is that of a results folder, with every default.
    """
    problem = config.get("problem")
    if not problem:
        return ""
    runs = counted(config["runs"], "run")
    return f"trackbench/{config['name']} v{problem['version']}, {runs}"
