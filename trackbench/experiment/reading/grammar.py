"""How it is written what a published number or claim is measured by.

``mean(rmse)`` is a statistic over runs, ``rmse@20`` a metric at a step, ``anees`` a row of a summary.
``gain(mean(rmse), PF)``, ``ratio``, ``minus`` and ``below(rmse, PF)``, the share of the runs in which
the metric is below PF's, are of two filters. ``rmse@3..last`` is at every one of these steps.
"""

import re
from collections.abc import Iterable

from trackbench.evaluation.statistics import STATISTICS

STATISTIC = re.compile(rf"({'|'.join(STATISTICS)})\((.+)\)")
COMPOSED = re.compile(r"(gain|ratio|minus|below)\((.+?\)?), (.+)\)")
STEP = re.compile(r"(.+)@(\d+|last)")
STEPS = re.compile(r"@(\d+)\.\.(\d+|last)")

_NAME = r"[A-Za-z_][\w.-]*(?:\[[^\]]*\])?"
_AT = r"(?:\d+(?:\.\.(?:\d+|last))?|last)"
_PLAIN = rf"(?:{_NAME}\({_NAME}\)|{_NAME}@{_AT}|{_NAME})"
EXPRESSION = re.compile(rf"{_PLAIN}|(?:gain|ratio|minus|below)\({_PLAIN}, (?P<other>.+)\)")


def plain(expression: str) -> str:
    """What an expression of two filters takes of each of them; any other one itself."""
    composed = COMPOSED.fullmatch(expression)
    return composed.group(2) if composed else expression


def at_each_step(expression: str, steps: Iterable[int]) -> list[str]:
    """An expression of many steps at each of those that there are; any other one itself."""
    wanted = STEPS.search(expression)
    if wanted is None:
        return [expression]
    first, last = wanted.groups()
    inside = (k for k in steps if k >= int(first) and (last == "last" or k <= int(last)))
    return [STEPS.sub(f"@{k}", expression) for k in inside]
