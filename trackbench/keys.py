"""Types for config keys: a dataclass field's type says what a YAML may put there."""

from typing import Annotated

from annotated_types import Ge, Gt, Interval

Count = Annotated[int, Ge(1)]
Natural = Annotated[int, Ge(0)]
Positive = Annotated[float, Gt(0), Interval(lt=float("inf"))]
NonNegative = Annotated[float, Ge(0), Interval(lt=float("inf"))]
Finite = Annotated[float, Interval(gt=float("-inf"), lt=float("inf"))]
Share = Annotated[float, Interval(ge=0, le=1)]
"""A number in [0, 1]."""
OpenShare = Annotated[float, Interval(gt=0, lt=1)]
"""A number in (0, 1)."""


class MistakenKeyError(ValueError):
    """A mistake in a key, or in an item of a list, of the dataclass that is being made."""

    def __init__(self, what: str, *path: str | int) -> None:
        super().__init__(what)
        self.path = path
