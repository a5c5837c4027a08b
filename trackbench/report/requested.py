"""What the config of a results folder asks for: filters, grid, names of tables and figures."""

from collections.abc import Container
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from trackbench.config.experiment import labels_to_run
from trackbench.config.grid import combinations, single_paths
from trackbench.config.published import Published
from trackbench.config.published_csv import read_published
from trackbench.registry import Group, kinds
from trackbench.report.plotting import style
from trackbench.yaml_source import Source, read


@dataclass(frozen=True)
class ResultsConfig:
    """A results folder's config."""

    folder: Path

    @cached_property
    def source(self) -> Source:
        """The resolved config with positions."""
        return read(self.folder / "config.yaml")

    @property
    def config(self) -> dict[str, Any]:
        """The resolved config."""
        config = self.source.data
        assert isinstance(config, dict)
        return config

    def fill_title(self, text: str) -> str:
        """A title with the number of runs in the place of ``{runs}``."""
        return text.replace("{runs}", str(self.config["runs"]))

    @property
    def title(self) -> str:
        """The experiment's title, or else its name."""
        return self.fill_title(self.config["title"] or self.config["name"])

    @property
    def figure_configs(self) -> dict[str, dict[str, Any]]:
        """The figures that the config asks for, as it does."""
        return self.config.get("figures") or {}

    def unavailable_kinds(self, group: Group) -> dict[str, str]:
        """Tables or figures of kinds that only the config's plugins can know and that are not loaded."""
        named = {name: part.get("kind") for name, part in self.config.get(group, {}).items()}
        known = kinds(group) if self.config.get("plugins") else named.values()
        return {name: kind for name, kind in named.items() if kind not in known}

    @cached_property
    def published(self) -> Published:
        """Published numbers and claims that this experiment is held against."""
        config = self.config
        return read_published(
            self.folder,
            config.get("published", []),
            config["name"],
            mark=self.source.mark(("published",)),
        )

    @property
    def labels(self) -> list[str]:
        """Filter labels in the config's order, and the lower bound's last."""
        bound = self.config.get("bound")
        return [*self.filters, *([bound] if bound else [])]

    def chosen(self, wanted: Container[str] | None) -> list[str]:
        """The labels that a table or figure shows: those it names, or all of them."""
        return [label for label in self.labels if wanted is None or label in wanted]

    @property
    def filters(self) -> list[str]:
        """Labels of the filters that were run, in the config's order."""
        config = self.config
        return labels_to_run(config["filters"], config.get("only", []), config.get("reference"))

    def line_style(self, label: str) -> dict[str, Any]:
        """Colour and dash of a filter, the same in every figure of the experiment.

        What any figure calls its floor, or its baseline, is that in all of them.
        """
        own = style.line([*self.config["filters"], label].index(label))
        return self._references.get(label, own)

    @cached_property
    def _references(self) -> dict[str, dict[str, Any]]:
        return {
            figure[key]: look
            for key, look in (("baseline", style.BASELINE), ("floor", style.FLOOR))
            for figure in self.figure_configs.values()
            if isinstance(figure.get(key), str)
        }

    @property
    def grid(self) -> list[str]:
        """Paths that the experiment varies: leading columns of every frame."""
        return list(self.config["grid"])

    @property
    def grid_heads(self) -> list[str]:
        """The paths as headings of a table: of paths that vary together, the first one."""
        return [single_paths(path)[0] for path in self.grid]

    @cached_property
    def grid_points(self) -> list[dict[str, Any]]:
        """The points of the config's grid, those where every filter failed among them."""
        config = self.config
        grid, every = config["grid"], config.get("product", True)
        places = combinations(grid, config["filters"], config.get("reference"), every)
        return [{path: grid[path][i] for path, i in zip(grid, at, strict=True)} for at in places]
