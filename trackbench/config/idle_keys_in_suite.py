"""Keys of the user's own filters, set by `--set`, that have no effect on problems of a suite."""

from collections.abc import Mapping, Sequence

from trackbench.config.overrides import split_path
from trackbench.config.suite_problem_configs import AssembledProblem, FittedProblem
from trackbench.errors import Mark, Problem, UserError
from trackbench.yaml_source import Keys


def idle_set_keys(assembled: AssembledProblem, error: UserError) -> list[Keys]:
    """Return the keys that `--set` gives the user's own filters, and that have no effect here.

    ``error`` has the mistakes of the problem. The key `late`, for example, has no effect where all
    measurements arrive on time.
    """
    idle_keys = []
    for problem in error.problems:
        if isinstance(problem, Problem) and problem.message.startswith("has no effect"):
            keys = split_path(assembled.config.source, problem.path)
            is_added = len(keys) > 2 and keys[:1] == ("filters",) and keys[1] in assembled.added
            if is_added and problem.mark.file.startswith("--set "):
                idle_keys.append(keys)
    return idle_keys


def idle_overrides(paths: Mapping[str, str], fitted: Sequence[FittedProblem]) -> list[Problem]:
    """Return a mistake for each key of the user's own filters that has no effect on any problem.

    ``paths`` has the path ``filters.LABEL.KEY`` of each assignment ``PATH=VALUE`` of these keys, and
    ``fitted`` are the problems.
    """
    problems = []
    for text, path in paths.items():
        problems_of_filter = [problem for problem in fitted if not _why_left_out(problem, path)]
        if problems_of_filter and all(path in problem.idle for problem in problems_of_filter):
            message = f"has no effect {_where_idle(fitted, path)}; leave it out"
            problems.append(Problem(Mark(f"--set {text}"), path, message))
    return problems


def _where_idle(fitted: Sequence[FittedProblem], path: str) -> str:
    """Name the problems on which a key of the user's own filter has no effect.

    The key, at ``path``, may have an effect on problems that its filter is left out of. Then name these
    problems, too, with the reason on the first of them.
    """
    others = [
        problem for problem in fitted if path not in problem.idle and _why_left_out(problem, path)
    ]
    if not others:
        return "on any problem of the suite"
    names = ", ".join(problem.name for problem in others)
    return (
        f"where the filter runs, and the filter is left out of {names}: "
        f"{_why_left_out(others[0], path)}"
    )


def _why_left_out(problem: FittedProblem, path: str) -> str:
    """Return why the filter that the key at ``path`` belongs to is left out of a problem.

    The text is empty if the problem has this filter.
    """
    for label, reason in problem.left_out.items():
        if path.startswith(f"filters.{label}."):
            return reason
    return ""
