"""The config of a results folder: filters, grid, names of tables and figures."""

from collections.abc import Container, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

from trackbench.config.build import dataclasses_in, hints_of
from trackbench.config.experiment import labels_to_run
from trackbench.config.grid import combinations, single_paths
from trackbench.config.includes import split_path
from trackbench.config.published import Published, read_published
from trackbench.errors import counted
from trackbench.evaluation.metric_expression import exact_label
from trackbench.field_types import Unit, UnitIf, annotations_of, part_group
from trackbench.models.sensors.base import Assume
from trackbench.registry import Group, kinds
from trackbench.report.findings import phrases
from trackbench.report.plotting import style
from trackbench.yaml_source import Source, read


def _unit(part: Any, group: str | None, cls: type[Any] | None, keys: Sequence[str]) -> str:
    """Return the unit of the key at the path ``keys`` in the settings ``part``.

    They are those of a component of ``group``, or of the dataclass ``cls``. Empty if the component is
    unknown or the key has no unit.
    """
    key, *rest = keys
    if group is not None:
        cls = kinds(cast(Group, group)).get(part.get("kind", "ekf"))
    hint = None if cls is None else hints_of(cls).get(key)
    if key == "assume" and hint is None:
        return _unit(part[key], None, Assume, rest)
    if cls is None or hint is None:
        return ""
    if rest:
        inner, nested = part.get(key), dataclasses_in(hint)
        only = nested[0] if len(nested) == 1 else None
        return _unit(inner, part_group(hint), only, rest) if isinstance(inner, dict) else ""
    marks = annotations_of(hint)
    special = (m.unit for m in marks if isinstance(m, UnitIf) and part.get(m.key) == m.value)
    return next(special, next((m.unit for m in marks if isinstance(m, Unit)), ""))


@dataclass(frozen=True)
class ResultsConfig:
    """A results folder's config."""

    folder: Path

    @cached_property
    def source(self) -> Source:
        """Return the resolved config with positions."""
        return read(self.folder / "config.yaml")

    @property
    def config(self) -> dict[str, Any]:
        """Return the resolved config."""
        config = self.source.data
        assert isinstance(config, dict)
        return config

    def fill_title(self, text: str) -> str:
        """Return a title with the number of runs in place of ``{runs}``."""
        return text.replace("{runs}", str(self.config["runs"]))

    @property
    def title(self) -> str:
        """Return the experiment's title, or else its name."""
        return self.fill_title(self.config["title"] or self.config["name"])

    @property
    def citation(self) -> str:
        """Return ``trackbench/ungm v1, 400 runs`` of a standard problem; else an empty text."""
        config = self.config
        problem = config.get("problem")
        return (
            f"trackbench/{config['name']} v{problem['version']}, {counted(config['runs'], 'run')}"
            if problem
            else ""
        )

    @property
    def figure_configs(self) -> dict[str, dict[str, Any]]:
        """Return the config's figures as mappings."""
        return self.config.get("figures") or {}

    def unavailable_kinds(self, group: Group) -> dict[str, str]:
        """Return names and kinds of tables or figures whose plugin is not loaded."""
        named = {name: part.get("kind") for name, part in self.config.get(group, {}).items()}
        known = kinds(group) if self.config.get("plugins") else named.values()
        return {name: kind for name, kind in named.items() if kind not in known}

    @cached_property
    def published(self) -> Published:
        """Return the published numbers and claims that the results are compared with."""
        config = self.config
        return read_published(
            self.folder,
            config.get("published", []),
            config["name"],
            mark=self.source.mark(("published",)),
        )

    @property
    def labels(self) -> list[str]:
        """Return filter labels in the config's order, each before its exact errors; the bound's last."""
        bound = self.config.get("bound")
        labels = [b for f in self.filters for b in (f, exact_label(f)) if b == f or b in self.exact]
        return [*labels, *([bound] if bound else [])]

    @cached_property
    def exact(self) -> list[str]:
        """Return the labels of exact errors."""
        return [*map(exact_label, self.config.get("exact", []))]

    def chosen(self, wanted: Container[str] | None, exact: bool = False) -> list[str]:
        """Return the labels that a table or figure shows: those it names, or all, perhaps the exact."""
        every = [label for label in self.labels if exact or label not in self.exact]
        return every if wanted is None else [label for label in self.labels if label in wanted]

    @property
    def filters(self) -> list[str]:
        """Return labels of the filters that were run, in the config's order."""
        config = self.config
        return labels_to_run(config["filters"], config.get("only", []), config.get("reference"))

    def line_style(self, label: str) -> dict[str, Any]:
        """Return color and dash of a filter, the same in every figure of the experiment.

        The floor or baseline of any figure is drawn as such in all figures.
        """
        own = style.line([*self.config["filters"], label].index(label))
        return self._references.get(label, own)

    @cached_property
    def _references(self) -> dict[str, dict[str, Any]]:
        return dict.fromkeys(self.exact, style.EXACT) | {
            figure[key]: look
            for key, look in (("baseline", style.BASELINE), ("floor", style.FLOOR))
            for figure in self.figure_configs.values()
            if isinstance(figure.get(key), str)
        }

    @property
    def grid(self) -> list[str]:
        """Return the paths that the experiment varies: leading columns of every frame."""
        return list(self.config["grid"])

    @property
    def grid_heads(self) -> list[str]:
        """Return the paths as headings of a table: of paths that vary together, the first."""
        return [single_paths(path)[0] for path in self.grid]

    def axis(self, path: str) -> str:
        """Return a swept path as the label of an axis: ``q (m^2/s^3)``."""
        words, unit = phrases.quantity(path)
        unit = unit or self.grid_units.get(path, "")
        return f"{words} ({unit})" if unit else words

    @cached_property
    def grid_units(self) -> dict[str, str]:
        """Return the units of paths of the grid that the keys' documentation names, not the keys."""
        found: dict[str, str] = {}
        for path in (p for p in self.grid if not phrases.quantity(p)[1]):
            keys = split_path(self.source, single_paths(path)[0])
            first, *rest = (str(key) for key in keys if not isinstance(key, int))
            part, group = self.config[first], "scenarios"
            if first == "filters":
                part, group, rest = part[rest[0]], "filters", rest[1:]
            if rest and (unit := _unit(part, group, None, rest)):
                found[path] = unit
        return found

    @cached_property
    def grid_points(self) -> list[dict[str, Any]]:
        """Return all points of the config's grid, also those where every filter failed."""
        config = self.config
        grid, every = config["grid"], config.get("product", True)
        places = combinations(grid, config["filters"], config.get("reference"), every)
        return [{path: grid[path][i] for path, i in zip(grid, at, strict=True)} for at in places]
