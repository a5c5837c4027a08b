"""A sensor written as equations, and its noise: Gaussian, Student's t, mixtures, counts."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import inf, isclose, pi
from typing import ClassVar, Literal

import numpy as np

from trackbench.core import linalg
from trackbench.core.angles import wrap_angle
from trackbench.core.arrays import Array, with_trailing
from trackbench.core.distributions import LOG_2PI, Gaussian
from trackbench.core.elementary import cos_sin, exp, expm1, log, log_gamma, logaddexp
from trackbench.core.random_streams import Streams
from trackbench.core.sums import total
from trackbench.field_types import Finite, InvalidKeyError, OpenShare, Positive, freeze_mappings
from trackbench.models.equations import ArrayProgram, Covariance, Equations, Term
from trackbench.models.expressions import turns_at_cut
from trackbench.models.sensors.base import SensorBase
from trackbench.registry import register

NoiseKind = Literal["student-t", "mixture", "poisson"]
_KEYS = {"student-t": ("df", "scale"), "mixture": ("outliers", "factor"), "poisson": ()}
_REQUIRED = {"student-t": ("df",), "mixture": ("outliers", "factor"), "poisson": ()}
_MAX_RATE = 1e6  # of a count, whose inversion takes some 20 sqrt(rate) steps
_RADII = 4001  # points of the integral of the mixture's Fisher information
_HALF_ULP = 2.0**-54  # moves uniforms of [0, 1) into (0, 1)


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise of each component of a measurement, independent of the others.

    ``student-t`` is ``scale root(R)`` times a Student t variate. ``mixture`` is N(0, R), and
    N(0, factor^2 R) for a share of ``outliers``. ``poisson`` is a count of rate h(x).
    """

    kind: NoiseKind
    """student-t, mixture or poisson"""
    df: Positive | None = None
    """degrees of freedom of Student's t"""
    scale: Positive = 1.0
    """factor on the root of R, which is 1 unless it is set"""
    outliers: OpenShare | None = None
    """share of outliers of a mixture"""
    factor: Positive | None = None
    """ratio of the outliers' standard deviation to that of the others"""

    def check_keys(self) -> None:
        """Raise InvalidKeyError if a key of the noise's kind is missing, or belongs to another kind."""
        values = {"df": self.df, "outliers": self.outliers, "factor": self.factor}
        values["scale"] = None if self.scale == 1.0 else self.scale
        for key, value in values.items():
            if value is not None and key not in _KEYS[self.kind]:
                raise InvalidKeyError(f"is no key of `{self.kind}`", "noise", key)
            if value is None and key in _REQUIRED[self.kind]:
                raise InvalidKeyError(f"`{self.kind}` needs `{key}`", "noise")

    @property
    def variance(self) -> float:
        """Variance of a component of unit R; infinite for df <= 2."""
        if self.df is not None and self.df <= 2.0:
            return inf
        if self.df is not None:
            return self.scale * self.scale * self.df / (self.df - 2.0)
        share, factor = self._mixture
        return 1.0 + share * (factor * factor - 1.0)

    @property
    def _mixture(self) -> tuple[float, float]:
        """Return the share of outliers and the factor of their standard deviation."""
        assert self.outliers is not None
        assert self.factor is not None
        return self.outliers, self.factor

    def log_density(self, e: Array) -> Array:
        """Evaluate the log-density of a component of unit R at e (...)."""
        if self.df is not None:
            return self._log_student_t(e, self.df)
        share, factor = self._mixture
        # log((1 - p) N(e; 0, 1) + p N(e; 0, f^2))
        half = 0.5 * np.square(e)
        regular = float(log(1.0 - share)) - 0.5 * LOG_2PI - half
        ratio = float(log(share / factor))
        outlier = ratio - 0.5 * LOG_2PI - half / (factor * factor)
        return logaddexp(regular, outlier)

    def _log_student_t(self, e: Array, df: float) -> Array:
        """Evaluate the log-density of Student's t of df degrees of freedom at e (...)."""
        # log Gamma((v+1)/2) - log Gamma(v/2) - log(pi v s^2)/2 - (v+1)/2 log(1 + e^2 / (v s^2))
        spread = df * self.scale * self.scale
        norm = log_gamma(0.5 * (df + 1.0)) - log_gamma(0.5 * df) - 0.5 * float(log(pi * spread))
        return norm - 0.5 * (df + 1.0) * log(1.0 + np.square(e) / spread)

    def draw(self, normal: Array, rng: Streams) -> Array:
        """Draw noise of unit R from standard normal ``normal`` (n_z, M) and from uniforms of ``rng``."""
        if self.df is not None:
            # t = sqrt(v (u^(-2/v) - 1)) cos(2 pi w) of uniform u, w (Bailey 1994, eq. 2)
            u, w = rng.random((2, *normal.shape))
            radius = np.sqrt(self.df * expm1(-2.0 / self.df * log(u + _HALF_ULP)))
            return self.scale * radius * cos_sin(2.0 * pi * w)[0]
        share, factor = self._mixture
        is_outlier = rng.random(normal.shape) < share
        return np.where(is_outlier, factor * normal, normal)

    @property
    def information(self) -> float:
        """Fisher information that a component of unit R has of its mean."""
        if self.df is not None:
            return (self.df + 1.0) / (self.df + 3.0) / (self.scale * self.scale)
        share, factor = self._mixture
        # Integral of p'(e)^2 / p(e), by the trapezoidal rule over e = sinh(s) in both tails.
        # The nodes are dense within the narrowest sigma, and reach to 40 of the widest.
        widest = max(factor, 1.0)
        narrowest = min(factor, 1.0)
        s = np.linspace(-1.0, 1.0, _RADII) * float(log(80.0 * widest / narrowest))
        e = 0.5 * narrowest * (exp(s) - exp(-s))
        step = 0.5 * narrowest * (exp(s) + exp(-s)) * (s[1] - s[0])
        log_p = self.log_density(e)
        regular = exp(float(log(1.0 - share)) - 0.5 * LOG_2PI - 0.5 * e * e - log_p)
        # The score p'/p weighs both precisions by their posterior probabilities.
        score = -e * (regular + (1.0 - regular) / (factor * factor))
        return float(total(exp(log_p) * score * score * step))


