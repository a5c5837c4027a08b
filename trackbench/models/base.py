"""Protocols of motion and sensor, and the model that a filter gets of both.

A planar state begins ``(px, vx, py, vy)``, one in space ``(px, vx, py, vy, pz, vz)``, m and m/s.
Further components of a motion (accelerations, a turn rate) follow. Sensors, scores and filters therefore
find positions at the even and velocities at the odd indices that all motions of a target share.
"""

from abc import abstractmethod
from typing import ClassVar, NamedTuple, Protocol, TypeAlias, runtime_checkable

from trackbench.component_parts import Part
from trackbench.core.arrays import Array, Index
from trackbench.core.distributions import Distribution, Gaussian
from trackbench.core.gamma_noise import Gamma
from trackbench.core.random_streams import Streams
from trackbench.models.unsupported_keys import UNSUPPORTED_KEYS


class SampledMotion(Protocol):
    """A motion over one sampling interval, p(x_k | x_{k-1})."""

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the state's components, in order."""

    def transition(self, x: Array, k: int) -> Distribution:
        """Return the distribution of x_k given x_{k-1} = x.

        Parameters
        ----------
        x : (n_x, *batch)
            States at step k - 1.
        k : int
            Step of the result.

        Returns
        -------
        Distribution
            Mean (n_x, *batch), covariance (n_x, n_x[, *batch]).
        """


def extra_std(motion: SampledMotion) -> tuple[float, ...]:
    """Return the initial standard deviations of the components beyond position and velocity.

    Such a component, an acceleration for example, starts from N(0, std^2).

    Parameters
    ----------
    motion : SampledMotion
        Motion. One that has such components has an attribute ``extra_std``.

    Returns
    -------
    tuple of float
        Standard deviation of each of these components, in the component's unit. They are the last ones
        of the state, in order. Empty for a motion without the attribute.
    """
    return getattr(motion, "extra_std", ())


def angle_rows(motion: SampledMotion) -> tuple[int, ...]:
    """Return the rows of the state that are angles, rad, so that a whole turn is no difference.

    Parameters
    ----------
    motion : SampledMotion
        Motion. One that has angles has an attribute ``rows_of_angles``.

    Returns
    -------
    tuple of int
        Rows, counted from 0. Empty for a motion without the attribute.
    """
    return getattr(motion, "rows_of_angles", ())


class Motion(Part):
    """A motion as a config names it: a frozen dataclass, registered in the group ``motions``."""

    unsupported_keys: ClassVar[dict[str, str]] = UNSUPPORTED_KEYS

    @abstractmethod
    def sampled(self, T: float, axes: int = 2) -> SampledMotion:
        """Return the motion over one sampling interval.

        Parameters
        ----------
        T : float
            Length of the interval, s.
        axes : int
            Number of axes of the space; a scalar motion ignores it.

        Returns
        -------
        SampledMotion
            The motion, the same object for equal arguments if it is cached.
        """

    @property
    def known_angles(self) -> tuple[str, ...]:
        """Names of components that are angles, rad: whole turns are no error."""
        return ()

    @property
    def uses_time(self) -> bool:
        """True if the motion depends on the time k T, so that all steps must be equal."""
        return False

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of known inputs in the motion's equations, whose values the scenario has."""
        return ()


class Sensor(Protocol):
    """p(z_k | x_k), Gaussian in the sensor's coordinates; a dataclass of the group ``sensors``."""

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the measurement's components, in order."""

    def measurement(self, x: Array, k: int) -> Gaussian:
        """Return the distribution of z_k given x_k = x.

        Parameters
        ----------
        x : (n_x, *batch)
            States.
        k : int
            Step.

        Returns
        -------
        Gaussian
            Mean h(x) (n_z, *batch), covariance R (n_z, n_z[, *batch]).
        """

    def innovation(self, z: Array, z_pred: Array) -> Array:
        """Subtract measurements, angles wrapped to (-pi, pi].

        Parameters
        ----------
        z, z_pred : array (n_z, *batch)
            Measurements, and predicted ones.

        Returns
        -------
        array (n_z, *batch)
            ``z - z_pred``, NaN where a component of z is missing.
        """


class DifferentiableMotion(SampledMotion, Protocol):
    """A motion with a Jacobian, which extended Kalman filters need."""

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives of the predicted mean.

        Parameters
        ----------
        x : array (n_x, *batch)
            States at step k - 1.
        k : int
            Step of the result.

        Returns
        -------
        array (n_x, n_x) or (n_x, n_x, *batch)
            d E[x_k] / d x_{k-1} at x.
        """


class DifferentiableSensor(Sensor, Protocol):
    """A sensor with a Jacobian, which extended Kalman filters need."""

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives of the mean measurement.

        Parameters
        ----------
        x : array (n_x, *batch)
            States.
        k : int
            Step.

        Returns
        -------
        array (n_z, n_x) or (n_z, n_x, *batch)
            d E[z_k] / d x_k at x.
        """


