"""Run and steps at which a filter raised an error, noted on the error itself."""

from dataclasses import dataclass
from typing import NamedTuple

from trackbench.errors import linked_errors

_ATTRIBUTE = "_trackbench_failed_step"


class FailedStep(NamedTuple):
    """Place of a filter's error; each part is None if it is unknown."""

    run: int | None = None
    """run, counted from the first that the filter was given"""
    first: int | None = None
    """first of the steps that the filter made, as index of `Scenario.steps`; 0 for the first state"""
    last: int | None = None
    """last of these steps: a filter may make many steps in one call"""


def failed_step(error: BaseException) -> FailedStep:
    """Return the place noted on an error, or on an error that caused it.

    Parameters
    ----------
    error : BaseException
        Error of a filter, or one that was raised because of it.

    Returns
    -------
    FailedStep
        Run and steps; each part is None if no error has it.
    """
    place = FailedStep()
    for linked_error in linked_errors(error):
        place = _merged(place, vars(linked_error).get(_ATTRIBUTE, FailedStep()))
    return place


def _merged(place: FailedStep, other: FailedStep) -> FailedStep:
    """Return the place, with the run and the steps of the other one where it has none."""
    if place.run is None:
        place = place._replace(run=other.run)
    if place.first is None:
        place = place._replace(first=other.first, last=other.last)
    return place


@dataclass
class UnderWay:
    """Context that notes on an error in which run, and in which steps, the filter was.

    Set the attributes within it; they are those of a `FailedStep`. ``first`` and ``last`` are None
    between steps, as in the backward pass of a smoother. Parts that are noted on an error already stay.
    """

    run: int | None = None
    first: int | None = None
    last: int | None = None

    def __enter__(self) -> "UnderWay":
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if error is not None:
            noted = vars(error).get(_ATTRIBUTE, FailedStep())
            place = FailedStep(run=self.run, first=self.first, last=self.last)
            vars(error)[_ATTRIBUTE] = _merged(noted, place)
