"""Test whether a filter wraps its angles: runs in which each angle passes its cut, and runs elsewhere.

The prior of a problem is turned until an angle has a chosen value some steps later; sensors and motion
stay as they are. A filter may count an angle from -pi, from 0, or from north. So the angle passes pi, 0,
pi/2 and -pi/2 in some runs, and stays between them in others, which show how far an honest filter is
from a reference filter.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import cycle, islice
from math import comb
from typing import Literal, NamedTuple

import numpy as np

from trackbench.contract.estimates import Estimates, run_filter, simulate, why_not
from trackbench.contract.problems import ModelDraws
from trackbench.core import linalg
from trackbench.core.angles import near, wrap_angle
from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Gaussian, per_run_moments
from trackbench.core.random_streams import RunStreams
from trackbench.filters.base import AnyFilter
from trackbench.filters.bootstrap_pf import PF
from trackbench.filters.ekf import EKF
from trackbench.filters.ukf import UKF
from trackbench.models.angle_components import measured_angle_rows
from trackbench.models.base import Model, Sensor
from trackbench.models.likelihood import has_own_density
from trackbench.models.model_for_programs import description_of, with_description
from trackbench.scenarios.base import Simulation

_RUNS_BY_CUT = {
    "+-pi": (np.pi, 64),
    "0": (0.0, 24),
    "pi/2": (np.pi / 2, 24),
    "-pi/2": (-np.pi / 2, 24),
}
"""Value of the angle, rad, and number of runs, by the cut that the angle passes."""
_FAR_FROM_CUTS = "elsewhere"
_ELSEWHERE = (np.pi / 4, -np.pi / 4, 3 * np.pi / 4, -3 * np.pi / 4)
_RUNS_ELSEWHERE = 24  # of each
# Numbers of steps after which the angle has its value: each run takes the next of them.
_AHEAD = (1, 2, 3, 5, 8)
_STAGES = 24  # in which a prior is turned, and a few more in which it stays
_NEWTON_STAGES = 6
_REACHED = 1e-3  # rad
_SOUND = 6.0  # standard deviations: largest error of a reference filter in a run that counts
_LEAST_SCALE = 1.0 / 3.0  # standard deviations from the reference, of filters that nearly equal it
_BEYOND = 3.0  # times the largest deviation of a run in which no angle is near a cut
_FOLLOWS = 100.0  # times a correct filter's deviation: a filter that is farther off is not judged
_LEAST_RUNS = 3  # runs beyond it that are a fault
_LEAST_SHARE = 0.05  # of a cut's runs, likewise
_CHANCE = 1e-3  # probability of such runs by chance, of a filter that draws
_FAR = 3.0  # standard deviations from a reference, in a run that an unwrapped angle must explain
_REMAINING = 0.2  # share of a faulty run's deviation that may remain when the angle has no cut
_STILL_FAULTY = 0.2  # share of the faulty runs that may stay faulty then


class Angle(NamedTuple):
    """An angle of a problem: a component of the measurement or of the state."""

    name: str
    kind: Literal["measured", "state"]
    row: int
    """index of the component in the measurement, or in the state"""


def angles_of(problem: ModelDraws) -> list[Angle]:
    """List the angles of a problem: components of its measurement, then components of its state."""
    sensor = problem.model.sensor
    angles = [Angle(sensor.components[i], "measured", i) for i in measured_angle_rows(sensor)]
    components = problem.model.motion.components
    angles += [Angle(components[i], "state", i) for i in problem.angle_rows]
    return angles


def turn(problem: ModelDraws, angle: Angle, values: Array, ahead: Array, seed: int) -> Simulation:
    """Simulate runs whose ``angle`` has the ``values`` (M,), rad, after ``ahead`` (M,) steps.

    For this the prior of each run is turned about the sensor, so that its mean, moved on without noise,
    has the value. Truth and measurements are then drawn from the problem's model. A prior for which the
    angle cannot have its value has the mean NaN.
    """
    runs = len(values)
    # Step 1: the priors of the problem, one for each run.
    model = problem.model
    known = simulate(problem, runs, seed=seed)
    prior = per_run_moments(Gaussian(known.prior.mean, known.prior.cov))
    # Step 2: turn them, and draw truth and measurements.
    turned = _Turning(problem, angle, ahead).turn_priors(prior.mean, prior.cov, values)
    for i in problem.angle_rows:
        turned.mean[i] = wrap_angle(turned.mean[i])
    reached = np.isfinite(turned.mean).all(axis=0)
    start = Gaussian(
        mean=np.where(reached, turned.mean, prior.mean),
        cov=np.where(reached, turned.cov, prior.cov),
    )
    missing = np.isnan(known.measurements)
    # The missing measurements are those of the problem. Priors and runs draw from different seeds.
    data = problem.draw_from(start, missing, RunStreams(seed + 1, range(runs)))
    # Step 3: angles are measured in (-pi, pi].
    z = data.measurements
    for i in measured_angle_rows(model.sensor):
        z[i] = wrap_angle(z[i])
    return data._replace(prior=Gaussian(np.where(reached, start.mean, np.nan), start.cov))


class _Turning:
    """Turns the prior means (n, M) of a problem about the sensor until an angle has its value later.

    A run's prior mean is moved on by the motion without noise, for the run's number of steps ``ahead``.
    There the angle must have the value, such as pi. The sensor's other components keep their values.
    """

    def __init__(self, problem: ModelDraws, angle: Angle, ahead: Array) -> None:
        """Begin with the ``angle`` to change, and the number of steps ``ahead`` (M,) of the prior.

        `turn_priors` turns the prior of each run so that the angle has a chosen value ``ahead`` steps
        after the prior.
        """
        self.model = problem.model
        self.angle = angle
        self.ahead = ahead
        self.steps = problem.steps
        # Pairs of rows (x, y) of the vectors in the plane, which rotate with the angle: position,
        # velocity and acceleration, as far as the state has them.
        components = self.model.motion.components
        self.planar = []
        for x, y in (("px", "py"), ("vx", "vy"), ("ax", "ay")):
            if x in components and y in components:
                self.planar.append((components.index(x), components.index(y)))

    def values(self, x: Array) -> Array:
        """Return the expected measurement (n_z, M) after the steps ahead, from first states x (n, M).

        If the angle is a component of the state, the state (n, M) is returned instead. The number of
        steps differs from run to run.
        """
        values = np.empty(0)
        state = x
        for i, k in enumerate(self.steps[1 : 1 + int(self.ahead.max())].tolist(), 1):
            state = np.asarray(self.model.motion.transition(state, k).mean)
            values_at_step = state
            if self.angle.kind == "measured":
                values_at_step = np.asarray(self.model.sensor.measurement(state, k).mean)
            if i == 1:
                values = values_at_step.copy()
            else:
                values = np.where(self.ahead == i, values_at_step, values)
        return values

    def jacobian(self, x: Array, columns: list[int]) -> Array:
        """Return the derivatives (m, len(columns), M) of `values` at x (n, M) by these rows of x.

        They are central differences.
        """
        derivatives = []
        for i in columns:
            upper, lower, h = _neighbors(x, i)
            difference = self.difference(self.values(upper), self.values(lower))
            derivatives.append(difference / (2.0 * h))
        return np.stack(derivatives, axis=1)

    def difference(self, a: Array, b: Array) -> Array:
        """Return the difference of two `values` (m, M), in which measured angles are wrapped."""
        if self.angle.kind == "measured":
            return self.model.sensor.innovation(a, b)
        return a - b

    def turn_priors(self, mean: Array, cov: Array, values: Array) -> Gaussian:
        """Return the turned priors, whose angle has the ``values`` (M,) after the steps `ahead`.

        ``mean`` (n, M) and ``cov`` (n, n, M) are those of the priors before. The turned mean is NaN
        where the angle cannot have its value.
        """
        row = self.angle.row
        # Measurement, or state, after each run's number of steps `ahead`: the angle is its row `row`.
        start = self.values(mean)
        whole_angle = wrap_angle(values - start[row])
        # An angle of the state is itself changed; nothing else turns with it.
        if self.angle.kind == "state":
            turned_mean = mean.copy()
            turned_mean[row] += whole_angle
            return Gaussian(turned_mean, np.array(cov))
        # Step 1: the components of the state that move, and the measured ones that keep their values.
        J = np.abs(self.measured_jacobian(mean))
        # A smaller derivative is a rounding error of the difference quotient.
        support = (1e-12 * J.max(axis=(0, 1)) < J).any(axis=-1)
        moved = [i for i in range(len(mean)) if support[row, i]]
        others = [i for i in range(len(mean)) if not support[row, i]]
        # As many equations as unknowns: the angle's, and those of some fixed components.
        rows = [row, *self._fixed_rows(support)[: len(moved) - 1]]
        # Step 2: rotate the components that the angle does not depend on by a small angle at each stage,
        # and adjust the others by Newton's method. `planar` has the pairs of rows (x, y) of vectors in
        # the plane. Only an angle that depends on such a vector is an angle in the plane.
        is_planar = any(set(pair) <= set(moved) for pair in self.planar)
        x = mean.copy()
        for stage in range(1, _STAGES + _NEWTON_STAGES + 1):
            angle = whole_angle * min(stage / _STAGES, 1.0)
            if is_planar:
                G = self.rotation(len(mean), angle)
                x[others] = np.einsum("ijm,jm->im", G, mean)[others]
            target = start.copy()
            target[row] += angle
            error = self.difference(target, self.values(x))[rows]
            D = self.jacobian(x, moved)[rows]
            inverse = np.linalg.pinv(np.moveaxis(np.nan_to_num(D), -1, 0))
            x[moved] += np.einsum("mij,jm->im", inverse, error)
        # Step 3: keep the priors whose angle has reached its value, and turn their covariances.
        final_target = start.copy()
        final_target[row] += whole_angle
        angle_error = np.abs(self.difference(final_target, self.values(x))[row])
        turned_mean = np.where(angle_error < _REACHED, x, np.nan)
        turned_cov = cov
        if is_planar:
            G = self.rotation(len(mean), whole_angle)
            turned_cov = np.einsum("ijm,jkm,lkm->ilm", G, cov, G)
        return Gaussian(turned_mean, np.array(turned_cov))

    def _fixed_rows(self, support: Mask) -> list[int]:
        """Find the measured components that keep their values when the angle is turned, by their rows.

        They belong to the angle's sensor and are no angles, such as its range. They depend on no other
        components of the state than the angle does. ``support`` (n_z, n) marks the components of the
        state that each measured one depends on.
        """
        row = self.angle.row
        components = self.model.sensor.components
        sensor_name = components[row].partition(".")[0]
        fixed = []
        for j, name in enumerate(components):
            if j == row or j in measured_angle_rows(self.model.sensor):
                continue
            # `2.range` is of sensor 2; a name without a number is of the only sensor.
            is_of_sensor = name.partition(".")[0] in (sensor_name, name)
            depends_on_others = (support[j] & ~support[row]).any()
            if is_of_sensor and not depends_on_others:
                fixed.append(j)
        return fixed

    def measured_jacobian(self, x: Array) -> Array:
        """Return the derivatives (n_z, n, M) of a measurement of the states x (n, M) by the states.

        They are central differences, of a measurement at the first step.
        """
        k = int(self.steps[1])  # index 0 is the step of the prior
        sensor = self.model.sensor
        derivatives = []
        for i in range(len(x)):
            upper, lower, h = _neighbors(x, i)
            z_upper = np.asarray(sensor.measurement(upper, k).mean)
            z_lower = np.asarray(sensor.measurement(lower, k).mean)
            derivatives.append(sensor.innovation(z_upper, z_lower) / (2.0 * h))
        return np.stack(derivatives, axis=1)

    def rotation(self, n: int, angle: Array) -> Array:
        """Return matrices (n, n, M) that rotate positions, velocities and accelerations of states.

        They rotate by ``angle`` (M,), rad, in the plane. Other components of the n stay as they are.
        """
        G = np.repeat(np.eye(n)[..., None], len(angle), axis=2)
        # i and j are the rows of the x and y components of a vector.
        for i, j in self.planar:
            G[i, i] = np.cos(angle)
            G[j, j] = np.cos(angle)
            G[j, i] = np.sin(angle)
            G[i, j] = -G[j, i]
        return G


def _neighbors(x: Array, i: int) -> tuple[Array, Array, Array]:
    """Return the states (n, M) above and below x by h in component i, and the step h (M,).

    They are for a difference quotient.
    """
    h = 1e-5 * np.maximum(np.abs(x[i]), 1.0)
    upper = x.copy()
    upper[i] += h
    lower = x.copy()
    lower[i] -= h
    return upper, lower, h


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
    tracker: AnyFilter, problem: ModelDraws, angle: Angle, comparison: "_Comparison"
) -> bool:
    """Test whether a whole turn added to some measurements of an angle changes the estimates.

    It does not change those of a filter that wraps the innovation of the angle. ``comparison`` has the
    data, the estimates ``center`` of the best reference filter, and the mask ``is_elsewhere`` (M,) of
    the runs in which the angle is far from any cut, a value at which its numbers jump. Only these runs
    count. In half of them an estimate must change by more than a standard deviation of ``center``.
    """
    # Measured angles are wrapped before an external program gets them, unless the sensor does not wrap.
    sent_problem = _without_wrap(problem) if tracker.runs_program else problem
    data = comparison.data
    before = run_filter(tracker, sent_problem, data)
    sigma = np.sqrt(linalg.diagonal(comparison.center.cov))
    for whole_turn in (2.0 * np.pi, -2.0 * np.pi):
        z = data.measurements.copy()
        z[angle.row, ::2] += whole_turn
        after = run_filter(tracker, sent_problem, data._replace(measurements=z))
        mean = near(after.mean, before.mean, problem.angle_rows)
        # The filter's state may have further components after those of the reference's.
        change = np.abs(mean - before.mean)[: len(sigma)]
        relative_change = change / np.maximum(sigma, np.finfo(float).tiny)
        largest_change = np.nan_to_num(relative_change, nan=np.inf).max(axis=(0, 1))
        if np.median(largest_change[comparison.is_elsewhere]) > 1.0:
            return True
    return False


def deviation(
    estimates: Estimates, center: Estimates, rows: tuple[int, ...], horizon: int | None = None
) -> Array:
    """Return how far each run's estimates (M,) are from a reference's at most, in standard deviations.

    The largest deviation of any component at any step after the prior counts. It is infinite if an
    estimate is NaN, and the largest float if one is infinite. The means are (n, T + 1, M).

    ``center`` are the reference's estimates, whose standard deviations are the unit. ``rows`` are the
    rows of the state that are angles: whole turns are no deviation. Only the first ``horizon`` steps
    count; default: all.
    """
    sigma = np.sqrt(linalg.diagonal(center.cov))  # (n, T + 1, M)
    # The filter's state may have further components after those of the reference's.
    mean = near(estimates.mean[: len(sigma)], center.mean, rows)
    # A component that is known exactly has no spread: nothing is divided by zero.
    ratio = np.abs(mean - center.mean) / np.maximum(sigma, np.finfo(float).tiny)
    # Index 0 of the steps is the prior.
    last = None if horizon is None else horizon + 1
    return np.nan_to_num(ratio[:, 1:last].max(axis=(0, 1)), nan=np.inf)


def _steps_before_cuts(problem: ModelDraws, angle: Angle, data: Simulation) -> Array:
    """Count the first steps (M,) of each run in which its angle passes none of its cuts.

    A cut is a value at which the numbers of the angle may jump: 0, pi or +-pi/2. The true angle and the
    measured one must stay in the quarter of the circle in which the true angle is at the first step.
    """
    steps = problem.steps[1:].tolist()
    if angle.kind == "state":
        true_angle = data.truth[angle.row, 1:]
        measured = np.full(true_angle.shape, np.nan)
    else:
        sensor = problem.model.sensor
        expected = [sensor.measurement(data.truth[:, i], k).mean for i, k in enumerate(steps, 1)]
        true_angle = np.stack([values[angle.row] for values in expected])
        measured = data.measurements[angle.row]
    quarter = _quarter_of_circle(true_angle)
    measured_quarter = np.where(np.isnan(measured), quarter[0], _quarter_of_circle(measured))
    stays = (quarter == quarter[0]) & (measured_quarter == quarter[0])
    return np.logical_and.accumulate(stays, axis=0).sum(axis=0)


def _select_runs(data: Simulation, runs: list[int]) -> Simulation:
    """Return the data of some runs, by their indices."""
    prior = data.prior
    return Simulation(
        truth=data.truth[..., runs],
        measurements=data.measurements[..., runs],
        prior=Gaussian(prior.mean[:, runs], prior.cov[..., runs]),
    )


def _quarter_of_circle(values: Array) -> Array:
    """Return the number 0 to 3 of the quarter in which angles lie; they count from 0."""
    return np.floor(np.mod(values, 2.0 * np.pi) / (0.5 * np.pi))


def _judged_runs(
    problem: ModelDraws, angle: Angle, data: Simulation, groups: Sequence[str], ahead: Array
) -> tuple[list[int], int]:
    """Select the runs that show whether an angle's cut matters, and the number of steps to compare.

    A cut is a value at which the numbers of an angle jump. ``groups`` has for each run the cut that its
    angle passes, or a name that begins with "elsewhere" if the angle is to stay far from all cuts.

    In every run the angle is at its chosen value, a cut or one between the cuts, after ``ahead`` (M,)
    steps. An angle that wanders also passes a cut in many of the runs elsewhere. Then only the first
    steps count, up to the last one to which half of these runs pass no cut; the other half is left out.
    So is a run of another group in which the angle reaches its cut too late.

    If no step would be left, all runs and steps are judged. Then the runs elsewhere pass cuts, too. They
    raise the limit of a right run (`_Comparison.limit`), so that fewer faults are found.
    """
    is_elsewhere = np.array([name.startswith(_FAR_FROM_CUTS) for name in groups])
    quiet_steps = _steps_before_cuts(problem, angle, data)
    horizon = int(np.quantile(quiet_steps[is_elsewhere], 0.5, method="lower"))
    if horizon <= ahead.min():
        # The angle wanders so fast that the runs elsewhere pass cuts before any run reaches its own.
        return [*range(len(groups))], len(problem.steps) - 1
    is_judged = np.where(is_elsewhere, quiet_steps >= horizon, ahead < horizon)
    return np.flatnonzero(is_judged).tolist(), horizon


class _Comparison(NamedTuple):
    """Comparison of a filter with reference filters, in runs in which one angle has chosen values.

    In some runs the angle passes a cut, a value at which its numbers jump. In the others, elsewhere, it
    is in one of four directions between the cuts. A group is the runs of one cut or one direction.
    """

    ratio: Array
    """deviation of the tested filter from a reference, over that of another correct filter; (M,)"""
    group: tuple[str, ...]
    """group of each run: the cut that the angle passes, or a value far from its cuts"""
    center: Estimates
    """estimates of the best reference"""
    data: Simulation
    random: bool
    """whether the filter drew random numbers"""

    def of_group(self, name: str) -> Mask:
        """Return which runs (M,) belong to a group."""
        return np.array([other == name for other in self.group])

    @property
    def elsewhere(self) -> list[str]:
        """Groups whose angle is far from its cuts."""
        return sorted({name for name in self.group if name.startswith(_FAR_FROM_CUTS)})

    @property
    def is_elsewhere(self) -> Mask:
        """Runs whose angle is far from its cuts."""
        return np.array([name.startswith(_FAR_FROM_CUTS) for name in self.group])

    @property
    def follows(self) -> bool:
        """True if the filter follows the target where the angle is far from the cuts at which it jumps.

        The runs of one direction of the angle are a group. In one group far from all cuts, at least, the
        median of `ratio` must be small. It is the filter's deviation from a reference filter in a run,
        divided by that of another correct filter.
        """
        medians = [float(np.median(self.ratio[self.of_group(name)])) for name in self.elsewhere]
        return min(medians) < _FOLLOWS

    @property
    def limit(self) -> float:
        """Ratio above which a run is wrong: a multiple of the largest ratio far from all cuts.

        A run's ratio is the filter's deviation from a reference filter over that of another correct
        filter. The runs of one direction of the angle are a group, and `elsewhere` names the groups far
        from all cuts. Of their largest ratios the smallest counts, but at least 1.
        """
        largest = [float(self.ratio[self.of_group(name)].max()) for name in self.elsewhere]
        return _BEYOND * max(1.0, min(largest))


def mistaken_angle(tracker: AnyFilter, problem: ModelDraws) -> str | None:
    """Describe the angle at whose cut a filter goes wrong; an empty text if there is none.

    A cut is a value at which the numbers of an angle jump by a turn, such as pi or 0.

    The result is None if no angle passes its cut, or if no reference filter runs. It is also None if the
    filter does not even follow the target elsewhere, for example one that was written for positions.
    """
    compared_any = False
    doubtful = ""
    for angle in angles_of(problem):
        compared = _compare(tracker, problem, angle)
        if compared is None or not compared.follows:
            continue
        compared_any = True
        cut = _cut_of_fault(compared)
        if not cut:
            continue
        # The runs whose angle passes this cut. A run is wrong if its ratio is above the limit: the
        # filter's deviation from a reference filter, over that of another correct filter.
        is_here = compared.of_group(cut)
        number = int((compared.ratio > compared.limit)[is_here].sum())
        where = f"{number} of {is_here.sum()} runs go wrong where {angle.name} crosses {cut}"
        if angle.kind == "measured" and is_unwrapped(tracker, problem, angle, compared):
            return f"the innovation of {angle.name} is not wrapped: {where}"
        # Reported unless another angle is plainly unwrapped.
        if not doubtful:
            message = "is every difference of it wrapped, and a mean of sigma points on the circle?"
            doubtful = f"{where}: {message}"
    if not compared_any:
        return None
    return doubtful


def _compare(tracker: AnyFilter, problem: ModelDraws, angle: Angle) -> _Comparison | None:
    """Compare a filter with reference filters, in runs at the cuts of an angle and in runs elsewhere.

    A cut is a value at which the numbers of the angle jump, such as pi. The result is None if the angle
    does not pass the cut at pi, or if no reference filter runs.
    """
    # Step 1: runs of each group: of a cut, or of a direction far from all cuts. The angle has its value
    # after `ahead` steps, a number that differs from run to run.
    values: list[float] = []
    group: list[str] = []
    for name, (value, number) in _RUNS_BY_CUT.items():
        values += [value] * number
        group += [name] * number
    for value in _ELSEWHERE:
        values += [value] * _RUNS_ELSEWHERE
        group += [f"{_FAR_FROM_CUTS} {value:.2f}"] * _RUNS_ELSEWHERE
    possible = [step for step in _AHEAD if step < len(problem.steps)]
    ahead = np.array([*islice(cycle(possible), len(values))])
    data = turn(problem, angle, np.array(values), ahead, seed=7)
    # Runs whose angle can have its value: the prior is NaN in the others.
    reached = np.flatnonzero(np.isfinite(data.prior.mean).all(axis=0)).tolist()
    group = [group[i] for i in reached]
    if "+-pi" not in group or not any(name.startswith(_FAR_FROM_CUTS) for name in group):
        return None
    data = _select_runs(data, reached)
    # Of these, the runs that are compared, in their first `horizon` steps. An angle may wander over
    # other cuts afterwards.
    judged, horizon = _judged_runs(problem, angle, data, group, ahead[reached])
    group = [group[i] for i in judged]
    data = _select_runs(data, judged)
    # Step 2: references.
    sensor = problem.model.sensor
    if has_own_density(sensor) and sensor.why_no_moments():
        return None
    filters: list[AnyFilter] = [f for f in (UKF(), EKF()) if not why_not(f, problem)]
    if not filters:
        return None
    tested = run_filter(tracker, problem, data)
    references = [run_filter(f, problem, data) for f in filters]
    rows = problem.angle_rows
    # The truth in place of a filter: its covariance is not used.
    truth = Estimates(mean=data.truth, cov=references[0].cov, random=False, series={})
    errors = [deviation(truth, reference, rows, horizon) for reference in references]
    best = int(np.argmin([np.median(error) for error in errors]))
    center = references[best]
    others = [reference for i, reference in enumerate(references) if i != best]
    particles = PF(N=max(tracker.particle_count, 50))
    if tested.random and not why_not(particles, problem):
        others.append(run_filter(particles, problem, data))
    # Step 3: deviations from the best reference, in units of another reference's. Runs in which the best
    # reference itself is off the truth by more than `_SOUND` of its standard deviations do not count.
    scale = np.full(len(group), _LEAST_SCALE)
    for other in others:
        scale = np.maximum(scale, deviation(other, center, rows, horizon))
    deviations = deviation(tested, center, rows, horizon)
    ratio = np.where(errors[best] < _SOUND, deviations / scale, 0.0)
    return _Comparison(
        ratio=ratio,
        group=tuple(group),
        center=center,
        data=data,
        random=tested.random,
    )


def _cut_of_fault(compared: _Comparison) -> str:
    """Return the cut at which the largest share of the runs is wrong, if these are too many; else "".

    A cut is a value at which the angle may jump, such as +-pi or 0. A filter that draws is wrong in
    some runs by chance, and so is one with a gate, which is then wrong in some runs elsewhere, too. Its
    wrong runs are too many if chance does not explain them, in comparison with the runs elsewhere.
    """
    # A run is wrong if its ratio is above the limit: the filter's deviation from a reference filter,
    # over that of another correct filter. A group is the runs of one cut, or of one direction elsewhere.
    beyond = compared.ratio > compared.limit
    shares = {name: float(beyond[compared.of_group(name)].mean()) for name in {*compared.group}}
    # The groups elsewhere are of up to four directions. A filter may be wrong in half of the plane, so
    # compare with the two best of them only.
    quiet = sorted(compared.elsewhere, key=shares.__getitem__)[:2]
    is_quiet = np.any([compared.of_group(name) for name in quiet], axis=0)
    is_by_chance = compared.random or bool(beyond[compared.is_elsewhere].any())
    cuts = [name for name in _RUNS_BY_CUT if name in shares]
    for cut in sorted(cuts, key=shares.__getitem__, reverse=True):
        is_here = compared.of_group(cut)
        number = int(beyond[is_here].sum())
        if number < _LEAST_RUNS or shares[cut] < _LEAST_SHARE:
            continue
        chance = _fisher(
            number, int(is_here.sum()), int(beyond[is_quiet].sum()), int(is_quiet.sum())
        )
        if not is_by_chance or chance < _CHANCE:
            return cut
    return ""


def _fisher(here: int, runs_here: int, there: int, runs_there: int) -> float:
    """Return the probability of Fisher's exact test that wrong runs are this often here by chance.

    ``here`` of ``runs_here`` runs are wrong, and ``there`` of ``runs_there`` others. It is the
    probability that at least ``here`` of all wrong runs are among ``runs_here``.
    """
    wrong = here + there
    ways = [
        comb(runs_here, i) * comb(runs_there, wrong - i)
        for i in range(here, min(wrong, runs_here) + 1)
    ]
    return sum(ways) / comb(runs_here + runs_there, wrong)
