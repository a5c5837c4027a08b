"""Whole tracks of the runs that are shown or asked for, as one npz file."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from trackbench.evaluation.merge import FilterResult
from trackbench.experiment.definition import Experiment
from trackbench.experiment.files import write_bytes
from trackbench.experiment.plan import Key


class Kept:
    """``truth``, ``measurements``, ``mean/<filter>`` and, where it was kept, ``cov/<filter>``.

    ``only`` is the number of first runs, None for all. Names of a grid's points start with
    ``point<i>/``.
    """

    def __init__(self, experiment: Experiment, only: int | None) -> None:
        self.experiment = experiment
        self.only = only
        self.arrays: dict[str, Any] = {}

    def add(self, key: Key, result: FilterResult) -> None:
        """Take over one filter's tracks."""
        if result.tracks is None:
            return
        i, label = key
        point = f"point{i}/" if len(self.experiment.points) > 1 else ""
        scenario = self.experiment.points[i].scenario
        truth, seen, mean, cov = result.tracks
        self.arrays |= {
            f"{point}steps": scenario.steps,
            f"{point}times": scenario.times,
            f"{point}truth": truth[..., : self.only],
            f"{point}measurements": seen[..., : self.only],
            f"{point}mean/{label}": mean[..., : self.only],
        }
        if cov is not None:
            self.arrays[f"{point}cov/{label}"] = cov[..., : self.only]

    def write(self, path: Path) -> None:
        """Write the file, if there is anything in it."""
        if self.arrays:
            out = io.BytesIO()
            np.savez_compressed(out, **self.arrays)
            write_bytes(path, out.getvalue())
