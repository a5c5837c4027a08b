"""Scoring: errors of a track, scored steps and windows, and the limit of a lost run."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
from annotated_types import Interval
from pydantic import StringConstraints

from trackbench.core.arrays import Array, Index, Mask, as_slice
from trackbench.field_types import (
    ONE_LINE,
    InvalidKeyError,
    Natural,
    Positive,
    check_window_name,
    freeze_mappings,
)
from trackbench.metrics import NAME_OF_PREDICTION, is_of_prediction
from trackbench.models.component_names import has_position_and_velocity
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.stacked import Sensors


@dataclass(frozen=True, kw_only=True)
class Window:
    """Some of the steps that are scored, under a name."""

    name: Annotated[str, StringConstraints(pattern=ONE_LINE, max_length=80)]
    """what metrics carry in brackets: rmse_position[early]"""
    first: Natural | None = None
    """first step; default: from the start"""
    last: Natural | None = None
    """last step; default: to the end"""

    def __post_init__(self) -> None:
        check_window_name(self.name)
        if self.first is not None and self.last is not None and self.first > self.last:
            message = f"ends at step {self.last}, before its first, {self.first}: exchange them"
            raise InvalidKeyError(message, "last")

    def overlaps(self, first: int, last: int) -> bool:
        """Test whether a step of the window is one of ``first`` to ``last``."""
        end = last if self.last is None else min(last, self.last)
        return max(first, self.first or 0) <= end


@dataclass(frozen=True, kw_only=True)
class Score:
    """Errors of position and velocity, or of each component of another state, and those of a sensor."""

    steps: tuple[Natural | None, Natural | None] = (None, None)
    """first and last step that are scored, [20, null]; null: from the first state's on, to the last"""
    train: Annotated[float, Interval(gt=0.0, lt=1.0)] | None = None
    """of recorded data: share of their time, from the start on, that `tune` sees; the steps after it
    are those that are scored"""
    windows: tuple[Window, ...] = ()
    """parts of those steps with metrics of their own"""
    errors: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """further errors by name, each of some components: {position: [px, py]} gives rmse_position;
    default: position and velocity, or each component of a state that has neither"""
    marginals: tuple[Literal["position", "velocity"], ...] = ()
    """parts of the state with a consistency measure of their own: anees_position"""
    lost_beyond: Positive | None = None
    """error beyond which a run counts as lost, in the unit of the first quantity; default: never"""
    lost_sigmas: Positive | None = None
    """the same in standard deviations of a position that one scan tells at the first state"""

    def __post_init__(self) -> None:
        freeze_mappings(self)
        if self.lost_beyond is not None and self.lost_sigmas is not None:
            raise ValueError("give one of lost_beyond and lost_sigmas")
        names = [window.name for window in self.windows]
        for i, name in enumerate(names):
            if name in names[:i]:
                message = f"there are two windows {name!r}: give each a name of its own"
                raise InvalidKeyError(message, "windows", i, "name")

    def check(self, components: tuple[str, ...], steps: Index) -> None:
        """Raise InvalidKeyError for scored steps outside the run, and for unknown parts of the state.

        Parameters
        ----------
        components : tuple of str
            Names of the components of the target's state, in order.
        steps : array of int (K,)
            Numbers of the steps, the prior's first.

        Raises
        ------
        InvalidKeyError
            Also for a component or an error whose name cannot be used.
        """
        # The ends of the run stand for steps that the config leaves out.
        first, last = self.steps
        if first is None:
            first = steps[0]
        if last is None:
            last = steps[-1]
        if not max(first, steps[0]) <= last <= steps[-1]:
            message = f"[{first}, {last}] is not within steps {steps[0]} to {steps[-1]}"
            raise InvalidKeyError(message, "score", "steps")
        if self.marginals and not has_position_and_velocity(components):
            # The state is not position and velocity.
            raise InvalidKeyError("the state has no such parts", "score", "marginals")
        for i, component in enumerate(components):
            if is_of_prediction(component):
                message = f"a component cannot be named {component!r}, {NAME_OF_PREDICTION}"
                raise InvalidKeyError(message, "target", "motion", "components", i)
        # Further errors: a usable name, and known components.
        for name, group in self.errors.items():
            if not name.isidentifier():
                message = f"{name!r} cannot be the name of an error: letters, digits and _"
                raise InvalidKeyError(message, "score", "errors", name)
            if is_of_prediction(name):
                message = f"{name!r} cannot be the name of an error, {NAME_OF_PREDICTION}"
                raise InvalidKeyError(message, "score", "errors", name)
            for i, component in enumerate(group):
                if component not in components:
                    message = f"{component!r} is no component; known: {', '.join(components)}"
                    raise InvalidKeyError(message, "score", "errors", name, i)
                if component in group[:i]:
                    message = f"{component!r} is given twice, and would count twice"
                    raise InvalidKeyError(message, "score", "errors", name, i)
            if not group:
                raise InvalidKeyError("name its components", "score", "errors", name)

    def last_training_step(self, steps: Index, times: Array) -> int | None:
        """Return the number of the last training step.

        Parameters
        ----------
        steps : array of int (K,)
            Numbers of the steps.
        times : array (K,)
            Their times, s, of which training gets the share ``train``.

        Returns
        -------
        int or None
            Number. None if all steps are scored.
        """
        if self.train is None:
            return None
        return last_step_of_share(self.train, steps, times)

    def check_training(
        self, trained: int, steps: Index, recorded_runs: int | None, is_any_scored: bool
    ) -> None:
        """Raise InvalidKeyError if training or scoring has no steps.

        Parameters
        ----------
        trained : int
            Number of the last training step.
        steps : array of int (K,)
            Numbers of the scenario's steps, the prior's first.
        recorded_runs : int or None
            Number of recorded runs. None for simulated ones.
        is_any_scored : bool
            True if a step after the training is scored.

        Raises
        ------
        InvalidKeyError
            Also for simulated runs, which have training runs of their own.
        """
        if recorded_runs is None:
            message = "training has runs of its own: only what is recorded is shared out"
            raise InvalidKeyError(message, "score", "train")
        if not is_any_scored:
            raise InvalidKeyError("leaves no step to be scored", "score", "train")
        if trained <= steps[0]:
            raise InvalidKeyError("leaves no step to train on", "score", "train")
        self.cut_to_training(trained)  # raises if none of the training's steps is scored

    def cut_to_training(self, last: int) -> "Score":
        """Return the scoring of the training's steps.

        Parameters
        ----------
        last : int
            Number of the last training step.

        Returns
        -------
        Score
            Scoring of the steps up to ``last``, with those windows that have one of them.

        Raises
        ------
        InvalidKeyError
            If none of these steps is scored.
        """
        first, end = self.steps  # None stands for an end of the run
        if first is not None and first > last:
            message = f"training sees steps up to {last}, and none is scored before {first}"
            raise InvalidKeyError(message, "score", "steps")
        end = last if end is None else min(end, last)
        # Drop windows without a step of the training; 0 is the least number of a step.
        windows = tuple(window for window in self.windows if window.overlaps(first or 0, end))
        # The training has no training of its own.
        return replace(self, train=None, steps=(first, end), windows=windows)

    def scored_steps(self, steps: Index, trained: int | None = None) -> Mask:
        """Return which steps are scored.

        Parameters
        ----------
        steps : array of int (K,)
            Numbers of the steps.
        trained : int, optional
            Number of the last training step, up to which none is scored. None without training.

        Returns
        -------
        array of bool (K,)
            True for a scored step.
        """
        first, last = self.steps
        scored = _between(steps, first, last)
        if trained is not None:
            scored &= steps > trained
        return scored

    def windows_by_name(self, steps: Index, scored: Mask) -> dict[str, Mask]:
        """Return the scored steps of each window.

        Parameters
        ----------
        steps : array of int (K,)
            Numbers of the steps.
        scored : array of bool (K,)
            True for the steps that are scored.

        Returns
        -------
        dict of array of bool (K,)
            Scored steps by the window's name.
        """
        return {
            window.name: scored & _between(steps, window.first, window.last)
            for window in self.windows
        }

    def check_windows(
        self, steps: Index, scored: Mask, taken: Mapping[str, Mask]
    ) -> dict[str, Mask]:
        """Return the scored steps of each window, which must have one.

        Parameters
        ----------
        steps : array of int (K,)
            Numbers of the steps.
        scored : array of bool (K,)
            True for the steps that are scored.
        taken : mapping of str to array of bool (K,)
            Windows of the target.

        Returns
        -------
        dict of array of bool (K,)
            Scored steps by the window's name.

        Raises
        ------
        InvalidKeyError
            For a window without a scored step, and for a name that is one of the target's own windows.
        """
        windows = self.windows_by_name(steps, scored)
        for i, (name, mask) in enumerate(windows.items()):
            if not mask.any():
                first, last = steps[scored][[0, -1]]
                message = f"holds no scored step; steps {first} to {last} are scored"
                raise InvalidKeyError(message, "score", "windows", i)
            if name in taken:
                message = f"the target itself has a window {name!r}: choose another name"
                raise InvalidKeyError(message, "score", "windows", i, "name")
        return windows

    def error_vectors(
        self, sensor: Sensors, components: tuple[str, ...], mean: Array, truth: Array
    ) -> dict[str, Array]:
        """Return error vectors by quantity.

        Parameters
        ----------
        sensor : Sensors
            True sensor, or all sensors as one.
        components : tuple of str
            Names of the n_x components of the state, in order.
        mean, truth : array (n_x, *batch)
            Estimates and true states.

        Returns
        -------
        dict of array (d, *batch)
            Error of each quantity. A scalar state has the quantity ``""``. If the state is position and
            velocity along each axis, and there is one sensor, errors in its coordinates follow, such as
            range and azimuth.
        """
        error = mean - truth
        vectors = {}
        for name, rows in self._rows_by_error(components).items():
            vectors[name] = error[as_slice(rows)]
        # A sensor computes the errors in its coordinates from positions and velocities. Several sensors
        # are joined to a `StackedSensor`, which is no `SensorBase`, and have no such errors.
        if has_position_and_velocity(components) and isinstance(sensor, SensorBase):
            vectors |= sensor.errors(mean, truth)
        return vectors

    def _rows_by_error(self, components: tuple[str, ...]) -> dict[str, list[int]]:
        """Return the rows of a state of ``components`` that make up each error, by the error's name."""
        n = len(components)
        if has_position_and_velocity(components):
            rows = {"position": list(range(0, n, 2)), "velocity": list(range(1, n, 2))}
        elif n == 1:
            rows = {"": [0]}  # the metric of a scalar is rmse, without a name
        else:
            rows = {name: [i] for i, name in enumerate(components)}
        # Further errors of the config, each of a group of components, may replace one of these.
        for name, group in self.errors.items():
            rows[name] = [components.index(component) for component in group]
        return rows

    def squares(
        self, sensor: Sensors, components: tuple[str, ...], P: Array, x: Array
    ) -> dict[str, Array]:
        """Return mean squared errors of the quantities of `error_vectors`.

        Parameters
        ----------
        sensor : Sensors
            True sensor, or all sensors as one.
        components : tuple of str
            Names of the n_x components of the state, in order.
        P : array (n_x, n_x, K)
            Covariances of the state's error.
        x : array (n_x, K)
            States at which they hold.

        Returns
        -------
        dict of array (K,)
            Mean squared error of each quantity.
        """
        # Mean squared error = trace of P over the quantity's components.
        squares = {}
        for name, rows in self._rows_by_error(components).items():
            squares[name] = np.add.reduce([P[i, i] for i in rows])
        # A sensor computes the errors in its coordinates from positions and velocities. Several sensors
        # are joined to a `StackedSensor`, which is no `SensorBase`, and have no such errors.
        if has_position_and_velocity(components) and isinstance(sensor, SensorBase):
            squares |= sensor.squares(P, x)
        return squares


def _between(steps: Index, first: int | None, last: int | None) -> Mask:
    """Return which of ``steps`` (K,) are from first to last; None stands for an end of the run."""
    inside = np.ones(len(steps), dtype=np.bool_)
    if first is not None:
        inside &= steps >= first
    if last is not None:
        inside &= steps <= last
    return inside


def last_step_of_share(share: float, steps: Index, times: Array) -> int:
    """Return the number of the last training step, if training gets a share of the time.

    Parameters
    ----------
    share : float
        Share of the time from the first step to the last, 0 to 1.
    steps : array of int (K,)
        Numbers of the steps.
    times : array (K,)
        Their times, s.

    Returns
    -------
    int
        Number of the last step within the share.
    """
    within = times - times[0] <= share * (times[-1] - times[0])
    return int(steps[np.count_nonzero(within) - 1])
