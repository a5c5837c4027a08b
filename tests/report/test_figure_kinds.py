"""Every kind of figure is drawn, of one experiment: what stands in it is what the CSV files say."""

import inspect
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from tests.commands import ran
from tests.papers import banana_text
from trackbench.registry import kinds
from trackbench.report.plotting import file_formats
from trackbench.report.tables_and_figures import Results

CONFIG = f"""name: every
runs: 12
block: 12
scenario: {banana_text(range_km=50.0, velocity_cross=100.0, scans=12)}
reference: PF
filters: {{PF: {{kind: pf, N: 300}}, EKF: {{kind: ekf}}, UKF: {{kind: ukf}}}}
grid: {{scenario.sensor.sigma_range: [0.2, 20]}}
tables: {{}}
figures:
  anees: {{kind: anees, n_x: 4}}
  autocorrelation: {{kind: autocorrelation}}
  banana: {{kind: banana, ranges_km: [50], conversions: [ccm]}}
  bars: {{kind: bars, metric: mean(rmse_position)}}
  bias: {{kind: bias, rows: {{Along: bias_radial, Across: bias_cross}}}}
  calibration: {{kind: calibration, columns: {{State: pit_nees@last}}}}
  critical-difference: {{kind: critical-difference, metric: rmse_position}}
  dots: {{kind: dots, columns: {{Bias: mean(bias_radial)}}, expected: {{mean(bias_radial): 0}}}}
  estimates: {{kind: estimates}}
  heat-map: {{kind: heat-map, metric: mean(rmse_position)}}
  nis: {{kind: nis, over: 1}}
  posterior: {{kind: posterior}}
  reliability: {{kind: reliability}}
  rmse-per-run: {{kind: rmse-per-run, metric: rmse_position}}
  rmse-vs-parameter: {{kind: rmse-vs-parameter}}
  rmse-vs-time: {{kind: rmse-vs-time, metric: rmse_position}}
  track: {{kind: track, filters: [EKF]}}
"""
ELSEWHERE = {  # what needs another experiment or command: the test that draws it
    "accuracy-vs-cost": "report/test_cost.py",
    "mean-and-std": "report/test_maneuver_report.py",
    "sweep": "test_sweep.py",
    "tuning": "tuning/test_tune.py",
}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Results:
    return ran(tmp_path_factory.mktemp("kinds"), CONFIG).results


def _values(frame: pd.DataFrame, metric: str) -> np.ndarray:
    return frame.loc[frame["metric"] == metric, "value"].to_numpy()


def _of_step(metric: str) -> Callable[[Results], np.ndarray]:
    return lambda results: _values(results.per_step, metric)


def _of_summary(metric: str) -> Callable[[Results], np.ndarray]:
    return lambda results: _values(results.summary, metric)


def _mean_autocorrelations(results: Results) -> np.ndarray:
    rows = pd.read_csv(results.folder / "per_run.csv")
    rows = rows[rows["metric"].str.startswith("autocorrelation_")]
    keys = ["scenario.sensor.sigma_range", "filter", "metric"]
    return rows.groupby(keys)["value"].mean().to_numpy()


NUMBERS: dict[str, Callable[[Results], np.ndarray]] = {
    "anees": _of_step("anees"),
    "autocorrelation": _mean_autocorrelations,
    "bars": _of_summary("mean(rmse_position)"),
    "bias": _of_step("bias_radial"),
    "dots": _of_summary("mean(bias_radial)"),
    "heat-map": _of_summary("mean(rmse_position)"),
    "nis": _of_step("anis"),
    "rmse-per-run": lambda results: _values(
        pd.read_csv(results.folder / "per_run.csv"), "rmse_position"
    ),
    "rmse-vs-parameter": _of_summary("mean(rmse_position)"),
    "rmse-vs-time": _of_step("rmse_position"),
}


def _drawn(figure: Figure) -> np.ndarray:
    """Every number of a line, a dot, a bar or a cell."""
    parts: list[object] = []
    for ax in figure.axes:
        parts += [line.get_xydata() for line in ax.lines]
        parts += [one.get_offsets() for one in ax.collections]
        parts += [one.get_array() for one in (*ax.collections, *ax.images)]
        parts += [
            (one.get_width(), one.get_height()) for one in ax.patches if hasattr(one, "get_width")
        ]
    flat = [
        np.ma.filled(np.ma.asarray(part, float), np.nan).ravel()
        for part in parts
        if part is not None
    ]
    numbers = np.concatenate(flat)
    return np.unique(numbers[np.isfinite(numbers)])


def test_no_kind_is_left_out(results: Results) -> None:
    assert {*results.parts("figures"), *ELSEWHERE} == set(kinds("figures"))


@pytest.mark.parametrize("name", sorted(set(kinds("figures")) - set(ELSEWHERE)))
def test_a_figure_shows_the_numbers_of_the_files(results: Results, name: str) -> None:
    figure = results.parts("figures")[name].draw(results)
    there = _drawn(figure)
    assert len(there) > 5
    if name in NUMBERS:
        asked = NUMBERS[name](results)
        asked = asked[np.isfinite(asked)]
        assert len(asked) > 3
        nearest = there[np.abs(there[:, None] - asked).argmin(axis=0)]
        np.testing.assert_allclose(nearest, asked, rtol=1e-6, atol=1e-12)
    file_formats.close(figure)


@pytest.mark.parametrize("name", sorted(set(kinds("figures")) - set(ELSEWHERE)))
def test_a_caption_says_what_this_figure_shows(results: Results, name: str) -> None:
    """Filters and runs, in place of the description of the kind."""
    spec = results.parts("figures")[name]
    caption = spec.default_caption(results)
    assert caption.endswith(".")
    assert (inspect.getdoc(type(spec)) or "").partition("\n")[0] not in caption
    if name != "banana":  # of no run
        assert "EKF" in caption
        assert re.search(r"\b12 runs|[Rr]un 1\b|the first run", caption)


@pytest.mark.parametrize(
    ("motion", "unit"),
    [
        ("{kind: cv, q: 1, noise_gain: standard}", "m²/s⁴"),
        ("{kind: cv, q: 1, noise_gain: printed}", "m²/s²"),
        ("{kind: ca, q: 1, noise_gain: printed}", "m²/s⁴"),
        ("{kind: cwna, q: 1}", "m²/s³"),
    ],
)
def test_a_swept_noise_has_the_unit_of_its_motion(tmp_path: Path, motion: str, unit: str) -> None:
    path = "filters.A.assume.motion.q"
    (tmp_path / "config.yaml").write_text(
        f"filters: {{A: {{kind: kf, assume: {{motion: {motion}}}}}}}\ngrid: {{{path}: [1, 2]}}\n"
    )
    assert Results(tmp_path).axis(path) == f"q ({unit})"
