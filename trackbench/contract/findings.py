"""Findings of the contract: verdicts on checks, lines of a report, and the breaches behind them."""

from collections.abc import Iterator
from typing import Literal, NamedTuple


class ContractError(Exception):
    """Breach of the contract, in one line."""


class LeftOutError(Exception):
    """Reason why a check does not apply."""


class Finding(NamedTuple):
    """Result of one check: its name, the verdict, and the reason."""

    check: str
    verdict: Literal["good", "bad", "left out"]
    why: str = ""

    def __str__(self) -> str:
        line = f"{self.verdict:>8}  {self.check}"
        if self.why:
            line += f": {self.why}"
        return line


def report(findings: dict[str, list[Finding]]) -> Iterator[str]:
    """Yield the lines of a report on each filter, given by its kind or by its label in a config."""
    for kind, findings_of_kind in findings.items():
        yield f"{kind}:"
        for finding in findings_of_kind:
            yield f"  {finding}"