def log_poisson(z: Array, rate: Array) -> Array:
    """Return the log-probability (*batch) of counts z at a rate; -inf unless z is whole and >= 0."""
    counts, index = np.unique(z, return_inverse=True)
    valid = (counts >= 0.0) & (counts == np.floor(counts))
    # `log_gamma` takes one number, so it is called once for each different count.
    log_factorials = np.full(counts.shape, inf)
    for i in np.flatnonzero(valid):
        log_factorials[i] = log_gamma(counts[i] + 1.0)
    log_factorial = log_factorials[index].reshape(z.shape)
    # log p(z) = z log rate - rate - log z!; a rate of zero gives the count zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.where(z == 0.0, 0.0, z * log(rate)) - rate - log_factorial
    return np.where(rate >= 0.0, value, -np.inf)


def draw_poisson(rate: Array, u: Array) -> Array:
    """Draw a Poisson count for each rate (...) by inversion of uniforms u (...).

    Raises ValueError for a rate that is negative, or above ``_MAX_RATE``.
    """
    is_rate = (rate >= 0.0) & (rate <= _MAX_RATE)
    if not is_rate.all():
        wrong = rate[~is_rate][0]
        raise ValueError(f"the rate of a count is {wrong:g}; it may be 0 to {_MAX_RATE:g}")
    # Step 1: begin nine standard deviations below the mean, beyond which lies 1e-17.
    reach = 9.0 * np.sqrt(rate)
    count = np.maximum(np.floor(rate - reach), 0.0)
    probability = exp(log_poisson(count, rate))
    below = probability.copy()
    last = rate + reach + 40.0  # of a small rate the upper tail is longer than nine deviations
    # Step 2: add probabilities until their sum exceeds u.
    while True:
        goes_on = (below <= u) & (count < last)
        if not goes_on.any():
            return count
        count = count + goes_on
        # p(n) = p(n - 1) rate / n
        next_probability = probability * rate / np.maximum(count, 1.0)
        probability = np.where(goes_on, next_probability, probability)
        below = np.where(goes_on, below + probability, below)


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
    that is an `atan2`, or a sum with one"""
    parameters: dict[str, Finite] = field(default_factory=dict)
    """names and values of constants"""
    where: dict[str, Term] = field(default_factory=dict)
    """names and expressions of parts of the equations, each of what stands above it"""
    state: tuple[str, ...] = ()
    """names of the state's components, in order; default: those of the target"""

    components: ClassVar[tuple[str, ...]] = ()
    """names of the measurement's components: the keys of ``h``"""

    def __post_init__(self) -> None:
        freeze_mappings(self)
        object.__setattr__(self, "components", tuple(self.h))
        super().__post_init__()
        if not self.h:
            raise InvalidKeyError("name at least one component of the measurement", "h")
        for i, name in enumerate(self.angles or ()):
            if name not in self.h:
                raise InvalidKeyError(f"{name!r} is not one of {', '.join(self.h)}", "angles", i)
        self._check_noise()
        if self.state:
            _ = self._programs  # so that a mistake is found where the config is read
            if self.angles is None:
                object.__setattr__(self, "angles", self._angles_by_default())

    def _check_noise(self) -> None:
        """Replace the noise `poisson`, if it is given as a word; raise InvalidKeyError for wrong keys.

        These are keys that contradict the noise, and missing ones.
        """
        if self.noise == "poisson":
            object.__setattr__(self, "noise", Noise(kind="poisson"))
        if self.noise is None:
            if self.R is None:
                raise InvalidKeyError("`R`, the variance of the noise, or `noise` is required")
            return
        self._known_noise.check_keys()
        if self.outliers is not None:
            message = "not together with `noise`, which filters know; take one of the two"
            raise InvalidKeyError(message, "outliers")
        # The variance: none of a count, required by a mixture, diagonal otherwise.
        if self.is_count:
            if self.R is not None:
                raise InvalidKeyError("`noise: poisson` has the variance h; leave out `R`", "R")
            if self.angles:
                raise InvalidKeyError("a count is no angle", "angles")
        elif self.R is None and self._known_noise.kind == "mixture":
            raise InvalidKeyError("`R`, the variance without outliers, is required")
        elif isinstance(self.R, tuple):
            for i, row in enumerate(self.R):
                if isinstance(row, tuple) and any(term != 0 for term in row[:i] + row[i + 1 :]):
                    message = "`noise` is independent by component; give a variance for each"
                    raise InvalidKeyError(message, "R")

    @property
    def _known_noise(self) -> Noise:
        """Noise that is not normal."""
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
        """Return the reason why the measurement has no covariance, or nothing."""
        if self.noise is None or self.is_count or self._known_noise.variance < np.inf:
            return ""
        return f"Student's t of df {self._known_noise.df:g} has no variance, which needs df > 2"

    def for_state(self, components: tuple[str, ...]) -> "FunctionSensor":
        """Return the sensor for a target with these components; raises InvalidKeyError."""
        if self.state:
            return self
        if components not in self._sensors_by_state:
            self._sensors_by_state[components] = replace(self, state=components)
        return self._sensors_by_state[components]

    @cached_property
    def _sensors_by_state(self) -> dict[tuple[str, ...], "FunctionSensor"]:
        """Sensors that `for_state` has compiled: a config builds its scenario for every filter."""
        return {}

    @property
    def _equations(self) -> Equations:
        return Equations(self.state, ("k",), self.parameters, self.where)

    def _angles_by_default(self) -> tuple[str, ...]:
        """Find the components that are angles in rad; raises InvalidKeyError for other units."""
        equations = self._equations
        names = []
        for name, term in self.h.items():
            turns = turns_at_cut(equations.parse(term, "h", name))
            if turns and not isclose(turns, 1.0):
                message = f"an angle that jumps by {2.0 * pi * turns:.4g} at the cut of atan2"
                way_on = "write it in rad, or `angles: []` if no target crosses the cut"
                raise InvalidKeyError(f"{message}; only angles in rad wrap: {way_on}", "h", name)
            if turns and not self.is_count:  # a count is no angle
                names.append(name)
        return tuple(names)

    @cached_property
    def _programs(self) -> tuple[ArrayProgram, ArrayProgram]:
        """H (n_z,), whose Jacobian is (n_z, n_x), and R (n_z, n_z); raises InvalidKeyError."""
        equations = self._equations
        h = equations.vector([equations.parse(term, "h", name) for name, term in self.h.items()])
        R = equations.covariance(1.0 if self.R is None else self.R, self.components, "R")
        return h, R

    @property
    def constant_R(self) -> Array | None:
        """Covariance (n_z, n_z) of normal noise if it is constant; else None."""
        if self.noise is not None:
            return None
        return self._programs[1].constant

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
        cov = R(x, k)
        with np.errstate(invalid="ignore"):  # zero times an infinite variance
            return Gaussian(mean, np.where(cov == 0.0, 0.0, cov * self._known_noise.variance))

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
            log_p = self._known_noise.log_density(e) - log(scale)
        log_p = np.where(with_trailing(missing, x.ndim - 1), 0.0, log_p)
        # Components are independent.
        value = log_p[0]
        for row in log_p[1:]:
            value = value + row
        return np.broadcast_to(value, x.shape[1:])

    def draw(self, x: Array, k: int, noise: Array) -> Array:
        """Draw measurements (n_z, M) of true states x; ``noise`` (n_z, M) is standard normal."""
        with np.errstate(invalid="ignore"):  # of what is no number, which is reported
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
        """Draw measurements (n_z, M) of true states x; ``noise`` (n_z, M) is standard normal."""
        h, scale = self._mean_and_scale(x, k)
        if not self.is_count:
            z = h + scale * self._known_noise.draw(noise, rng)
            self._check_drawn(z, x, k)
            return z
        try:
            return draw_poisson(np.broadcast_to(h, noise.shape), rng.random(noise.shape))
        except ValueError as error:
            raise InvalidKeyError(f"step {k}: {error}", "h") from None

    def information(self, x: Array, k: int, certain: bool = False) -> Array:
        """Return the Fisher information (n_x, n_x[, M]) of a measurement of the state x (n_x[, M])."""
        if self.noise is None or self.is_count:
            return super().information(x, k, certain)
        # Information of normal noise with the covariance R, times that of a component of unit R.
        noise = self._known_noise
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
        """Return dh/dx (n_z, n_x[, *batch]); zero for components of a filter's own."""
        H = self._programs[0].jacobian(x[: len(self.state)], k)
        # Columns of zeros for the further components of a filter's state.
        padding = [(0, 0), (0, len(x) - len(self.state)), *[(0, 0)] * (H.ndim - 2)]
        return np.pad(H, padding)

    def hessian(self, x: Array, k: int) -> Array:
        """Return the second derivatives of h (n_z, n_x, n_x[, *batch]), padded as `jacobian`."""
        second = self._programs[0].jacobian.jacobian(x[: len(self.state)], k)
        of_state = (0, len(x) - len(self.state))
        padding = [(0, 0), of_state, of_state, *[(0, 0)] * (second.ndim - 3)]
        return np.pad(second, padding)

    @property
    def H(self) -> "Constant":
        """H (n_z, n) as a function of n; AttributeError if h is not linear."""
        h, R = self._programs
        if self.is_count:
            raise AttributeError("the variance of a count depends on the state")
        H = h.jacobian.constant
        if H is None or R.constant is None or not h.is_zero_at_zero():
            raise AttributeError("h is not linear")
        return Constant(H)

    @property
    def linear(self) -> bool:
        """Return True; AttributeError unless z_k = H x_k + b + noise, H, b and R free of the state."""
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
