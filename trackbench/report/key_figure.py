"""Key figure of an experiment, with which the report and a notebook begin."""

from collections.abc import Iterable, Mapping
from typing import Any


def key_figure(config: Mapping[str, Any], figures: Iterable[str]) -> str:
    """Return the name of the key figure: that of the config, else the first of the figures.

    ``figures`` are the names of those that can be drawn. The name is empty if there are none.
    """
    names = list(figures)
    configured_name: str | None = config.get("key_figure")
    if configured_name in names:
        return str(configured_name)
    return next(iter(names), "")
