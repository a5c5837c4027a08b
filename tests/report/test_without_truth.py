"""A recording without a truth: what is shown of it, what may be asked, and which way better is."""

import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from tests.report.test_findings import NATS, ranked
from trackbench import api
from trackbench.errors import UserError
from trackbench.report.figures.critical_difference import mean_ranks
from trackbench.report.findings.ranking import rankings
from trackbench.report.plotting import style

RADAR = """
kind: tracking
T: 2
last: 60
target:
  kind: legs
  launch: {x: 9000, y: 5000, vx: -60, vy: 80}
  legs: [{start: 40, end: 70, turn_rate_deg_s: 2}]
sensor: {kind: range-azimuth, sigma_range: 50, sigma_azimuth_mrad: 3}
start: two-scan
assume: {motion: {kind: cv, q: 4}}
"""
CONFIG = """
name: rec
seed: 2
scenario:
  kind: tracking
  T: 2
  target: {kind: measured, measurements: m.csv}
  sensor: {kind: range-azimuth, sigma_range: 50, sigma_azimuth_mrad: 3}
  start: {kind: given, mean: [8880, -60, 5160, 80], sigma: [60, 40, 60, 40]}
  assume: {motion: {kind: cv, q: 4}}
filters:
  EKF: {kind: ekf}
  RPF: {kind: rpf, N: 300}
"""


