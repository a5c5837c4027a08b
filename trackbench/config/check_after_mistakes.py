"""Continue the check of a config after mistakes, with the parts that do not depend on them."""

from dataclasses import fields
from difflib import get_close_matches

from trackbench.config.build_components import build, build_kind
from trackbench.config.experiment_keys import Settings
from trackbench.errors import Mark, Problem, UserError
from trackbench.yaml_source import Source

_LEAST_SIMILARITY = 0.7  # of two keys: `title` and `titel` have 0.8, `bound` and `bogus` 0.6
_INDEPENDENT_KEYS = {
    "name",
    "title",
    "seed",
    "runs",
    "verdict_seeds",
    "block",
    "medians",
    "matters",
    "metrics",
    "per_step",
    "published",
}
"""Settings that no other part of the file depends on: the rest is checked despite mistakes in them."""


def with_unread_components(error: UserError, unread: dict[str, list[Problem]]) -> UserError:
    """Drop the mistakes inside a component that could not be read; add the reasons why it could not.

    ``unread`` has the reasons by the component's path. Mistakes that are mere texts are dropped, too, as
    they do not name the component that they are in.
    """
    unread_paths = tuple(f"{path}." for path in unread)
    problems: set[Problem] = set()
    for reasons in unread.values():
        problems.update(reasons)
    for problem in error.problems:
        if isinstance(problem, Problem) and not f"{problem.path}.".startswith(unread_paths):
            problems.add(problem)
    return UserError(*sorted(problems))


def with_unchecked_note(source: Source) -> UserError:
    """Return the error of all mistakes; if they are several, the last line says that more may follow."""
    problems = sorted(set(source.problems))
    if len(problems) > 1:
        message = (
            f"more may follow: what depends on these keys, such as metrics, is checked when these "
            f"{len(problems)} mistakes are mended"
        )
        problems.append(Problem(Mark(source.mark(()).file), "", message))
    return UserError(*problems)


def build_independent_settings(source: Source) -> Settings | None:
    """Build the settings without mistaken keys; None if other parts of the config depend on these.

    With these settings the rest of the config can be checked, too.
    """
    mistaken_keys = {problem.path.partition(".")[0] for problem in source.problems}
    known_keys = [key.name for key in fields(Settings)]
    # An unknown key is left out, unless it may be a misspelt one that other parts depend on.
    for mistaken_key in mistaken_keys:
        for near_key in get_close_matches(mistaken_key, known_keys, 1, _LEAST_SIMILARITY):
            if near_key not in _INDEPENDENT_KEYS:
                return None
    # Any name will do if the config's is mistaken: an experiment with mistakes is not run.
    data: dict[str, object] = {"name": "mistaken"}
    for key, value in source.data.items():
        if key not in mistaken_keys:
            data[key] = value
    # With a source of its own, since the mistakes of the other keys are in ``source`` already.
    return build(Settings, Source(source.data), (), data)


def check_components(source: Source) -> None:
    """Add the mistakes within the scenario, filters, tables and figures to the source.

    Each is checked for itself: the components that it builds are not used.
    """
    if isinstance(source.data.get("scenario"), dict):
        build_kind("scenarios", source, ("scenario",))
    for group in ("filters", "tables", "figures"):
        if isinstance(source.data.get(group), dict):
            for label in source.data[group]:
                build_kind(group, source, (group, label))
