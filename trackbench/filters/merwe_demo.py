"""Settings of van der Merwe's public demo, for the preset `merwe-demo` of each filter."""

MERWE_DEMO: dict[str, object] = {"Q": 0.75, "R": 1e-5, "P0": 0.75, "noise_mean": False}
"""Noise that van der Merwe's public demo gives its Kalman filters."""
MERWE_PROPOSAL: dict[str, object] = {"Q": 1.5, "R": 0.1, "P0": 0.75, "noise_mean": False}
"""Noise that van der Merwe's public demo gives the UKF proposal."""
MERWE_EKF_PROPOSAL: dict[str, object] = {"Q": 7.5, "R": 0.1, "P0": 0.75, "noise_mean": False}
"""Noise that van der Merwe's public demo gives the EKF proposal."""


MERWE_WEIGHTS: dict[str, object] = {
    "weights": "floor",
    "resampling": "residual",
    "transition_density": "increment",
    "estimate_from": "resampled",
}
"""How van der Merwe's public demo weighs, resamples and estimates."""
