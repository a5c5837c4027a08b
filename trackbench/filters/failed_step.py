"""Run and steps at which a filter raised an error, noted on the error itself."""

from typing import NamedTuple

_ATTRIBUTE = "_trackbench_failed_step"


class FailedStep(NamedTuple):
    """Place of a filter's error; each part is None if it is unknown."""

    run: int | None = None
    """run, counted from the first that the filter was given"""
    first: int | None = None
    """first of the steps that the filter made, as index of `Scenario.steps`; 0 for the first state"""
    last: int | None = None
    """last of these steps: a filter may make many steps in one call"""


def note_failed_step(error: BaseException, place: FailedStep) -> None:
    """Note the place of an error on it; parts that are noted already stay."""
    noted = vars(error).get(_ATTRIBUTE, FailedStep())
    vars(error)[_ATTRIBUTE] = _merged(noted, place)


def failed_step(error: BaseException) -> FailedStep:
    """Return the place noted on an error, or on an error that caused it."""
    place = FailedStep()
    linked_error: BaseException | None = error
    while linked_error is not None:
        place = _merged(place, vars(linked_error).get(_ATTRIBUTE, FailedStep()))
        linked_error = linked_error.__cause__ or linked_error.__context__
    return place


def _merged(place: FailedStep, other: FailedStep) -> FailedStep:
    """Return the place, with the run and the steps of the other one where it has none."""
    if place.run is None:
        place = place._replace(run=other.run)
    if place.first is None:
        place = place._replace(first=other.first, last=other.last)
    return place


class StepsUnderWay:
    """Context that notes on an error which steps the filter was making.

    Set ``first`` and ``last`` within it, as indices of `Scenario.steps`; None between steps, as in the
    backward pass of a smoother.
    """

    first: int | None = 0
    last: int | None = 0

    def __enter__(self) -> "StepsUnderWay":
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if error is not None:
            note_failed_step(error, FailedStep(first=self.first, last=self.last))


class RunUnderWay:
    """Context that notes on an error in which run the filter was, by its attribute ``run``."""

    run: int | None = None

    def __enter__(self) -> "RunUnderWay":
        return self

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if error is not None:
            note_failed_step(error, FailedStep(run=self.run))
