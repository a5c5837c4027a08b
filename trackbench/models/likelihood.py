"""Log-likelihood of measurements under a sensor, also with missing components."""

from functools import cache
from typing import TypeGuard, cast

import numpy as np

from trackbench.core import missing_components
from trackbench.core.arrays import Array, any_nan, with_trailing
from trackbench.core.counted_operations import count_operations
from trackbench.core.distributions import zero_mean_log_prob
from trackbench.models.base import DensitySensor, NearSensor, Sensor


@cache
def _has_protocol(cls: type[object], protocol: type[object]) -> bool:
    return issubclass(cls, protocol)


def has_own_density(sensor: Sensor) -> TypeGuard[DensitySensor]:
    """Return whether a sensor has a likelihood that is not normal."""
    return _has_protocol(type(sensor), DensitySensor) and cast(DensitySensor, sensor).has_density()


def log_likelihood(sensor: Sensor, z: Array, x: Array, k: int) -> Array:
    """Return the log-likelihood of measurements, by their measured components.

    Parameters
    ----------
    sensor : Sensor
        Sensor of the filter model.
    z : array (n_z, M)
        Measurements; NaN where a component is missing.
    x : array (n_x, M) or (n_x, M, N)
        States.
    k : int
        Step.

    Returns
    -------
    array (M,) or (M, N)
        log p(z_k | x_k = x), zero if all components are missing.
    """
    count_operations("likelihoods", x, component_axes=1)
    if has_own_density(sensor):
        return sensor.log_density(z, x, k)
    # Step 1: innovations nu and their covariance R, by the sensor's fast way for particles if any.
    if x.ndim == 3 and _has_protocol(type(sensor), NearSensor):
        residual = cast(NearSensor, sensor).residual(z, x, k)
        nu = residual.mean
        R = residual.cov
    else:
        predicted = sensor.measurement(x, k)
        R = predicted.cov
        nu = sensor.innovation(with_trailing(z, predicted.mean.ndim - 1), predicted.mean)
    # Step 2: log N(nu; 0, R), without the missing components.
    if not any_nan(z):
        return zero_mean_log_prob(nu, R)
    missing = np.isnan(with_trailing(z, nu.ndim - 1))
    value = missing_components.log_prob_of_measured(
        nu, missing_components.drop_missing_cov(R, missing), missing
    )
    return np.where(missing.all(axis=0), 0.0, value)
