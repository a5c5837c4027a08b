"""Last step of a new config, if a recording is too long, and a truth that begins after it."""

from trackbench.field_types import MOST_STEPS, DataError, Place
from trackbench.scenarios.recordings.guess_record import Guess
from trackbench.scenarios.recordings.guess_truth import TruthGuess, steps_before_truth

_LAST = 20_000  # step of a long recording, which all filters reach within minutes


def last_line(guess: Guess, truth: TruthGuess | None) -> str:
    """Return the line of the key `last`, the last step, if the recording has too many; else empty.

    It is so late that a truth which begins late has many steps, too.
    """
    if guess.steps <= MOST_STEPS:
        return ""
    last = min(steps_before_truth(guess, truth) + _LAST, MOST_STEPS)
    many = f"of {guess.steps} steps, of which {MOST_STEPS} are possible; or say `resample`"
    return f"\n  last: {last}  # {many}"


def check_late_truth(guess: Guess, truth: TruthGuess | None) -> None:
    """Raise DataError if the truth begins after so many steps that a scenario would end before."""
    before = steps_before_truth(guess, truth)
    if guess.steps <= MOST_STEPS or before < MOST_STEPS:
        return
    message = f"the truth begins some {before} steps after these rows, and a run has at most"
    remedy = "leave out the rows before the truth, or all but every n-th row"
    raise DataError(Place(guess.path, 1, 1, f"{message} {MOST_STEPS} steps: {remedy}"))
