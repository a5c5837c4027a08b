"""The files of a sweep."""

from collections.abc import Iterable
from pathlib import Path


def render_sweep(folder: Path, formats: Iterable[str]) -> list[str]:
    """Write sweep.csv and figures; returns notes."""
    return []
