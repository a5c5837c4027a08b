"""Experiment: points of the grid with their filters, tables and figures, made of a valid config."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

from trackbench.component_parts import Part
from trackbench.config.experiment_keys import Settings
from trackbench.config.published_numbers_and_claims import Published
from trackbench.config.tuning_axes import Axis
from trackbench.filters.base import AnyFilter
from trackbench.models.assume import Assume
from trackbench.plugins.plugin_content import Plugin
from trackbench.registry import Group
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Source


@dataclass(frozen=True)
class Point:
    """One combination of the grid's values, with its scenario and filters by label."""

    values: dict[str, object]
    scenario: Scenario
    filters: dict[str, AnyFilter]
    assumed: dict[str, Assume] = field(default_factory=dict)
    """filter models that differ from the scenario's, by label"""

    def assumed_scenario(self, label: str) -> Scenario:
        """Return the scenario with the model that this filter assumes.

        A filter without a model of its own in ``assumed`` assumes what the scenario says for all.
        """
        if label not in self.assumed:
            return self.scenario
        return self.scenario.with_assumptions(self.assumed[label])


class Labeled:
    """Base of classes with keys that hold labels of filters."""

    label_keys: ClassVar[tuple[str, ...]] = ()
    """keys, beside ``filters``, that hold labels, alone or in mappings and lists"""


class Exhibit(Labeled, Part):
    """Base of tables and figures: the filters and metrics that they show."""

    requires: ClassVar[dict[str, str]] = {}
    """metrics that it always shows, with the file of each: per_step, per_run, summary"""

    @property
    def filters(self) -> tuple[str, ...] | None:
        """Labels of the filters that it shows, a key of most; None shows all."""
        return None

    def conflicts(self, points: Sequence[Point]) -> dict[str, str]:
        """Return reasons why these points cannot be shown, by key (``""``: the exhibit as a whole).

        Parameters
        ----------
        points
            the points of the experiment's grid, each with its scenario and filters

        Returns
        -------
        dict
            reasons by key of the exhibit; the key ``""`` stands for the exhibit as a whole
        """
        return {}


class DrawnExhibit(Exhibit):
    """Base of figures: the tracks that must be stored for them."""

    numbers: ClassVar[tuple[str, ...]] = ()
    """those of its keys ``run`` and ``component`` that count runs and components, from 1"""

    @property
    def shown_runs(self) -> int:
        """Number of runs whose tracks must be stored: up to the key ``run``, if it is in `numbers`."""
        if "run" not in self.numbers:
            return 0
        return int(getattr(self, "run", 0))

    @property
    def shown_covariances(self) -> bool:
        """True if the tracks' covariances must be stored, too."""
        return False

    @property
    def shown_components(self) -> tuple[int, ...] | None:
        """Components to store, if the figure draws only lines of them over the plane."""
        return None

    def shown_components_of(self, scenario: Scenario) -> tuple[int, ...] | None:
        """Return `shown_components` of a scenario's state, for a figure that looks them up by name."""
        return self.shown_components

    @property
    def shown_measurements(self) -> bool:
        """True if the positions measured in the first run must be stored."""
        return False


@dataclass(frozen=True)
class Experiment:
    """A validated experiment; ``source`` is its config with positions, ``left_out`` is not run."""

    settings: Settings
    points: list[Point]
    left_out: dict[str, AnyFilter]
    tables: dict[str, Exhibit]
    figures: dict[str, DrawnExhibit]
    source: Source
    published: Published
    plugins: tuple[Plugin, ...] = ()
    tuned: dict[str, tuple[Axis, ...]] = field(default_factory=dict)
    """keys that are tuned, by label of the filter"""
    training: Point | None = None
    """the first point, with the scenario that filters are tuned on"""
    runs_of_config: int | None = None
    """runs that the config has, if an option such as ``--runs`` takes fewer; else None"""

    @property
    def parts(self) -> dict[Group, dict[str, Exhibit]]:
        """Tables and figures by name."""
        return {"tables": self.tables, "figures": {**self.figures}}

    def title_of(self, key: tuple[int, str]) -> str:
        """Name a filter at a grid point, for people: ``PF at scenario.R = 0.1``.

        ``key`` is the point's number and the label. Without a grid the name is the label.
        """
        point_number, label = key
        values = self.points[point_number].values
        if not values:
            return label
        point = ", ".join(f"{path} = {value}" for path, value in values.items())
        return f"{label} at {point}"


def cautions(points: Sequence[Point]) -> list[str]:
    """Return the cautions of scenarios and filters, each once.

    Before a caution of filters stand the labels of all filters that have it.
    """
    labels_by_text: dict[str, list[str]] = {}
    for point in points:
        for label, tracker in point.filters.items():
            scenario = point.assumed_scenario(label)
            for text in [*scenario.cautions_on_assumptions, *tracker.cautions(scenario)]:
                labels = labels_by_text.setdefault(text, [])
                if label not in labels:
                    labels.append(label)
    lines = scenario_cautions(points)
    for text, labels in labels_by_text.items():
        lines.append(f"{', '.join(labels)}: {text}")
    return lines


def scenario_cautions(points: Sequence[Point]) -> list[str]:
    """Return the cautions of scenarios, each once: what may be wrong about their data and their target.

    No filter changes them, so they are true of every number of the results.
    """
    # Imported here, as results are read without the code of scenarios.
    from trackbench.scenarios.shared_start import note_on_shared_start

    texts: list[str] = []
    for point in points:
        texts += point.scenario.cautions
    return [*dict.fromkeys(texts), *note_on_shared_start(point.scenario for point in points)]
