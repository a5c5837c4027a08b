"""Check the keyword arguments of Python functions: a misspelt one is a UserError, not a TypeError."""

from collections.abc import Callable, Iterable
from functools import wraps
from inspect import Parameter, signature
from typing import ParamSpec, TypeVar

from trackbench.config.did_you_mean import unknown
from trackbench.errors import UserError

P = ParamSpec("P")
R = TypeVar("R")


def check_keywords(name: str, keywords: Iterable[str], known: list[str]) -> None:
    """Raise UserError with a line for each keyword that the function does not have."""
    lines = []
    for keyword in keywords:
        if keyword not in known:
            lines.append(f"{name}() has no option {keyword!r}; {unknown(keyword, known)}")
    if lines:
        raise UserError(*lines)


def with_known_keywords(*options: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a function to raise UserError for an unknown keyword argument.

    ``options`` are the keywords that the decorated function accepts as ``**changes``.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        # The function may take any keyword, so that an unknown one gets our message and not Python's.
        parameters = signature(function).parameters.values()
        known = [p.name for p in parameters if p.kind is not Parameter.VAR_KEYWORD]
        known += options

        @wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> R:
            check_keywords(function.__name__, kwargs, known)
            return function(*args, **kwargs)

        return checked

    return decorate