@runtime_checkable
class WithJacobian(Protocol):
    """A motion or sensor that has a Jacobian."""

    def jacobian(self, x: Array, k: int) -> Array:
        """Return the derivatives of the mean.

        Parameters
        ----------
        x : array (n_x, *batch)
            States: for a motion those at step k - 1, for a sensor those at step k.
        k : int
            Step of the result.

        Returns
        -------
        array (m, n_x) or (m, n_x, *batch)
            Derivatives of the m components of the mean at x.
        """


class TwiceDifferentiable(Protocol):
    """A motion or sensor with second derivatives in closed form."""

    def hessian(self, x: Array, k: int) -> Array:
        """Return the second derivatives of the mean.

        Parameters
        ----------
        x : array (n_x, *batch)
            States.
        k : int
            Step.

        Returns
        -------
        array (m, n_x, n_x[, *batch])
            Hessian of each of the m components of the mean.
        """


Differentiable: TypeAlias = tuple[DifferentiableMotion, DifferentiableSensor]
"""A model whose motion and sensor both have a Jacobian, for a cast."""


@runtime_checkable
class NormalMotion(Protocol):
    """A motion whose noise is N(0, Q)."""

    @property
    def Q(self) -> Array:
        """Covariance of the noise (n_x, n_x)."""


@runtime_checkable
class GammaMotion(Protocol):
    """A motion of a scalar whose noise is a gamma variate."""

    @property
    def noise(self) -> Gamma:
        """The noise's distribution."""


@runtime_checkable
class LocatingSensor(Protocol):
    """A sensor whose single measurement gives a position."""

    axes: ClassVar[int]
    """number of axes of the position"""

    def located(self, z: Array, k: int) -> Gaussian:
        """Return the position that a measurement gives.

        Parameters
        ----------
        z : array (n_z, M)
            Measurements.
        k : int
            Step.

        Returns
        -------
        Gaussian
            Position (axes, M), m, and its covariance (axes, axes[, M]).
        """


@runtime_checkable
class NearSensor(Protocol):
    """A sensor that computes innovations of particles faster than their predicted measurements."""

    def residual(self, z: Array, x: Array, k: int) -> Gaussian:
        """Return the innovations of particles.

        Parameters
        ----------
        z : array (n_z, M)
            Measurements.
        x : array (n_x, M, N)
            Particles.
        k : int
            Step.

        Returns
        -------
        Gaussian
            ``innovation(z, E[z_k | x_k = x])`` (n_z, M, N), and the covariance R of the noise.
        """


@runtime_checkable
class DensitySensor(Protocol):
    """A sensor whose noise may be other than normal; `measurement` then gives its moments."""

    def has_density(self) -> bool:
        """Return whether `log_density` and `draw_known` take the place of `measurement`."""

    def why_no_moments(self) -> str:
        """Return the reason why the measurement has no covariance; empty if it has one."""

    def log_density(self, z: Array, x: Array, k: int) -> Array:
        """Return the log-likelihood of measurements, by their measured components.

        Parameters
        ----------
        z : array (n_z, M)
            Measurements; NaN where a component is missing.
        x : array (n_x, M) or (n_x, M, N)
            States.
        k : int
            Step.

        Returns
        -------
        array (M,) or (M, N)
            log p(z_k | x_k = x); a missing component adds nothing, so that it is zero if all are.
        """

    def draw_known(self, x: Array, k: int, noise: Array, rng: Streams) -> Array:
        """Draw measurements of true states from the density that filters know.

        Errors that no filter knows, such as a bias, and missed detections are added elsewhere.

        Parameters
        ----------
        x : array (n_x, M) or (n_x, 1)
            True states.
        k : int
            Step.
        noise : array (n_z, M)
            Standard normal noise, drawn by the caller.
        rng : Streams
            Further random numbers, for noise that is no function of the normal one.

        Returns
        -------
        array (n_z, M)
            Measurements, none of them missing.
        """


class Model(NamedTuple):
    """Motion and sensor as a filter assumes them: p(x_k | x_{k-1}) and p(z_k | x_k)."""

    motion: SampledMotion
    sensor: Sensor


class Scene(Part):
    """Facts about a scenario that a filter may check before anything runs."""

    @property
    @abstractmethod
    def model(self) -> Model:
        """True motion and sensor, which are also the filter model by default."""

    @property
    @abstractmethod
    def steps(self) -> Index:
        """Step numbers k (T + 1,), starting with the step of the prior."""

    @property
    @abstractmethod
    def times(self) -> Array:
        """Times of the steps (T + 1,), s."""

    @property
    def prior_type(self) -> type[Distribution]:
        """Class of the prior, for filters that use more of it than moments."""
        return Gaussian

    @property
    def turns(self) -> tuple[float, ...]:
        """Sizes of the accelerations of the target's turns, m/s^2."""
        return ()
