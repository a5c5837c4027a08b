"""What one writes first: numpy, a loop over runs and a loop over steps."""

from typing import Any

import numpy as np

from trackbench.core.arrays import Array


def merwe_pf(scenario: Any, z: Array, N: int) -> Array:
    """Bootstrap filter; z (1, T, M), estimates (1, T, M)."""
    rng = np.random.default_rng(1)
    out = np.empty_like(z)
    for m in range(z.shape[2]):
        x = np.full(N, scenario.x1)
        for t, k in enumerate(scenario.steps[1:]):
            drive = 1.0 + np.sin(scenario.w * np.pi * k)
            x = (
                drive
                + scenario.phi1 * x
                + rng.gamma(scenario.gamma_shape, 1 / scenario.gamma_rate, N)
            )
            h = scenario.phi2 * x**2 if k <= scenario.switch else scenario.phi3 * x - 2.0
            log_w = -0.5 * (z[0, t, m] - h) ** 2 / scenario.R
            w = np.exp(log_w - log_w.max())
            w /= w.sum()
            out[0, t, m] = w @ x
            x = x[systematic(w, rng)]
    return out


def systematic(w: Array, rng: np.random.Generator) -> Array:
    """Indices of the ancestors, by one search in the cumulative weights."""
    N = len(w)
    return np.minimum(np.searchsorted(np.cumsum(w), (np.arange(N) + rng.random()) / N), N - 1)
