"""Conversions of range, azimuth and elevation to a Cartesian position: ccm, ucm, mucm, ducm.

The covariance of each polar conversion is ``R_r u u' + R_c w w'``, u along an azimuth, w across it.
With s the azimuth's variance, differences of exponentials of s are computed by expm1 and sinh: written
out, they would lose every digit at s = 4e-6.
"""

from typing import Literal, NamedTuple

import numpy as np

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.core.elementary import cos_sin, exp, expm1, sinh

Conversion = Literal["ccm", "ucm", "mucm", "ducm"]


class Polar(NamedTuple):
    """Range and azimuth (M,), m and rad, with independent errors of the given variances.

    The variances, m^2 and rad^2, are scalars or (M,).
    """

    r: Array
    a: Array
    range_variance: Array | float
    azimuth_variance: Array | float


def convert(conversion: Conversion, z: Polar, predicted: Polar | None = None) -> Gaussian:
    """Convert range and azimuth to a Cartesian position.

    Parameters
    ----------
    conversion : {"ccm", "ucm", "mucm", "ducm"}
        Name of the conversion.
    z : Polar
        Measured range (m) and azimuth (rad), with their variances.
    predicted : Polar, optional
        Range and azimuth of a prediction, with their variances. Only `ducm` uses it.

    Returns
    -------
    Gaussian
        Position (2, M) relative to the sensor, m, and its covariance (2, 2, M), m^2.
    """
    if conversion == "ducm":
        return ducm(z, predicted)
    return {"ccm": ccm, "ucm": ucm, "mucm": mucm}[conversion](z)


def ccm(z: Polar) -> Gaussian:
    """Convert by the conventional conversion, with the first-order covariance at z.

    Chandrasekaran, Shashikiran & Krishnaveni, eqs. 1-2.

    Parameters
    ----------
    z : Polar
        Measured range (m) and azimuth (rad), with their variances.

    Returns
    -------
    Gaussian
        Position (2, M) relative to the sensor, m, and its covariance (2, 2, M), m^2.
    """
    across = np.square(z.r) * z.azimuth_variance
    return Gaussian(position(z.r, z.a), rotate_covariance(z.range_variance, across, z.a))


def ucm(z: Polar) -> Gaussian:
    """Convert range and azimuth z without bias: divide by the mean shrinkage (Mo et al. 1998).

    The covariance is that of the error given the measurement. With the variances s of the azimuth and v
    of the range r it is

    - along the line of sight ``(e^s - 2) r^2 + (r^2 + v) (1 + e^(-2 s)) / 2``,
    - across it ``(r^2 + v) (1 - e^(-2 s)) / 2``.

    Parameters
    ----------
    z : Polar
        Measured range (m) and azimuth (rad), with their variances.

    Returns
    -------
    Gaussian
        Position (2, M) relative to the sensor, m, and its covariance (2, 2, M), m^2.
    """
    s = z.azimuth_variance
    v = z.range_variance
    # These variances, by differences that lose no digits.
    square = np.square(z.r)
    decay = expm1(-2.0 * s)  # e^(-2 s) - 1
    radial = square * (expm1(s) + 0.5 * decay) + 0.5 * v * (2.0 + decay)
    across = -0.5 * (square + v) * decay
    # The noise of the azimuth shrinks the mean position by e^(-s / 2).
    return Gaussian(position(exp(0.5 * s) * z.r, z.a), rotate_covariance(radial, across, z.a))


def mucm(z: Polar) -> Gaussian:
    """Convert by the modified unbiased conversion (Duan et al. 2004): moments given the measurement.

    Parameters
    ----------
    z : Polar
        Measured range (m) and azimuth (rad), with their variances.

    Returns
    -------
    Gaussian
        Position (2, M) relative to the sensor, m, and its covariance (2, 2, M), m^2.
    """
    s = z.azimuth_variance
    v = z.range_variance
    # Variances along and across the line of sight.
    square = np.square(z.r)
    excess = 2.0 * np.square(sinh(0.5 * s))  # cosh s - 1
    radial = exp(-s) * (square * excess + v * (1.0 + excess))
    across = exp(-s) * (square + v) * sinh(s)
    return Gaussian(position(exp(-0.5 * s) * z.r, z.a), rotate_covariance(radial, across, z.a))


