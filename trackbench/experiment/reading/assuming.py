"""What a filter is told to assume of target and sensor: the key ``assume`` of its entry."""

from trackbench.experiment.problems import Problem
from trackbench.experiment.reading.definition import Point
from trackbench.experiment.reading.parts import build_plain
from trackbench.experiment.reading.source import Source, dotted
from trackbench.keys import MistakenKeyError
from trackbench.models.assumed import Assume
from trackbench.scenarios.base import Scenario


def read_assumed(source: Source, label: str, problems: list[Problem]) -> Assume | None:
    """The model that a filter's entry names, if it names one."""
    entry = source.data["filters"][label]
    if not isinstance(entry, dict) or entry.get("assume") is None:
        return None
    keys = ("filters", label, "assume")
    if label == source.data.get("reference"):
        what = "the reference filter assumes what makes the data"
        problems.append(Problem(source.key_mark(keys), dotted(keys), what))
    return build_plain(Assume, source, keys, problems)


def check_assumed(
    source: Source, point: Point, label: str, problems: list[Problem]
) -> Scenario | None:
    """The scenario as this filter sees it; None, with the reason said, if there is no such model."""
    keys = ("filters", label, "assume")
    try:
        seen = point.seen_by(label)
        _ = seen.model
    except MistakenKeyError as error:
        own = (*keys[:2], *error.path) if label in point.assumed else ("scenario", *error.path)
        problems.append(Problem(source.mark(own), dotted(own), str(error)))
        return None
    except ValueError as error:
        problems.append(Problem(source.mark(keys), dotted(keys), str(error)))
        return None
    return seen
