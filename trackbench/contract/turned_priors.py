"""Priors turned about a sensor, so that an angle has a chosen value some steps later."""

from typing import Literal, NamedTuple

import numpy as np

from trackbench.contract.estimates import simulate
from trackbench.contract.problems import ModelDraws
from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, Mask
from trackbench.core.distributions import Gaussian, per_run_moments
from trackbench.core.random_streams import RunStreams
from trackbench.models.angle_components import measured_angle_rows
from trackbench.models.numerical_derivatives import central_differences
from trackbench.scenarios.base import Simulation

_STAGES = 24  # in which a prior is turned, and a few more in which it stays
_NEWTON_STAGES = 6
_REACHED = 1e-3  # rad
_STEP = 1e-5  # of central differences, relative to a component


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


def simulate_from_turned_priors(
    problem: ModelDraws, angle: Angle, values: Array, ahead: Array, seed: int
) -> Simulation:
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
        """Return the derivatives (m, len(columns), M) of `values` at x (n, M) by these rows of x."""

        def values_at(moved_rows: Array) -> Array:
            """Return the `values` of x with other numbers in these rows."""
            state = x.copy()
            state[columns] = moved_rows
            return self.values(state)

        return central_differences(values_at, x[columns], self.difference, step=_STEP)

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
        sensor = self.model.sensor
        first_step = int(self.steps[1])  # index 0 is the step of the prior
        J = central_differences(
            lambda state: np.asarray(sensor.measurement(state, first_step).mean),
            mean,
            sensor.innovation,
            step=_STEP,
        )
        # A smaller derivative is a rounding error of the difference quotient.
        size = np.abs(J)
        support = (1e-12 * size.max(axis=(0, 1)) < size).any(axis=-1)
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
