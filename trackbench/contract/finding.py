"""What a check of the contract says."""

from typing import Literal, NamedTuple


class Finding(NamedTuple):
    """One check of the contract: what was looked at, how it went, and why."""

    check: str
    verdict: Literal["good", "bad", "left out"]
    why: str = ""

    def __str__(self) -> str:
        return f"{self.verdict:>8}  {self.check}" + (f": {self.why}" if self.why else "")


class BrokenError(Exception):
    """The filter does not do what it promised."""
