"""Polar measurements as Cartesian ones: four conversions with their covariances.

Every covariance is ``R_r u u' + R_c w w'`` with u along an azimuth and w across it. With s the
azimuth's variance, the differences of exponentials of s go through expm1 and sinh: written out, they
lose every digit at s = 4e-6.
"""

from typing import Literal, NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin, exp, expm1, sinh

Conversion = Literal["ccm", "ucm", "mucm", "ducm"]


class Polar(NamedTuple):
    """Range and azimuth (M,) with independent errors of the given variances, scalars or (M,)."""

    r: Array
    a: Array
    range_variance: Array | float
    azimuth_variance: Array | float


def convert(conversion: Conversion, z: Polar, predicted: Polar | None = None) -> Gaussian:
    """Return the Cartesian position (2, M) and covariance (2, 2, M); `ducm` uses ``predicted``."""
    if conversion == "ducm":
        return ducm(z, predicted)
    return {"ccm": ccm, "ucm": ucm, "mucm": mucm}[conversion](z)


def ccm(z: Polar) -> Gaussian:
    """Return the conventional conversion: first-order covariance at z (banana paper, eqs. 1-2)."""
    cross = np.square(z.r) * z.azimuth_variance
    return Gaussian(position(z.r, z.a), rotate_covariance(z.range_variance, cross, z.a))


def ucm(z: Polar) -> Gaussian:
    """Return the unbiased conversion, divided by the mean shrinkage (Mo et al. 1998).

    The covariance is that of the error given the measurement.
    """
    s, v = z.azimuth_variance, z.range_variance
    square, lost = np.square(z.r), expm1(-2.0 * s)
    radial = square * (expm1(s) + 0.5 * lost) + 0.5 * v * (2.0 + lost)
    cross = -0.5 * (square + v) * lost
    return Gaussian(position(exp(0.5 * s) * z.r, z.a), rotate_covariance(radial, cross, z.a))


def mucm(z: Polar) -> Gaussian:
    """Return the modified unbiased conversion (Duan et al. 2004): moments given the measurement."""
    s, v = z.azimuth_variance, z.range_variance
    square, more = np.square(z.r), 2.0 * np.square(sinh(0.5 * s))  # cosh s - 1
    radial = exp(-s) * (square * more + v * (1.0 + more))
    cross = exp(-s) * (square + v) * sinh(s)
    return Gaussian(position(exp(-0.5 * s) * z.r, z.a), rotate_covariance(radial, cross, z.a))


def ducm(z: Polar, predicted: Polar | None = None) -> Gaussian:
    """Return the decorrelated unbiased conversion (Bordonaro, Willett & Bar-Shalom 2014).

    The mean of `ucm`, with the error's covariance averaged over the prediction, which does not know
    the measurement's error; over the measurement where that knows the azimuth no worse.
    """
    s, v = z.azimuth_variance, z.range_variance
    where = z if predicted is None else _more_certain(predicted, z)
    square = np.square(where.r) + where.range_variance
    even = 0.5 * (square * expm1(s) + exp(s) * v)
    odd = 0.5 * (square * expm1(-s) + exp(-s) * v) * exp(-2.0 * where.azimuth_variance)
    return Gaussian(
        position(exp(0.5 * s) * z.r, z.a), rotate_covariance(even + odd, even - odd, where.a)
    )


def position(r: Array, a: Array) -> Array:
    """Return ``r (cos a, sin a)`` (2, *batch)."""
    c, s = cos_sin(a)
    return np.stack([r * c, r * s])


def rotate_covariance(radial: Array | float, cross: Array | float, a: Array) -> Array:
    """Return ``radial u u' + cross w w'`` (2, 2, *batch), u = (cos a, sin a), w = (-sin a, cos a)."""
    c, s = cos_sin(a)
    both = (cross - radial) * c * s
    return np.array(
        [[radial * c * c + cross * s * s, -both], [-both, radial * s * s + cross * c * c]]
    )


def _more_certain(predicted: Polar, z: Polar) -> Polar:
    sure = np.asarray(predicted.azimuth_variance < np.asarray(z.azimuth_variance))
    return Polar(*(np.where(sure, p, m) for p, m in zip(predicted, z, strict=True)))
