"""DAPPER: its Lorenz-96 model and its ensemble update, in a loop over runs without its statistics.

The loop is that of `EnKF.assimilate` in dapper/da_methods/ensemble.py (DAPPER 1.7.1).
"""

import os

os.environ.setdefault("MPLBACKEND", "agg")  # DAPPER opens windows for its figures elsewhere

import numpy as np
from dapper.da_methods.ensemble import EnKF_analysis, post_process
from dapper.mods.Lorenz96 import step
from dapper.tools.randvars import GaussRV

from trackbench.core.arrays import Array

UPDATES = {"perturbed": "PertObs", "etkf": "Sqrt"}


def lorenz96_enkf(
    numbers: Array, mean: Array, z: Array, N: int, form: str = "perturbed", rotation: bool = False
) -> Array:
    """Ensemble Kalman filter of z (n, T, M) from N(mean, sigma^2 I), mean (n,); estimates (n, T, M).

    ``numbers`` are sigma, the measurements' variance, the time between steps and the inflation.
    """
    sigma, R, dt, inflation = numbers
    n, T, M = z.shape
    out = np.empty_like(z)
    start = GaussRV(mu=mean, C=sigma**2)
    noise = GaussRV(C=R, M=n)
    for m in range(M):
        E = start.sample(N)
        for t in range(T):
            E = step(E, t * dt, dt)
            E = EnKF_analysis(E, E, noise, z[:, t, m], UPDATES[form])
            E = post_process(E, inflation, rotation)
            out[:, t, m] = E.mean(axis=0)
    return out
