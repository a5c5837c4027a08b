"""Simulation of truth and measurements step by step from a Markov model of motion and sensor."""

import numpy as np

from trackbench.core.arrays import Array, Index
from trackbench.core.random_streams import Streams
from trackbench.models.base import Model
from trackbench.models.likelihood import has_own_density


def simulate_markov(model: Model, start: Array, steps: Index, rng: Streams) -> tuple[Array, Array]:
    """Simulate truth (n_x, T + 1, M) and measurements (n_z, T, M) from ``start``.

    Parameters
    ----------
    model : Model
        Motion and sensor.
    start : Array (n_x, M)
        State at the first step.
    steps : Index (T + 1,)
        Numbers of the steps.
    rng : Streams
        Random numbers, a stream per run.

    Returns
    -------
    truth : Array (n_x, T + 1, M)
    measurements : Array (n_z, T, M)
    """
    n_z = len(model.sensor.components)
    truth = [start]
    measurements = []
    for step in steps[1:]:
        k = int(step)
        x = model.motion.transition(truth[-1], k).sample(rng)
        truth.append(x)
        # A sensor whose noise is not normal draws measurements itself, partly from normal numbers. It
        # draws them as this model knows them: none is missing, and none is an outlier or has a bias.
        if has_own_density(model.sensor):
            noise = rng.standard_normal((n_z, x.shape[-1]))
            measurements.append(model.sensor.draw_known(x, k, noise, rng))
        else:
            measurements.append(model.sensor.measurement(x, k).sample(rng))
    return np.stack(truth, axis=1), np.stack(measurements, axis=1)