PLANE = """
name: {name}
seed: 2
scenario:
  kind: tracking
  T: 1
  target: {{kind: measured, measurements: {name}.csv}}
  sensor: {{kind: position, sigma: 10}}
  start: {{kind: one-scan, sigma_velocity: 20}}
  assume: {{motion: {{kind: cv, q: 4}}}}
filters:
  KF: {{kind: kf}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A radar's scenario and three recorded runs of it."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "radar.yaml").write_text(RADAR)
    (folder / "sim.yaml").write_text(
        "name: sim\nruns: 3\nscenario: {use: radar.yaml}\nfilters: {EKF: {kind: ekf}}\n"
    )
    out = run(folder, "sim", save_tracks=True).folder
    with np.load(out / "tracks.npz") as tracks:
        z, steps = tracks["measurements"], tracks["steps"][1:]
    rows = [(m, k, *z[:, i, m]) for m in range(3) for i, k in enumerate(steps)]
    frame = pd.DataFrame(rows, columns=["run", "step", "range", "azimuth"])
    frame.to_csv(folder / "m.csv", index=False)
    return folder


def run(folder: Path, name: str, more: str = "", **options: object) -> api.Report:
    path = folder / f"{name}.yaml"
    if name != "sim":
        path.write_text(CONFIG + more)
    keys = {"formats": (), "workers": 1, "quiet": True, "out": folder / f"out-{name}"} | options
    return api.run(path, **keys)


def mistakes(folder: Path, more: str) -> list[str]:
    path = folder / "bad.yaml"
    path.write_text(CONFIG + more)
    with pytest.raises(UserError) as caught:
        api.prepare(path, api.Options())
    return str(caught.value).splitlines()


def test_what_can_be_said_is_shown_and_nothing_else(folder: Path) -> None:
    report = run(folder, "default", "hold_out: 5\n", formats=("svg",))
    (name,) = report.tables
    text = report.tables[name].markdown()
    assert name == "innovations"
    assert "–" not in text
    assert "Held-out log score" in text
    assert "95 % bands of a consistent filter" in text
    assert {p.stem for p in (report.folder / "figures").iterdir()} == {"nis", "whiteness", "track"}
    page = (report.folder / "report.html").read_text()
    assert "Truth" not in page
    assert "RMSE" not in page
    again = api.run(report.folder / "config.yaml", out=folder / "again", quiet=True, workers=1)
    for file in ("per_run.csv", "per_step.csv", "tables/innovations.csv"):
        assert (again.folder / file).read_bytes() == (report.folder / file).read_bytes()


def recorded(folder: Path, name: str, rows: list[str], more: str = "", **options: object) -> str:
    """The table of innovations of a recording in the plane, as Markdown."""
    (folder / f"{name}.csv").write_text("\n".join(["run,step,x,y", *rows]) + "\n")
    (folder / f"{name}.yaml").write_text(PLANE.format(name=name) + more)
    keys = {
        "formats": ("svg",),
        "workers": 1,
        "quiet": True,
        "out": folder / f"out-{name}",
    } | options
    return api.run(folder / f"{name}.yaml", **keys).tables["innovations"].markdown()


def test_of_nothing_measured_no_band_is_given(folder: Path) -> None:
    text = recorded(folder, "empty", ["1,0,1,1", "1,1,,", "1,2,,"])
    assert "Nothing was measured after the start" in text
    assert "nan" not in text
    assert "inf" not in text


def test_a_gate_that_rejects_everything_is_named(folder: Path) -> None:
    gated = "  Gated: {kind: kf, gate: 1.0e-9}\n"
    text = recorded(folder, "gated", ["1,0,1,1", "1,1,2,3", "1,2,3,5"], gated)
    assert "Gated: The gate rejected every measurement, so there is no ANIS" in text
    assert "Nothing was measured" not in text


def test_a_filter_without_a_covariance_is_named(folder: Path) -> None:
    program = folder / "mean_alone.py"
    program.write_text(
        "import sys\n"
        "for line in sys.stdin:\n"
        "    word = line.split()[0]\n"
        "    if word != 'end':\n"
        "        print('ready' if word == 'trackbench' else '1 0 1 0', flush=True)\n"
    )
    external = f"  Mean: {{kind: external, command: ['{sys.executable}', '{program}']}}\n"
    options = {"allow_plugins": True}
    text = recorded(folder, "alone", ["1,0,1,1", "1,1,2,3", "1,2,3,5"], external, **options)
    assert "Mean: Without a covariance there is no ANIS" in text
    assert "Nothing was measured" not in text


def test_one_scored_step_has_no_autocorrelation(folder: Path) -> None:
    text = recorded(folder, "single", ["1,0,1,1", "1,1,2,3"])
    assert "| KF | 0.004160 | – |" in text


def test_a_run_with_an_infinite_prediction_error_is_lost(folder: Path) -> None:
    text = recorded(folder, "large", ["1,0,1,1", "1,1,1e200,1", "1,2,3,1"])
    assert "| KF | all runs lost |" in text


def unequal(rows: dict[int, int]) -> list[str]:
    """Runs of so many recorded steps each."""
    return [f"{run},{k},{10 * k},{k % 3}" for run, steps in rows.items() for k in range(steps)]


def test_the_band_is_that_of_the_mean_over_unequal_runs(folder: Path) -> None:
    text = recorded(folder, "unequal", unequal({1: 30, 2: 30, 3: 30, 4: 30, 5: 5}))
    low, high = chi2.ppf([0.025, 0.975], N := 25 / (4 / 58 + 1 / 8)) / N
    band = f"ANIS {low:.3f} to {high:.3f}, autocorrelation within {1.96 / N**0.5:.3f}."
    assert f"over 240 measured components: {band}" in text


def test_equal_runs_have_the_band_of_their_sum(folder: Path) -> None:
    text = recorded(folder, "equal", unequal({1: 30, 2: 30}))
    assert (
        "over 116 measured components: ANIS 0.759 to 1.273, autocorrelation within 0.182." in text
    )


def test_every_point_of_a_grid_has_its_own_band(folder: Path) -> None:
    more = "grid: {scenario.target.measurements: [long.csv, short.csv]}\n"
    (folder / "short.csv").write_text("\n".join(["run,step,x,y", *unequal({1: 6})]) + "\n")
    text = recorded(folder, "long", unequal({1: 30}), more)
    assert "long.csv: 95 % bands of a consistent filter over 58 measured components" in text
    assert "short.csv: 95 % bands of a consistent filter over 10 measured components" in text


def test_more_is_better_of_a_log_score(folder: Path) -> None:
    report = run(folder, "pairs")
    pairs = pd.read_csv(report.folder / "paired.csv")
    scores = report.per_run[report.per_run["metric"] == "log_score"]
    mean = scores.groupby("filter")["value"].mean()
    (row,) = pairs[pairs["metric"] == "log_score"].itertuples()
    assert row.difference == pytest.approx(mean[row.filter_a] - mean[row.filter_b], rel=1e-5)


def test_a_sweep_finds_the_highest_score(folder: Path) -> None:
    path = folder / "swept.yaml"
    path.write_text(CONFIG + "hold_out: 4\n")
    grid = ["filters.EKF.gate=0.3,0.9999"]
    options = {"out": folder / "swept", "quiet": True, "workers": 1, "formats": ()}
    report = api.sweep(path, grid=grid, only=["EKF"], **options)
    rows = pd.read_csv(folder / "swept" / "sweep.csv")
    scores = rows[rows["metric"] == "mean(held_log_score)"].set_index(grid[0].partition("=")[0])
    (best,) = report.best
    assert best.point == {"filters.EKF.gate": scores["value"].idxmax()}
    assert f"EKF at gate = {scores['value'].idxmax():g}: mean held-out log score" in str(best)
    assert [*best.ties] == [{"filters.EKF.gate": 0.3}]  # of three runs


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (
            "tables: {t: {kind: metrics, columns: {E: rms(rmse_position)}}}\n",
            "tables.t.columns.E: 'rmse_position' needs ground truth, and the recording has none; "
            "known: anis",
        ),
        ("tables: {t: {kind: consistency}}\n", "tables.t: 'anees' needs ground truth"),
        (
            "figures: {f: {kind: rmse-vs-time, metric: rmse_position}}\n",
            "figures.f.metric: 'rmse_position' needs ground truth",
        ),
        ("figures: {f: {kind: track, best: 0}}\n", "figures.f.filters: there is no truth to draw"),
        (
            'tables: {t: {kind: metrics, columns: {E: "gain(mean(log_score), RPF)"}}}\n',
            "a log score is a logarithm, and ratios of it mean nothing; take minus(...)",
        ),
        ("hold_out: 1\n", "hold_out"),
    ],
)
def test_what_needs_a_truth_is_one_line(folder: Path, more: str, expected: str) -> None:
    lines = mistakes(folder, more)
    assert len(lines) == 1
    assert expected in lines[0]


def test_an_experiment_that_asks_for_nothing_of_it_has_nothing_of_it(folder: Path) -> None:
    metrics = set(run(folder, "sim").per_run["metric"])
    assert not {m for m in metrics if "log_score" in m or "predicted" in m or "anis" in m}


def test_ranks_of_a_score_begin_with_the_highest() -> None:
    assert mean_ranks(-np.array([[1.0, 2.0], [3.0, 4.0]])).tolist() == [2.0, 1.0]


def test_one_recording_is_decided_by_its_steps(tmp_path: Path) -> None:
    """A filter that believes the wrong noise is worse, and an equal one is equal."""
    rng = np.random.default_rng(11)
    x = np.cumsum(rng.standard_normal(400))
    rows = [
        f"{k},{a + 2.0 * e:.6f}"
        for k, (a, e) in enumerate(zip(x, rng.standard_normal(400), strict=True))
    ]
    (tmp_path / "one.csv").write_text("\n".join(["step,z", *rows]))
    (tmp_path / "one.yaml").write_text(
        "name: one\nscenario:\n  kind: tracking\n"
        "  target: {kind: measured, measurements: one.csv, axes: 0}\n"
        "  assume: {motion: {kind: ar1, q: 1}}\n"
        "  sensor: {kind: function, h: {z: x}, R: 4}\n"
        "  start: {kind: given, mean: [0], cov: [[4]]}\n"
        "filters:\n  Good: {kind: kf}\n  Same: {kind: ekf}\n"
        "  Bad: {kind: kf, assume: {sensor: {kind: function, h: {z: x}, R: 0.04}}}\n"
    )
    report = api.run(tmp_path / "one.yaml", out=tmp_path / "out", quiet=True, formats=())
    rows = ranked(report.results)
    assert [*rows] == ["Good", "Same", "Bad"]
    assert rows["Same"][NATS] == "equal"
    assert re.fullmatch(r"\S+ \(\S+ to \S+\)", rows["Bad"][NATS])
    assert report.answer[-1].startswith("One recording: its steps decide")
    quick = api.run(tmp_path / "one.yaml", out=tmp_path / "q", quiet=True, formats=(), quick=True)
    assert "\nruns: 1\n" in (quick.folder / "config.yaml").read_text()


def test_a_filter_that_skips_measurements_is_ranked_over_those_that_all_score(
    tmp_path: Path,
) -> None:
    """`cmkf` uses no range without an azimuth; the others score the ranges, too."""
    rng = np.random.default_rng(5)
    t = np.arange(300.0)
    x = 9000.0 - 20.0 * t
    y = 5000.0 + 30.0 * t
    distance = np.hypot(x, y) + 50.0 * rng.standard_normal(300)
    azimuth = np.arctan2(y, x) + 0.003 * rng.standard_normal(300)
    rows = ["time,range,azimuth"]
    for k in range(300):
        rows.append(f"{t[k]:g},{distance[k]:.3f},{'' if k % 3 == 2 else f'{azimuth[k]:.7f}'}")
    (tmp_path / "m.csv").write_text("\n".join(rows))
    config = CONFIG.replace("  T: 2\n", "").replace(
        "  RPF: {kind: rpf, N: 300}", "  CMKF: {kind: cmkf}\n  Prior: {kind: prior-mean}"
    )
    config = re.sub("start: .*", "start: {kind: one-scan, sigma_velocity: 50}", config)
    config += "tables: {score: {kind: metrics, columns: {Log score: mean(log_score)}}}\n"
    (tmp_path / "rec.yaml").write_text(config)
    report = api.run(tmp_path / "rec.yaml", out=tmp_path / "out", quiet=True, formats=())
    series = report.results.per_step
    scores = series[series["metric"] == "log_score"]
    by_filter = scores.pivot(index="step", columns="filter", values="value")
    common = by_filter[["EKF", "CMKF"]].dropna()
    assert len(common) < len(by_filter["EKF"].dropna())
    shown = ranked(report.results)
    # A filter without a score is left out, and none is there with one of several settings.
    assert not rankings(report.results)[0].chosen
    for label in ("EKF", "CMKF"):
        assert float(shown[label]["Log score (nats)"]) == pytest.approx(
            common[label].mean(), rel=1e-3
        )
    number = f"{len(common)} of {len(by_filter['EKF'].dropna())} measured steps"
    assert report.answer[-1] == (
        f"The ranking is over the {number} at which every filter has a value; CMKF has none at the "
        "others."
    )
    paired = pd.read_csv(report.folder / "paired.csv").set_index("metric").loc["log_score"]
    difference = (common["EKF"] - common["CMKF"]).mean()
    assert paired["difference"] == pytest.approx(difference, rel=1e-3)
    assert np.sign(paired["z"]) == np.sign(difference)


@pytest.mark.parametrize(
    ("start", "begins_behind"),
    [
        ("{kind: given, mean: [0, 0, 0, 0], sigma: [1e4, 9, 1e4, 9]}", True),
        ("{kind: one-scan, sigma_velocity: 20}", False),
    ],
)
def test_estimates_begin_behind_a_prior_that_is_given(
    tmp_path: Path, start: str, begins_behind: bool
) -> None:
    rows = [f"1,{step},{900 + step},{800 - step}" for step in range(8)]
    (tmp_path / "prior.csv").write_text("\n".join(["run,step,x,y", *rows]) + "\n")
    plane = PLANE.format(name="prior").replace("{kind: one-scan, sigma_velocity: 20}", start)
    plane += "figures: {one: {kind: estimates}}\n"
    (tmp_path / "prior.yaml").write_text(plane)
    keys = {"formats": (), "workers": 1, "quiet": True, "out": tmp_path / "out"}
    results = api.run(tmp_path / "prior.yaml", **keys).results
    with style.rc_context():
        figure = results.parts("figures")["one"].draw(results)
    (line,) = [line for line in figure.axes[0].lines if line.get_label() == "KF"]
    steps = results.tracks({})["steps"]
    assert line.get_xdata().tolist() == steps[1 if begins_behind else 0 :].tolist()
    assert line.get_ydata().min() > 800.0
