"""Which steps a scenario has and when they are: as its keys say, or as the target's own data do."""

from typing import NamedTuple

import numpy as np

from trackbench.field_types import MOST_STEPS, InvalidKeyError
from trackbench.scenarios.targets.base import Timeline


class Schedule(NamedTuple):
    """Numbers of the first and the last step and the first one's time, s, as the keys have them.

    ``skipped`` steps come before that of the first state.
    """

    first: int
    last: int | None
    begin: float | None
    skipped: int

    def check(self, own: Timeline | None) -> None:
        """Raise InvalidKeyError if there is no step, or are too many, of these or the target's own."""
        if own is not None:
            # Recorded data number the steps: only the last one can be chosen.
            if self.first:
                raise InvalidKeyError("the recorded data say it", "first")
            steps = own.steps[self.skipped + 1 :]
            if self.last is not None and not steps[0] <= self.last <= steps[-1]:
                what = f"what is recorded is measured in steps {steps[0]} to {steps[-1]}"
                raise InvalidKeyError(what, "last")
            return
        # Otherwise the keys must give a step after the start's scans, and not too many.
        if self.last is None:
            raise InvalidKeyError("`last` is required: the target has no steps of its own")
        if self.last - self.first > MOST_STEPS:
            raise InvalidKeyError(f"more than {MOST_STEPS} steps", "last")
        begun = self.first + self.skipped
        if self.last <= begun:
            what = f"{self.last} leaves no step to measure after step {begun}"
            raise InvalidKeyError(what, "last")

    def regular(self, T: float) -> Timeline:
        """Return every step, T s apart."""
        assert self.last is not None
        steps = np.arange(self.first, self.last + 1)
        return Timeline(steps, np.asarray((steps - self.first) * T + (self.begin or 0.0)), T)

    def of_recorded(self, own: Timeline) -> Timeline:
        """Return the target's own steps up to the last, begun when the keys say."""
        if self.last is not None:
            end = int(np.searchsorted(own.steps, self.last, side="right"))
            own = own._replace(steps=own.steps[:end], times=own.times[:end])
        # Shift all times so that the first one is `begin`.
        shift = 0.0 if self.begin is None else self.begin - own.times[0]
        return own._replace(times=own.times + shift) if shift else own
