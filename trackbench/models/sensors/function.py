"""A sensor written as equations, whose noise may be other than normal."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from trackbench.core import linalg
from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import log
from trackbench.core.poisson import draw_poisson, log_poisson
from trackbench.core.random_streams import Streams
from trackbench.field_types import Finite, InvalidKeyError, freeze_mappings
from trackbench.models.angle_components import angles_in_equations, components_turning_with
from trackbench.models.compiled_expressions import ArrayProgram
from trackbench.models.equations import Equations, Term
from trackbench.models.noise_covariances import Covariance, compile_covariance
from trackbench.models.sensors.base import SensorBase
from trackbench.models.sensors.noise import Noise
from trackbench.registry import register


@register("sensors", "function")
@dataclass(frozen=True, kw_only=True)
class FunctionSensor(SensorBase):
    """``z_k = h(x_k, k) + N(0, R)`` by expressions; also Student t noise, outliers and counts.

    ``{kind: function, h: {bearing: "atan2(py, px)"}, R: 1e-4}``. Expressions are those of the motion
    ``map``, of the target's components and the number of the step, ``k``.

    ``noise: {kind: student-t, df: 4, scale: 0.1}``, ``{kind: mixture, outliers: 0.1, factor: 10}`` and
    ``noise: poisson`` (h is the rate of a count) replace the normal noise.
    """

    h: dict[str, Term]
    """expression of each component of the measurement, of the components of the state"""
    R: Covariance | None = None
    """covariance of the normal noise: one variance for all components, a list or mapping of variances,
    or a matrix, of numbers or expressions of the state"""
    noise: Noise | Literal["poisson"] | None = None
    """noise that is not normal, which filters know: student-t, mixture or poisson"""
    angles: tuple[str, ...] | None = None
    """components that are angles in rad, whose differences wrap to (-pi, pi]; default: every component
    that is an `atan2` or an angle of the state, or a sum with one"""
    parameters: dict[str, Finite] = field(default_factory=dict)
    """names and values of constants"""
    where: dict[str, Term] = field(default_factory=dict)
    """names and expressions of parts of the equations, each of what stands above it"""
    state: tuple[str, ...] = ()
    """names of the state's components, in order; default: those of the target"""

    components: ClassVar[tuple[str, ...]] = ()
    """names of the measurement's components: the keys of ``h``"""
    _finds_angles: ClassVar[bool] = False
    """True if the angles were found in the equations, as the config does not name them; set in the
    instance. `with_angles_of_state` then finds further ones"""

    def __post_init__(self) -> None:
        """Check the keys, and set the defaults that depend on other keys."""
        freeze_mappings(self)
        object.__setattr__(self, "components", tuple(self.h))
        super().__post_init__()
        if not self.h:
            raise InvalidKeyError("name at least one component of the measurement", "h")
        # Without the key (None) angles are found in the equations below. An empty key stands for none.
        for i, name in enumerate(self.angles or ()):
            if name not in self.h:
                raise InvalidKeyError(f"{name!r} is not one of {', '.join(self.h)}", "angles", i)
        self._check_noise()
        # Without the names of the state, which `for_state` adds, the equations cannot be compiled yet.
        if self.state:
            _ = self._programs  # so that a mistake is found where the config is read
            if self.angles is None:
                angles = angles_in_equations(self._equations, self.h, "h")
                # A count is no angle.
                object.__setattr__(self, "angles", () if self.is_count else angles)
                # Angles of the state, which are not known yet, may add to them.
                object.__setattr__(self, "_finds_angles", True)

    def _check_noise(self) -> None:
        """Check the keys ``noise`` and ``R`` against each other; raises InvalidKeyError.

        The noise `poisson`, if it is given as a word, is replaced by the object that it stands for.
        """
        if self.noise == "poisson":
            object.__setattr__(self, "noise", Noise(kind="poisson"))
        if self.noise is None:
            if self.R is None:
                raise InvalidKeyError("`R`, the variance of the noise, or `noise` is required")
            return
        self._non_normal_noise.check_keys()
        if self.outliers is not None:
            message = "not together with `noise`, which filters know; take one of the two"
            raise InvalidKeyError(message, "outliers")
        # The variance: none of a count, required by a mixture, diagonal otherwise.
        if self.is_count:
            if self.R is not None:
                raise InvalidKeyError("`noise: poisson` has the variance h; leave out `R`", "R")
            if self.angles:
                raise InvalidKeyError("a count is no angle", "angles")
        elif self.R is None and self._non_normal_noise.kind == "mixture":
            raise InvalidKeyError("`R`, the variance without outliers, is required")
        elif isinstance(self.R, tuple):
            for i, row in enumerate(self.R):
                if isinstance(row, tuple) and any(term != 0 for term in row[:i] + row[i + 1 :]):
                    message = "`noise` is independent by component; give a variance for each"
                    raise InvalidKeyError(message, "R")

    @property
    def _non_normal_noise(self) -> Noise:
        """The key ``noise`` of a sensor that has it: an object, neither None nor a word."""
        assert isinstance(self.noise, Noise)
        return self.noise

    @property
    def is_count(self) -> bool:
        """True if the measurement is a count."""
        return isinstance(self.noise, Noise) and self.noise.kind == "poisson"

    @property
    def measured_angles(self) -> tuple[str, ...]:
        """Components of the state that are measured as they are, as an angle."""
        return tuple(str(self.h[name]) for name in self.angles or () if self.h[name] in self.state)

    def has_density(self) -> bool:
        """Test whether the noise is not normal, so that `log_density` is its likelihood."""
        return self.noise is not None

    def why_no_moments(self) -> str:
        """Return the reason why the measurement has no covariance; empty if it has one."""
        if self.noise is None or self.is_count:
            return ""
        return self._non_normal_noise.why_no_variance

    def for_state(self, components: tuple[str, ...]) -> "FunctionSensor":
        """Return the sensor for a target with these components, whose names its equations may use.

        A sensor whose config names its ``state`` is returned as it is. Any other one keeps the sensors
        that it has made, by the components of their states. Raises InvalidKeyError if the equations have
        any other name.
        """
        if self.state:
            return self
        # Compile once: a config builds its scenario for every filter.
        if components not in self._sensors_by_state:
            self._sensors_by_state[components] = replace(self, state=components)
        return self._sensors_by_state[components]

    @cached_property
    def _sensors_by_state(self) -> dict[tuple[str, ...], "FunctionSensor"]:
        """Sensors that `for_state` has compiled, by the components of their state."""
        return {}

    def with_angles_of_state(self, angles: tuple[str, ...]) -> "FunctionSensor":
        """Return the sensor that also wraps components that are an angle of the state.

        Sums with such an angle, in rad, wrap, too. Multiples of an angle do not: `multiples_of_angles`
        finds them. A sensor whose config names its angles is returned as it is. So is a count, which is
        no angle.
        """
        if not self._finds_angles or self.is_count or not angles:
            return self
        found, _ = components_turning_with(angles, self._equations, self.h, "h")
        if found == self.angles:
            return self
        # Compile once, as in `for_state`.
        if found not in self._sensors_by_angles:
            self._sensors_by_angles[found] = replace(self, angles=found)
        return self._sensors_by_angles[found]

    def multiples_of_angles(self, angles: tuple[str, ...]) -> tuple[str, ...]:
        """Return the components that jump by other than one turn with the state's ``angles``.

        These are multiples of an angle, as in other units.

        Parameters
        ----------
        angles : tuple of str
            Names of the state's components that are angles, rad.

        Returns
        -------
        tuple of str
            Names of components of the measurement. There are none for a sensor whose config names its
            angles, and none for a count.
        """
        if not self._finds_angles or self.is_count:
            return ()
        _, multiples = components_turning_with(angles, self._equations, self.h, "h")
        return multiples

    @cached_property
    def _sensors_by_angles(self) -> dict[tuple[str, ...], "FunctionSensor"]:
        """Sensors that `with_angles_of_state` has compiled, by the names of their angles."""
        return {}

    @property
    def _equations(self) -> Equations:
        return Equations(self.state, ("k",), self.parameters, self.where)

    @cached_property
    def _programs(self) -> tuple[ArrayProgram, ArrayProgram]:
        """Programs of h (n_z,), with a Jacobian (n_z, n_x), and R (n_z, n_z); raises InvalidKeyError.

        Without the key ``R`` its program is the identity. Only two kinds of noise may lack the key: for
        Student's t, ``scale root(R)`` times a variate, ``scale`` then is the whole scale; for a count,
        whose variance is h, R is not used.
        """
        equations = self._equations
        h = equations.vector([equations.parse(term, "h", name) for name, term in self.h.items()])
        R = compile_covariance(equations, 1.0 if self.R is None else self.R, self.components, "R")
        return h, R

    @property
    def constant_R(self) -> Array | None:
        """Covariance (n_z, n_z) of the noise if it is constant; else None.

        None, too, for noise without a covariance.
        """
        _, R = self._programs
        if self.noise is None:
            return R.constant
        # The variance of a count is its rate, which depends on the state.
        if self.is_count or self.why_no_moments() or R.constant is None:
            return None
        return R.constant * self._non_normal_noise.variance

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return N(h(x, k), R) for x (n_x, *batch), of which the first components are the state's.

        With `noise` the mean and the covariance are those of the measurement with this noise.
        """
        h, R = self._programs
        # Further components of a filter's state do not enter h.
        x = x[: len(self.state)]
        mean = with_trailing(h(x, k), x.ndim - 1)
        mean = np.broadcast_to(mean, (len(mean), *x.shape[1:]))
        if self.noise is None:
            return Gaussian(mean, R(x, k))
        if self.is_count:
            # The variance of a count is its rate.
            eye = with_trailing(np.eye(len(mean)), x.ndim - 1, leading=2)
            return Gaussian(mean, eye * mean)
        # The noise is sqrt(R) times a variate with the mean zero and this variance.
        cov = R(x, k)
        with np.errstate(invalid="ignore"):  # zero times an infinite variance
            return Gaussian(mean, np.where(cov == 0.0, 0.0, cov * self._non_normal_noise.variance))

    def _mean_and_scale(self, x: Array, k: int) -> tuple[Array, Array]:
        """Return h (n_z, *batch) and the roots of R's diagonal (n_z, *batch)."""
        h, R = self._programs
        x = x[: len(self.state)]
        scale = np.sqrt(linalg.diagonal(R(x, k)))
        return with_trailing(h(x, k), x.ndim - 1), with_trailing(scale, x.ndim - 1)

    @property
    def has_noise_of_state(self) -> bool:
        """True if R depends on the state, which the Fisher information leaves out."""
        return any(map(self._programs[1].uses, self.state))

    def log_density(self, z: Array, x: Array, k: int) -> Array:
        """Evaluate log p(z_k | x_k = x) (*batch) of z (n_z, M) by `noise`, of measured components."""
        h, scale = self._mean_and_scale(x, k)
        # Any number stands for a missing component, whose term is dropped below.
        missing = np.isnan(z)
        z = np.where(missing, 0.0, z)
        if self.is_count:
            log_p = log_poisson(with_trailing(z, x.ndim - 1), h)
        else:
            e = self.innovation(with_trailing(z, x.ndim - 1), h) / scale
            log_p = self._non_normal_noise.log_density(e) - log(scale)
        log_p = np.where(with_trailing(missing, x.ndim - 1), 0.0, log_p)
        # Components are independent. They are added in this order, so that the bytes are the same on
        # every machine.
        value = log_p[0]
        for row in log_p[1:]:
            value = value + row
        return np.broadcast_to(value, x.shape[1:])

    def draw(self, x: Array, k: int, noise: Array) -> Array:
        """Draw measurements (n_z, M) of true states x; ``noise`` (n_z, M) is standard normal."""
        with np.errstate(invalid="ignore"):  # `_check_drawn` reports a NaN of h or R
            z = super().draw(x, k, noise)
        self._check_drawn(z, x, k)
        return z

    def _check_drawn(self, z: Array, x: Array, k: int) -> None:
        """Raise InvalidKeyError for a drawn measurement z (n_z, M) that is NaN at a known true state x.

        Filters would take it for a missing one.
        """
        state = np.broadcast_to(x[: len(self.state)], (len(self.state), z.shape[1]))
        wrong = np.isnan(z) & ~np.isnan(state).any(axis=0)
        if not wrong.any():
            return
        row, run = np.argwhere(wrong)[0].tolist()
        values = zip(self.state, state[:, run].tolist(), strict=True)
        where = ", ".join(f"{name} = {value:.4g}" for name, value in values)
        h, _ = self._programs
        component = self.components[row]
        if np.isnan(h(state[:, run : run + 1], k)[row]).any():
            raise InvalidKeyError(f"step {k}: {component} is no number at {where}", "h")
        raise InvalidKeyError(f"step {k}: it is no covariance at {where}", "R")

    def draw_known(self, x: Array, k: int, noise: Array, rng: Streams) -> Array:
        """Draw measurements (n_z, M) of true states x with the key `noise`, which filters know.

        The argument ``noise`` (n_z, M) is standard normal. A count is drawn from uniforms of ``rng``,
        and uses the shape of ``noise`` alone.
        """
        h, scale = self._mean_and_scale(x, k)
        if not self.is_count:
            z = h + scale * self._non_normal_noise.draw(noise, rng)
            self._check_drawn(z, x, k)
            return z
        try:
            return draw_poisson(np.broadcast_to(h, noise.shape), rng.random(noise.shape))
        except ValueError as error:
            raise InvalidKeyError(f"step {k}: {error}", "h") from None

    def information(self, x: Array, k: int, certain: bool = False) -> Array:
        """Return the Fisher information (n_x, n_x[, M]) of a measurement of the state x (n_x[, M]).

        It is weighted by the probability of the measurement unless the measurement is ``certain``.
        """
        if self.noise is None or self.is_count:
            return super().information(x, k, certain)
        # Information of normal noise with the covariance R, times that of a component of unit R. Without
        # the key R the noise has the size that its own keys give.
        noise = self._non_normal_noise
        normal = replace(self, noise=None, R=1.0 if self.R is None else self.R)
        return noise.information * normal.information(x, k, certain)

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Compute ``z - z_pred`` (n_z, *batch), angles wrapped to (-pi, pi]."""
        nu = z - z_pred
        for i, name in enumerate(self.h):
            if name in (self.angles or ()):
                nu[i] = wrap_angle(nu[i])
        return nu

    def jacobian(self, x: Array, k: int) -> Array:
        """Return dh/dx (n_z, n_x[, *batch]) at x (n_x, *batch).

        A filter's state may have components beyond those in h, such as accelerations.
        """
        H = self._programs[0].jacobian(x[: len(self.state)], k)  # the first program is that of h
        # Columns of zeros for these further components.
        padding = [(0, 0), (0, len(x) - len(self.state)), *[(0, 0)] * (H.ndim - 2)]
        return np.pad(H, padding)

    def hessian(self, x: Array, k: int) -> Array:
        """Return the second derivatives of h (n_z, n_x, n_x[, *batch]) at x (n_x, *batch).

        They are zero for components of the state beyond those in h, the first one of `_programs`.
        """
        second = self._programs[0].jacobian.jacobian(x[: len(self.state)], k)
        zeros_after = (0, len(x) - len(self.state))
        padding = [(0, 0), zeros_after, zeros_after, *[(0, 0)] * (second.ndim - 3)]
        return np.pad(second, padding)

    @property
    def H(self) -> "Constant":
        """Function that returns the measurement matrix (n_z, n) for a state of n components.

        It raises AttributeError unless z = H x + N(0, R), so that `hasattr` gives False.
        """
        h, R = self._programs
        if self.is_count:
            raise AttributeError("the variance of a count depends on the state")
        H = h.jacobian.constant
        if H is None or R.constant is None or not h.is_zero_at_zero():
            raise AttributeError("h is not linear")
        return Constant(H)

    @property
    def linear(self) -> bool:
        """Return True if z_k = H x_k + b + noise, with H, b and R free of the state.

        H and b may depend on the step. Any other sensor raises AttributeError, so that `hasattr` gives
        False.
        """
        h, R = self._programs
        depends_on_state = any(h.jacobian.uses(name) or R.uses(name) for name in self.state)
        if self.is_count or depends_on_state:
            raise AttributeError("h is not linear")
        return True


@dataclass(frozen=True, eq=False)
class Constant:
    """The matrix of a linear sensor, with columns of zeros for a filter's own components."""

    H: Array

    def __call__(self, n: int) -> Array:
        """Return the matrix (n_z, n)."""
        return np.pad(self.H, [(0, 0), (0, n - self.H.shape[1])])
