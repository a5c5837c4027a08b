"""Steps and times of a scenario, from the keys T, first and last."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.random_streams import Streams
from trackbench.core.read_only import fixed
from trackbench.field_types import MOST_STEPS, InvalidKeyError
from trackbench.models.base import Motion, SampledMotion
from trackbench.models.inputs import KnownInputs, inputs_in_equations
from trackbench.models.motions.sampling_interval import sample_equally
from trackbench.models.motions.unequal_intervals import Irregular
from trackbench.scenarios.targets.recordings_of_runs import recorded_columns


class Timeline(NamedTuple):
    """Steps of a scenario, those that a start uses up included."""

    steps: Index
    """numbers k (K,) of the steps"""
    times: Array
    """times (K,), s"""
    T: float
    """time between two steps, s; that of the first two if the steps are not equal"""
    equal: bool = True
    """True if all steps are equally far apart, as those of simulated data"""
    apart: Array | float | None = None
    """time between the two scans of a start, s; (M,) if it differs from run to run; None: T"""
    inputs: KnownInputs | None = None
    """recorded inputs of motions, if there are any"""

    def sampled(self, motion: Motion, axes: int) -> SampledMotion:
        """Return a motion from step to step, over the intervals between these steps.

        Parameters
        ----------
        motion : Motion
            Motion as the config names it.
        axes : int
            Number of axes of the space.

        Returns
        -------
        SampledMotion
            Motion, with the values of its inputs. It is an `Irregular` if the steps are not equal.

        Raises
        ------
        InvalidKeyError
            For a motion that needs steps of equal length, or inputs that are not recorded.
        """
        if self.equal:
            return sample_equally(motion, self.T, axes, self.inputs)
        if motion.uses_time:
            message = "the motion depends on the time t = k T, and these steps are not equal"
            raise InvalidKeyError(message, "assume")
        # Check the inputs here, where a mistake is reported with its key.
        inputs_in_equations(motion, self.inputs)
        intervals = fixed(np.diff(self.times))
        return Irregular(
            motion=motion,
            axes=axes,
            # the number of the step at which the first interval ends
            first=int(self.steps[1]),
            intervals=intervals,
            recorded_inputs=self.inputs,
        )

    def between_scans(self, rng: Streams) -> Array | float:
        """Return the time between the two scans of a start.

        Parameters
        ----------
        rng : Streams
            Streams, which have the numbers of M runs.

        Returns
        -------
        array (M,) or float
            Time, s. It is an array if recorded runs differ in it, NaN for runs without a recording.
        """
        if self.apart is None:
            return self.T
        if isinstance(self.apart, np.ndarray):
            return recorded_columns(self.apart, rng)
        return self.apart


class Schedule(NamedTuple):
    """Steps of a run as the keys of the config have them."""

    first: int
    """number of the first step"""
    last: int | None
    """number of the last step, if the config has it"""
    begin: float | None
    """time of the first step, s, if the config has it"""
    skipped: int
    """number of steps before that of the first state"""

    def check(self, recorded: Timeline | None) -> None:
        """Raise InvalidKeyError if the keys, or the ``recorded`` steps, leave no step or too many.

        Parameters
        ----------
        recorded : Timeline or None
            Recorded steps. None for a simulated target.

        Raises
        ------
        InvalidKeyError
            For a run without a measured step, or with more than ``MOST_STEPS``. Also for a missing key
            ``last`` of a simulated target, and for a key ``first`` of a recorded one.
        """
        if recorded is not None:
            self._check_recorded(recorded)
            return
        # The keys must give a step after the start's scans, and not too many.
        if self.last is None:
            raise InvalidKeyError("`last` is required: the target has no steps of its own")
        if self.last - self.first > MOST_STEPS:
            raise InvalidKeyError(f"more than {MOST_STEPS} steps", "last")
        begun = self.first + self.skipped
        if self.last <= begun:
            message = f"{self.last} leaves no step to measure after step {begun}"
            raise InvalidKeyError(message, "last")

    def _check_recorded(self, recorded: Timeline) -> None:
        """Raise InvalidKeyError for keys that do not fit the recorded steps, or leave too many."""
        # Recorded data number the steps: only the last one can be chosen.
        if self.first:
            raise InvalidKeyError("the recorded data say it", "first")
        # The step of the first state is not measured, or the start uses up its scan. `skipped` is the
        # number of steps before it, whose scans the start uses up, too.
        measured = recorded.steps[self.skipped + 1 :]
        if not len(measured):
            raise InvalidKeyError("the recording has no step after those that the start uses up")
        if self.last is not None and not measured[0] <= self.last <= measured[-1]:
            message = f"what is recorded is measured in steps {measured[0]} to {measured[-1]}"
            raise InvalidKeyError(message, "last")
        # The step of the first state counts, too.
        taken = len(self.cut_and_shift(recorded).steps) - self.skipped
        if taken > MOST_STEPS:
            latest = int(recorded.steps[self.skipped + MOST_STEPS - 1])
            message = f"the recording gives {taken} steps, more than {MOST_STEPS}"
            way = f"say `last: {latest}`, choose runs, or a longer `resample`"
            raise InvalidKeyError(f"{message}: {way}")

    def simulated_timeline(self, T: float) -> Timeline:
        """Return every step, T s apart."""
        assert self.last is not None
        steps = np.arange(self.first, self.last + 1)
        times = np.asarray((steps - self.first) * T + (self.begin or 0.0))
        return Timeline(steps=steps, times=times, T=T)

    def cut_and_shift(self, recorded: Timeline) -> Timeline:
        """Return the recorded steps up to the key `last`, shifted to start at the key `begin`.

        Parameters
        ----------
        recorded : Timeline
            Recorded steps.

        Returns
        -------
        Timeline
            The K steps of the scenario, those that the start uses up included.
        """
        if self.last is not None:
            end = int(np.searchsorted(recorded.steps, self.last, side="right"))
            recorded = recorded._replace(steps=recorded.steps[:end], times=recorded.times[:end])
        if self.begin is None or self.begin == recorded.times[0]:
            return recorded
        # Shift all times so that the first one is `begin`.
        shift = self.begin - recorded.times[0]
        return recorded._replace(times=recorded.times + shift)
