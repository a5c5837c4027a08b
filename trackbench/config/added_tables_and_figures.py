"""Tables and figures that are added to a config: those of one that names none, and those of tuning."""

from collections.abc import Iterable, Mapping
from itertools import chain, count
from typing import Any

from trackbench.config.experiment import Point
from trackbench.config.experiment_keys import Settings
from trackbench.config.overrides import override
from trackbench.errors import Mark
from trackbench.models.plane_components import rows_in_plane
from trackbench.yaml_source import Source

TUNING = "tuning"
"""Kind of the table and of the figures that tuning adds."""


def exhibits_without_tuning(entries: Mapping[str, Any] | None) -> list[str]:
    """Return the names of a config's tables or figures, without those of the kind `TUNING`.

    Tuning adds the latter to any config. A config without another table has the default table, tuned or
    not, and its filters are ranked by the same number. ``entries`` are its tables or figures by name.
    """
    names = []
    for name, entry in (entries or {}).items():
        # An entry that is no mapping is a mistake, which is reported elsewhere.
        if not isinstance(entry, Mapping) or entry.get("kind") != TUNING:
            names.append(name)
    return names


def add_default_exhibits(source: Source, settings: Settings, points: list[Point]) -> None:
    """Add default tables and figures to a config that names none.

    With ground truth in the plane it gets a track of the first run. Without ground truth it gets tables
    if it has no key `tables`, and figures if it has no key `figures`: of innovations and estimates.
    ``points`` are those of the grid, none if all have mistakes.
    """
    # Chosen metrics may leave out those that the defaults show, such as `anis` per step.
    chooses_metrics = settings.metrics is not None or settings.per_step is not None
    if chooses_metrics or not points:
        return
    scenario = points[0].scenario
    # {}: only components px and py count, and no error `position` of the score.
    is_planar = rows_in_plane(scenario.components, {}) is not None
    names_table = bool(exhibits_without_tuning(settings.tables))
    names_figure = bool(exhibits_without_tuning(settings.figures))
    # With ground truth: the track of the first run. It shows one point, so that a grid has none.
    if any(p.scenario.has_truth for p in points):
        if is_planar and not settings.grid and not names_table and not names_figure:
            _add_exhibits(source, "figures", {"track": {"kind": "track"}}, "default in the plane")
        return
    # Without ground truth: tables and figures that need only innovations. With an empty key `tables` or
    # `figures` a config has none.
    mark = "default without ground truth"
    if not _names_group(source, "tables"):
        _add_exhibits(source, "tables", {"innovations": {"kind": "innovations"}}, mark)
    if not _names_group(source, "figures"):
        figures: dict[str, object] = {
            "nis": {"kind": "nis"},
            "whiteness": {"kind": "autocorrelation"},
        }
        if is_planar:
            figures["track"] = {"kind": "track"}
        else:
            figures["estimates"] = {"kind": "estimates"}
        _add_exhibits(source, "figures", figures, mark)


def _names_group(source: Source, group: str) -> bool:
    """Test whether a config has the key ``group``: tables or figures; not if only tuning added it."""
    return group in source.data and source.key_mark((group,)) != _mark_of_tuning(source)


def _mark_of_tuning(source: Source) -> Mark:
    """Return the position of what tuning adds: mistakes are reported at the key `tune`.

    A mark without a line is of no file, as that of an option.
    """
    mark = source.key_mark(("tune",))
    return mark if mark.line else Mark("tune")


def _add_exhibits(source: Source, group: str, exhibits: dict[str, object], mark: str) -> None:
    """Add default tables or figures to ``group``, before those of tuning."""
    entries = {**exhibits, **(source.data.get(group) or {})}
    override(source, (group,), entries, Mark(mark))


def add_tuning_exhibit(source: Source, group: str, name: str, exhibit: dict[str, object]) -> None:
    """Add a table or figure of tuning to ``group`` under a free ``name``, unless the config has it.

    ``exhibit`` is its entry: kind and keys. The config has it if an entry there has these keys with
    these values.
    """
    mark = _mark_of_tuning(source)
    if group not in source.data:
        override(source, (group,), {}, mark)
    entries = source.data[group]
    if not isinstance(entries, dict):
        return
    for entry in entries.values():
        if isinstance(entry, dict) and exhibit.items() <= entry.items():
            return
    override(source, (group, free_name(name, entries)), exhibit, mark)


def figure_name(label: str) -> str:
    """Name the figure of a tuned filter by the letters and digits of its label."""
    words = "".join(c if c.isascii() and c.isalnum() else " " for c in label).split()
    return "-".join(["tuning", *words])[:80]


_LONGEST = 76  # characters of a name that gets a number


def free_name(name: str, taken: Iterable[str]) -> str:
    """Return the name, or if it is taken the first of name-2, name-3, ... that is free.

    A long name is shortened before it gets a number. Names that differ in case only are one file on some
    systems, so they count as equal.
    """
    folded = {other.casefold() for other in taken}
    numbered = (f"{name[:_LONGEST]}-{n}" for n in count(2))
    return next(free for free in chain([name], numbered) if free.casefold() not in folded)
