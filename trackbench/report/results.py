"""A results folder, read back."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from trackbench.core.arrays import Array

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Results:
    """The files of one results folder, as data frames and arrays, read when asked for."""

    folder: Path

    @cached_property
    def config(self) -> dict[str, Any]:
        """The resolved config."""
        config = yaml.safe_load((self.folder / "config.yaml").read_text(encoding="utf-8"))
        assert isinstance(config, dict)
        return config

    @cached_property
    def failed(self) -> list[dict[str, Any]]:
        """Filters that raised: ``filter``, ``reason`` and the grid point's values."""
        manifest = json.loads((self.folder / "manifest.json").read_text(encoding="utf-8"))
        found = manifest["failed"]
        assert isinstance(found, list)
        return found

    @property
    def labels(self) -> list[str]:
        """Filter labels in the config's order."""
        return list(self.config["filters"])

    @property
    def grid(self) -> list[str]:
        """Paths that the experiment varies: leading columns of every frame."""
        return list(self.config["grid"])

    @cached_property
    def per_run(self) -> "pd.DataFrame":
        """``filter,run,metric,value``."""
        return self._frame("per_run.csv")

    @cached_property
    def per_step(self) -> "pd.DataFrame":
        """``filter,step,time,metric,value,stderr,runs``."""
        return self._frame("per_step.csv")

    @cached_property
    def summary(self) -> "pd.DataFrame":
        """``filter,metric,value,stderr,runs,lost``."""
        return self._frame("summary.csv")

    @cached_property
    def timing(self) -> "pd.DataFrame":
        """``filter,runs,cpu_s,cpu_s_per_run,stderr``."""
        return self._frame("timing.csv")

    @cached_property
    def shown(self) -> dict[str, Array]:
        """Whole tracks of the first runs: ``truth``, ``measurements``, ``mean/<filter>``, ``steps``."""
        path = self.folder / "shown.npz"
        if not path.is_file():
            return {}
        with np.load(path) as arrays:
            return dict(arrays)

    def points(self) -> list[dict[str, Any]]:
        """The grid's points in order; one empty point without a grid."""
        if not self.grid:
            return [{}]
        rows = self.summary[self.grid].drop_duplicates()
        return [dict(zip(self.grid, row, strict=True)) for row in rows.itertuples(index=False)]

    def at(self, frame: "pd.DataFrame", point: dict[str, Any]) -> "pd.DataFrame":
        """The rows of one grid point."""
        for path, value in point.items():
            frame = frame[frame[path] == value]
        return frame

    def _frame(self, name: str) -> "pd.DataFrame":
        import pandas as pd

        return pd.read_csv(
            self.folder / name, dtype={"filter": str}, keep_default_na=False, na_values=["nan"]
        )