def ducm(z: Polar, predicted: Polar | None = None) -> Gaussian:
    """Convert by the decorrelated unbiased conversion (Bordonaro, Willett & Bar-Shalom 2014).

    The mean is that of `ucm`. The covariance is averaged over the prediction, which is independent of
    the measurement's error, or over the measurement where its azimuth is at least as certain.

    Parameters
    ----------
    z : Polar
        Measured range (m) and azimuth (rad), with their variances.
    predicted : Polar, optional
        Range and azimuth of a prediction, with their variances. Without it the covariance is averaged
        over the measurement in all runs.

    Returns
    -------
    Gaussian
        Position (2, M) relative to the sensor, m, and its covariance (2, 2, M), m^2.
    """
    s = z.azimuth_variance
    v = z.range_variance
    # Step 1: choose per run what the covariance is averaged over.
    reference = z
    if predicted is not None:
        use_prediction = np.asarray(predicted.azimuth_variance < np.asarray(z.azimuth_variance))
        pairs = zip(predicted, z, strict=True)
        reference = Polar(*(np.where(use_prediction, p, m) for p, m in pairs))
    # Step 2: the variances along and across the reference's azimuth are even + odd and even - odd, with
    # E[r^2] of the reference. The odd part turns with twice the azimuth a, and E[cos 2 a] of an azimuth
    # of mean zero is e^(-2 variance).
    square = np.square(reference.r) + reference.range_variance
    even = 0.5 * (square * expm1(s) + exp(s) * v)
    odd = 0.5 * (square * expm1(-s) + exp(-s) * v) * exp(-2.0 * reference.azimuth_variance)
    mean = position(exp(0.5 * s) * z.r, z.a)
    return Gaussian(mean, rotate_covariance(even + odd, even - odd, reference.a))


def convert_in_space(z: Array, R: Array) -> Gaussian:
    """Convert range, azimuth and elevation with first-order covariance.

    Parameters
    ----------
    z : array (3, M)
        Measured range (m), azimuth and elevation (rad).
    R : array (3, 3[, M])
        Covariance of their errors.

    Returns
    -------
    Gaussian
        Position (3, M) relative to the sensor, m, and its covariance (3, 3, M), m^2.
    """
    # p = r (cos e cos a, cos e sin a, sin e)
    r, a, e = z
    ca, sa = cos_sin(a)
    ce, se = cos_sin(e)
    mean = np.stack([r * ce * ca, r * ce * sa, r * se])
    # J = dp / d(r, a, e), covariance J R J'
    J = np.stack(
        [
            np.stack([ce * ca, -r * ce * sa, -r * se * ca]),
            np.stack([ce * sa, r * ce * ca, -r * se * sa]),
            np.stack([se, np.zeros_like(r), r * ce]),
        ]
    )
    return Gaussian(mean, linalg.sandwich(J, R))


def position(r: Array, a: Array) -> Array:
    """Compute ``r (cos a, sin a)``.

    Parameters
    ----------
    r : array (*batch)
        Ranges, m.
    a : array (*batch)
        Azimuths from the first axis, rad.

    Returns
    -------
    array (2, *batch)
        Cartesian positions, m.
    """
    c, s = cos_sin(a)
    return np.stack([r * c, r * s])


def rotate_covariance(radial: Array | float, across: Array | float, a: Array) -> Array:
    """Compute ``radial u u' + across w w'`` with u = (cos a, sin a) and w = (-sin a, cos a).

    Parameters
    ----------
    radial, across : array (*batch) or float
        Variances along and across the azimuth.
    a : array (*batch)
        Azimuths, rad.

    Returns
    -------
    array (2, 2, *batch)
        Covariances, in the unit of the variances.
    """
    c, s = cos_sin(a)
    both = (across - radial) * c * s
    return np.array(
        [[radial * c * c + across * s * s, -both], [-both, radial * s * s + across * c * c]]
    )


def distance(px: Array, py: Array) -> Array:
    """Compute ``sqrt(px^2 + py^2)``.

    Parameters
    ----------
    px, py : array (*batch)
        Cartesian coordinates, m, with at least one batch axis. Their shapes are equal.

    Returns
    -------
    array (*batch)
        Distances from the origin, m.
    """
    square = px * px
    square += py * py
    return np.sqrt(square, out=square)
