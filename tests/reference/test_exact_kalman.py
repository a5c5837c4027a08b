"""The stored errors of Kalman filters on a fixed path against their exact values.

Along a path that every run flies, the error of a linear filter is a bias, which follows the
accelerations that the filter leaves out, and a noise, whose covariance follows the gains (Kurt & Orguner
2025, arXiv 2511.22034). No run is drawn for either.
"""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from tests.commands import trackbench
from tests.conftest import EXPERIMENT_FILES, ROOT
from trackbench.config.load import load


def exact_rms(q: float) -> float:
    """Return the root mean square position error (m) over the scored steps, by recursion."""
    scenario = load(EXPERIMENT_FILES["adaptive-kf"]).points[0].scenario
    T, sigma = scenario.T, scenario.sensor.sigma
    path = scenario.target.path(scenario._timeline)
    steps = scenario._timeline.steps
    F, G, H = np.array([[1.0, T], [0.0, 1.0]]), np.array([T * T / 2, T]), np.array([[1.0, 0.0]])
    Q, R = q * np.outer(G, G), sigma * sigma
    # Two-point differencing: p = z_1, v = (z_1 - z_0) / T.
    P = R * np.array([[1.0, 1.0 / T], [1.0 / T, 2.0 / T**2]])
    noise = P.copy()
    axes = [path[0:2], path[2:4]]
    bias = [np.array([0.0, (x[0, 1] - x[0, 0]) / T - x[1, 1]]) for x in axes]
    squares = []
    for i in range(2, len(steps)):
        # The filter's gain, from its own Q.
        P = F @ P @ F.T + Q
        K = P @ H.T / (H @ P @ H.T + R)
        A = np.eye(2) - K @ H
        P = A @ P
        # The error: estimate minus truth. The path's acceleration is what F leaves out of the truth.
        noise = A @ F @ noise @ F.T @ A.T + R * K @ K.T
        bias = [A @ (F @ b + F @ x[:, i - 1] - x[:, i]) for b, x in zip(bias, axes, strict=True)]
        squares.append(2.0 * noise[0, 0] + sum(b[0] ** 2 for b in bias))
    scored = scenario.windows[""][-len(squares) :]
    return float(np.sqrt(np.mean(np.array(squares)[scored])))


@pytest.mark.parametrize(("label", "q"), [("KF", 0.0), ("KF (best Q)", 0.3)])
def test_the_stored_error_is_the_exact_one(label: str, q: float) -> None:
    with (ROOT / "results" / "adaptive-kf" / "summary.csv").open() as file:
        (row,) = (
            row
            for row in csv.DictReader(file)
            if (row["filter"], row["metric"]) == (label, "rms(rmse_position)")
        )
    assert abs(float(row["value"]) - exact_rms(q)) < 3.5 * float(row["stderr"])


def test_the_program_computes_the_exact_errors(tmp_path: Path) -> None:
    labels = {"KF": (0.0, 2366.757), "KF (best Q)": (0.3, 43.58551)}
    done = trackbench(
        *("run", "adaptive-kf", "--runs", "2", "--out", str(tmp_path / "out"), "--workers", "1"),
        *("--set", "exact=[KF, KF (best Q)]", "--set", "block=fit", "--set", "figures={}"),
        *("--set", "key_figure=null", "--only", "KF", "--only", "KF (best Q)"),
        *("--set", "tables={rms: {kind: metrics, columns: {RMS: rms(rmse_position)}}}"),
    )
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out" / "summary.csv").open() as file:
        rows = {(row["filter"], row["metric"]): float(row["value"]) for row in csv.DictReader(file)}
    for label, (q, value) in labels.items():
        exact = rows[f"{label}, exact", "rms(rmse_position)"]
        assert exact == value
        assert exact == pytest.approx(exact_rms(q), rel=5e-7)
    rows = dict(re.findall(r"^(\S.*?)  +(\S+)", done.stdout, re.MULTILINE))
    assert rows["KF, exact"] == "2367"
    assert rows["KF (best Q), exact"] == "43.59"
