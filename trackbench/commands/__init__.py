"""Commands shared by the command line and Python, and the check of their keyword arguments.

A misspelt keyword of a Python function is a UserError, not a TypeError.
"""

from collections.abc import Callable, Iterable
from functools import wraps
from inspect import Parameter, signature
from typing import ParamSpec, TypeVar

from trackbench.config.mistakes import unknown
from trackbench.errors import UserError

P = ParamSpec("P")
R = TypeVar("R")


def check_keywords(name: str, keywords: Iterable[str], known: list[str]) -> None:
    """Raise UserError with a line for each keyword that the function does not have."""
    wrong = [word for word in keywords if word not in known]
    if wrong:
        raise UserError(*(f"{name}() has no option {w!r}; {unknown(w, known)}" for w in wrong))


def with_known_keywords(*options: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a function to raise UserError for an unknown keyword argument.

    ``options`` are the keywords that the decorated function accepts as ``**changes``.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        named = signature(function).parameters.values()
        known = [p.name for p in named if p.kind is not Parameter.VAR_KEYWORD] + [*options]

        @wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            check_keywords(function.__name__, kwargs, known)
            return function(*args, **kwargs)

        return checked

    return decorate
