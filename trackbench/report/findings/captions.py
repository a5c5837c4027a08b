"""Captions: the result of a figure in one sentence."""

from collections.abc import Mapping
from math import isfinite, log

from trackbench.metrics import Better
from trackbench.report.findings.phrases import named, three_digits

_FIRST = 3
_BEST = {
    "lower": ("lowest", "highest"),
    "higher": ("highest", "lowest"),
    "zero": ("nearest zero", "farthest"),
    "one": ("nearest one", "farthest"),
}


def ranking(values: Mapping[str, float], better: Better, what: str) -> str:
    """Return ``Averaged over the steps, lowest: A (0.0042), B (0.010), C (0.2); highest: D (0.3).``

    Empty of a metric that only describes, and of fewer than two numbers.
    """
    there = {label: value for label, value in values.items() if isfinite(value)}
    if not better or len(there) < 2:
        return ""
    if len(alike := {three_digits(value) for value in there.values()}) == 1:
        return f"{what}, all have {alike.pop()}."
    order = sorted(there, key=lambda label: _far(there[label], better))
    first, last = _BEST[better]
    told = [f"{named(label)} ({three_digits(there[label])})" for label in order]
    rest = f"; {last}: {told[-1]}" if len(told) > _FIRST else ""
    return f"{what}, {first}: {', '.join(told[:_FIRST])}{rest}."


def _far(value: float, better: Better) -> float:
    if better == "one":
        return abs(log(value)) if value > 0.0 else float("inf")
    return {"lower": value, "higher": -value}.get(better, abs(value))


def sentences(*parts: str) -> str:
    """Join the nonempty sentences."""
    return " ".join(filter(None, parts))
