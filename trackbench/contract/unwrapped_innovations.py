"""Measured angles whose innovation a filter does not wrap: a whole turn changes its estimates."""

from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackbench.contract.estimates import Estimates, deviation, run_filter
from trackbench.contract.problems import ModelDraws
from trackbench.contract.turned_priors import Angle, angles_of
from trackbench.core import linalg
from trackbench.core.angles import near
from trackbench.core.arrays import Mask
from trackbench.filters.base import AnyFilter
from trackbench.models.base import Model, Sensor
from trackbench.models.model_for_programs import description_of, with_description
from trackbench.scenarios.base import Simulation

_FAR = 3.0  # standard deviations from a reference, in a run that an unwrapped angle must explain
_REMAINING = 0.2  # share of a faulty run's deviation that may remain when the angle has no cut
_STILL_FAULTY = 0.2  # share of the faulty runs that may stay faulty then


@dataclass(frozen=True, kw_only=True)
class _WithoutWrap(ModelDraws):
    """A problem whose sensor does not wrap, so that measured angles may be beyond a turn."""

    @cached_property
    def model(self) -> Model:
        """Model that filters get: the innovation of its sensor is the plain difference."""
        model = super().model
        plain: Sensor = copy(model.sensor)
        object.__setattr__(plain, "innovation", np.subtract)
        # An external filter program is sent a description, that of the sensor with the wrap. Its
        # measurements are not wrapped before they are sent, as they are with the other model.
        return with_description(Model(model.motion, plain), description_of(model))


def measured_without_cut(
    problem: ModelDraws, data: Simulation, center: Estimates, row: int, cut: float
) -> Simulation:
    """Return the data with a measured angle that is within half a turn of its prediction.

    The innovation of this angle then needs no wrap. ``row`` is the index of the angle in the
    measurement. The prediction is that of a reference filter with the estimates ``center``. It is in
    (cut - 2 pi, cut], as the tested filter may count the angle; ``cut`` is in rad.
    """
    z = data.measurements.copy()
    motion, sensor = problem.model
    for i, k in enumerate(problem.steps[1:].tolist()):
        predicted = np.asarray(motion.transition(center.mean[:, i], k).mean)
        expected = np.asarray(sensor.measurement(predicted, k).mean)
        innovation = sensor.innovation(z[:, i], expected)[row]
        # The whole turns by which the expected angle is above (cut - 2 pi, cut].
        whole_turns = 2.0 * np.pi * np.ceil((expected[row] - cut) / (2.0 * np.pi))
        z[row, i] = expected[row] - whole_turns + innovation
    return data._replace(measurements=z)


def name_of_unwrapped(
    tracker: AnyFilter, problem: ModelDraws, data: Simulation, tested: Estimates, center: Estimates
) -> str:
    """Name the measured angle whose innovation a filter does not wrap; empty if there is none.

    ``tested`` are the estimates of the filter from the ``data``, ``center`` those of a reference. In
    some runs they are far from each other. The named angle is the first one for which most of these runs
    are right once it is measured without a cut, a value at which its numbers jump by a turn.
    """
    rows = problem.angle_rows  # of the state
    deviations = deviation(tested, center, rows)  # (M,), in standard deviations
    is_far = deviations > _FAR
    if not is_far.any():
        return ""
    # With the problem's own sensor, measurements or innovations would be wrapped for the filter.
    unwrapped_problem = _without_wrap(problem)
    for angle in angles_of(problem):
        if angle.kind == "state":
            continue
        # A filter counts the angle from -pi to pi, or from 0 to 2 pi.
        for cut in (np.pi, 2.0 * np.pi):
            shifted = measured_without_cut(problem, data, center, angle.row, cut)
            estimates = run_filter(tracker, unwrapped_problem, shifted)
            is_still_wrong = deviation(estimates, center, rows) > _REMAINING * deviations
            if is_still_wrong[is_far].mean() <= _STILL_FAULTY:
                return angle.name
    return ""


def _without_wrap(problem: ModelDraws) -> ModelDraws:
    """Return the problem with a sensor that does not wrap its innovations."""
    return _WithoutWrap(base=problem.base, unequal=problem.unequal)


def is_unwrapped(
    tracker: AnyFilter,
    problem: ModelDraws,
    angle: Angle,
    data: Simulation,
    center: Estimates,
    is_elsewhere: Mask,
) -> bool:
    """Test whether a whole turn added to some measurements of an angle changes the estimates.

    It does not change those of a filter that wraps the innovation of the angle. ``center`` are the
    estimates of the best reference filter from the ``data``. Only the runs ``is_elsewhere`` (M,) count,
    in which the angle is far from any cut, a value at which its numbers jump. In half of them an
    estimate must change by more than a standard deviation of ``center``.
    """
    # Measured angles are wrapped before an external program gets them, unless the sensor does not wrap.
    sent_problem = _without_wrap(problem) if tracker.runs_program else problem
    before = run_filter(tracker, sent_problem, data)
    sigma = np.sqrt(linalg.diagonal(center.cov))
    for whole_turn in (2.0 * np.pi, -2.0 * np.pi):
        z = data.measurements.copy()
        z[angle.row, ::2] += whole_turn
        after = run_filter(tracker, sent_problem, data._replace(measurements=z))
        mean = near(after.mean, before.mean, problem.angle_rows)
        # The filter's state may have further components after those of the reference's.
        change = np.abs(mean - before.mean)[: len(sigma)]
        relative_change = change / np.maximum(sigma, np.finfo(float).tiny)
        largest_change = np.nan_to_num(relative_change, nan=np.inf).max(axis=(0, 1))
        if np.median(largest_change[is_elsewhere]) > 1.0:
            return True
    return False
