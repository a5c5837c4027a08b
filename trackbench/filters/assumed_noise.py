"""Noise that a Gaussian filter assumes by its keys Q, R and noise_mean, in place of the model's."""

from typing import NamedTuple

import numpy as np

from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.models.base import Model, NormalMotion, Scene


class AssumedNoise(NamedTuple):
    """Noise that a Gaussian filter assumes: variances Q and R of every component, None for the model's.

    ``noise_mean`` adds the mean of the process noise to the prediction. Without it the prediction of the
    gamma-driven model is 1.5 too low, an interpretation of a paper.
    """

    Q: float | None = None
    R: float | None = None
    noise_mean: bool = True

    def transition(self, model: Model, x: Array, k: int) -> Gaussian:
        """Return the mean and covariance of x_k given x_{k-1} = x.

        Parameters
        ----------
        model : Model
            Motion and sensor of the filter model.
        x : array (n_x, *batch)
            States at step k - 1.
        k : int
            Number of the step.

        Returns
        -------
        Gaussian
            Mean (n_x, *batch), without ``noise_mean`` f(x) alone. Covariance (n_x, n_x[, *batch]) of the
            model, or Q times the unit matrix.
        """
        exact = model.motion.transition(x, k)
        if self.Q is None and self.noise_mean and isinstance(exact, Gaussian):
            return exact
        # `loc` is f(x), without the mean of the noise.
        mean = exact.mean if self.noise_mean else exact.loc
        return Gaussian(mean, _assumed_cov(self.Q, exact.cov))

    def measurement(self, model: Model, x: Array, k: int) -> Gaussian:
        """Return the mean and covariance of z_k given x_k = x.

        Parameters
        ----------
        model : Model
            Motion and sensor of the filter model.
        x : array (n_x, *batch)
            States at step k.
        k : int
            Number of the step.

        Returns
        -------
        Gaussian
            Mean (n_z, *batch). Covariance (n_z, n_z[, *batch]) of the model, or R times the unit matrix.
        """
        exact = model.sensor.measurement(x, k)
        if self.R is None:
            return exact
        return Gaussian(exact.mean, _assumed_cov(self.R, exact.cov))


def _assumed_cov(variance: float | None, cov: Array) -> Array:
    """Return ``variance`` times the unit matrix, or the model's ``cov`` if it is None."""
    return cov if variance is None else variance * np.eye(cov.shape[0])


MODEL_NOISE = AssumedNoise()
"""The noise of the model."""


def idle_noise_mean(scene: Scene) -> dict[str, str]:
    """Return a reason by key if ``noise_mean`` has no effect: the process noise has mean zero."""
    if isinstance(scene.model.motion, NormalMotion):
        return {"noise_mean": "as the process noise has mean zero"}
    return {}
