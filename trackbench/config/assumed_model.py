"""Filter model of an entry: the key ``assume``."""

from trackbench.config.build_kinds import build_plain
from trackbench.config.experiment import Point
from trackbench.extension_points import foreign_parts
from trackbench.field_types import InvalidKeyError
from trackbench.models.assumed_sensor import Assume
from trackbench.plugins.errors import located_message
from trackbench.scenarios.base import Scenario
from trackbench.yaml_source import Source


def read_assumed(source: Source, label: str) -> Assume | None:
    """Return the model that a filter's entry names, if it names one."""
    entry = source.data["filters"][label]
    if not isinstance(entry, dict) or entry.get("assume") is None:
        return None
    keys = ("filters", label, "assume")
    if label == source.data.get("reference"):
        source.add_key_problem(keys, "the reference filter assumes what makes the data")
    return build_plain(Assume, source, keys)


def check_assumed(source: Source, point: Point, label: str) -> Scenario | None:
    """Return the scenario as this filter models it; None, with a problem added, if impossible."""
    keys = ("filters", label, "assume")
    try:
        seen = point.seen_by(label)
        _ = seen.model
    except InvalidKeyError as error:
        own = (*keys[:2], *error.path) if label in point.assumed else ("scenario", *error.path)
        source.add_problem(own, str(error))
        return None
    except ValueError as error:
        source.add_problem(keys, str(error))
        return None
    except Exception as error:
        foreign = foreign_parts(point.assumed.get(label))
        if not foreign:
            raise
        source.add_problem(keys, located_message(error, *foreign))
        return None
    return seen
