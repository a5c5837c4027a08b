"""Fisher information of a measurement, which the Cramer-Rao bound adds up over the steps."""

from trackbench.core import linalg
from trackbench.core.arrays import Array
from trackbench.models.base import DifferentiableSensor


def information_of_certain(sensor: DifferentiableSensor, x: Array, k: int) -> Array:
    """Return ``H' R^-1 H`` (n_x, n_x[, M]) of a measurement of x (n_x[, M]) that is not missing."""
    state = x if x.ndim > 1 else x[:, None]
    H = sensor.jacobian(state, k)
    R = sensor.measurement(state, k).cov
    if x.ndim == 1 and H.ndim > 2:
        H = H[..., 0]
    if x.ndim == 1 and R.ndim > 2:
        R = R[..., 0]
    return linalg.sandwich(linalg.transpose(H), linalg.inverse(R))


def weighted_information(information: Array, detection: float, is_due: bool) -> Array:
    """Return the information times the probability of the measurement.

    No measurement is due between two periods. At the other steps ``detection`` is its probability.
    """
    probability = float(detection) if is_due else 0.0
    return information * probability
