"""Exact errors of linear filters, against Monte Carlo runs and the covariance of a matched filter."""

import csv
from dataclasses import dataclass
from math import sqrt
from pathlib import Path

import numpy as np
import pytest

from trackbench import api
from trackbench.config.experiment import Point
from trackbench.config.load import load
from trackbench.core.arrays import Array
from trackbench.core.distributions import Gaussian
from trackbench.evaluation.block_task import BlockTask
from trackbench.evaluation.exact_errors import exact_series, why_not_exact
from trackbench.evaluation.metric_expression import measure
from trackbench.evaluation.run_filter import run_filter
from trackbench.filters.gaussian_base import Tracked
from trackbench.filters.kf import KF
from trackbench.report.expressions import Evaluator
from trackbench.results.write_csv import CsvFiles

LEGS = {
    "kind": "legs",
    "launch": {"x": 100, "y": 50, "vx": 5, "vy": -5},
    "legs": [{"start": 5, "end": 15, "ax": 1.0, "ay": 0.5}],
}
POSITION = {"kind": "position", "sigma": 10}
CV = {"motion": {"kind": "cv", "q": 0.3}}
SPREAD = {"sigma": [20, 5, 20, 5]}
STARTS = {
    "two-scan": "two-scan",
    "one-scan": {"kind": "one-scan", "sigma_velocity": 10},
    "known": "known",
    "gaussian": {"kind": "gaussian", **SPREAD},
    "given": {"kind": "given", "mean": [90, 0, 60, 0], **SPREAD},
    "uniform": {"kind": "uniform", "low": [80, 0, 20, -9], "high": [120, 9, 80, 0]},
    "mixture": {"kind": "mixture", "parts": [{"mean": [90, 4, 50, -4], **SPREAD}]},
}
FILTERS = {
    "KF": {"kind": "kf"},
    "CA": {"kind": "kf", "assume": {"motion": {"kind": "ca", "q": 0.01}}},
    "Smoother": {"kind": "kf", "smooth": True},
    "Lag": {"kind": "kf", "smooth": {"lag": 3}},
    "Alpha-beta": {"kind": "alpha-beta", "q": 0.3},
}


def config(start: object = "two-scan", **scenario: object) -> dict[str, object]:
    """Return an experiment in which every filter has exact errors."""
    keys = {"target": LEGS, "sensor": POSITION, "assume": CV, "last": 30, "start": start}
    filters = {name: {**keys} for name, keys in FILTERS.items()}
    out: dict[str, object] = {"name": "exact", "seed": 5, "runs": 1000, "block": 500}
    whole = {"kind": "tracking", **keys, "score": {"marginals": ["position"]}, **scenario}
    return {**out, "exact": [*filters], "scenario": whole, "filters": filters}


def stored(folder: Path, name: str = "summary.csv") -> dict[tuple[str, ...], tuple[float, float]]:
    """Return values and standard errors by filter, metric and step."""
    with (folder / name).open() as file:
        return {
            (row["filter"], row["metric"], row.get("step", "")): (
                float(row["value"]),
                float(row["stderr"]),
            )
            for row in csv.DictReader(file)
        }


def run(given: dict[str, object], folder: Path) -> Path:
    options = api.Options(engine="serial", quiet=True, out=folder, formats=(), fresh=True)
    return api.run(given, options).folder


CASES: dict[str, dict[str, object]] = {
    **{name: {"start": start} for name, start in STARTS.items()},
    "waypoints": {
        "target": {"kind": "waypoints", "times": [0, 15, 40], "x": [0, 90, 200], "y": [0, 30, -50]}
    },
    "recorded": {"target": {"kind": "recorded", "file": "path.csv"}},
    "bias": {"sensor": {**POSITION, "bias": [3, -2]}},
    "every other step": {"sensor": {**POSITION, "period": 2}},
    "held out": {},
    "two sensors": {"sensor": [POSITION, {**POSITION, "sigma": 20}]},
    "driven": {"target": {"kind": "driven", "motion": {"kind": "cv", "q": 2}}},
}


@pytest.mark.usefixtures("no_report")
@pytest.mark.parametrize("case", CASES)
def test_runs_agree_with_exact_errors(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "path.csv").write_text("time,x,y\n0,0,0\n15,90,30\n25,99,10\n40,200,-50\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(CsvFiles, "_add_runs", lambda *_: None)  # 1000 runs of 300 metrics
    given = config(**CASES[case])
    if case == "held out":
        given["hold_out"] = 3
    if case == "two sensors":
        given["filters"] = {k: v for k, v in FILTERS.items() if k != "Alpha-beta"}
        given["exact"] = [*given["filters"]]  # type: ignore[misc]
    found = stored(run(given, tmp_path / "out"))
    z = [
        (value - found[label, metric, ""][0]) / found[label, metric, ""][1]
        for (of, metric, _), (value, _) in found.items()
        if (label := of.removesuffix(", exact")) != of
        and "std" not in metric
        # A first state that is known has no error, and a constant has no spread.
        and found[label, metric, ""][1] > 1e-9 * abs(value)
    ]
    assert len(z) > 50
    assert max(map(abs, z)) < 4.5  # of some 200 numbers, of which many are correlated
    assert sqrt(np.mean(np.square(z))) < 2.5


@pytest.mark.usefixtures("no_report")
def test_steps_agree_with_exact_errors(tmp_path: Path) -> None:
    found = stored(run(config(), tmp_path / "out"), "per_step.csv")
    z = {
        key: (value - found[of.removesuffix(", exact"), *key][0])
        / found[of.removesuffix(", exact"), *key][1]
        for (of, *key), (value, _) in ((k, v) for k, v in found.items() if k[0] == "KF, exact")
        for key in [tuple(key)]
    }
    metrics = {metric for metric, _ in z}
    assert {"rmse_position", "bias_x", "std_y", "anees", "anees_position", "nis"} <= metrics
    assert max(map(abs, z.values())) < 5.0


def matched(start: object) -> Point:
    """Return a filter that assumes the motion that drives its target."""
    target = {"kind": "driven", "motion": {"kind": "cwna", "q": 2}}
    given = config(start, target=target, assume={})
    given |= {"filters": {"KF": {"kind": "kf"}}, "exact": ["KF"]}
    return load(given).points[0]


@pytest.mark.parametrize("start", ["gaussian", "known"])
def test_a_matched_filter_is_exactly_consistent(start: str) -> None:
    point = matched(STARTS[start])
    tracker = point.filters["KF"]
    task = BlockTask(point.scenario, tracker, 1, index=0, width=2, runs_used=2)
    means = exact_series(task)
    assert means["nees"][1:] == pytest.approx(4.0, rel=1e-9)
    assert means["nees_position"][1:] == pytest.approx(2.0, rel=1e-9)
    assert means["nis"][1:] == pytest.approx(2.0, rel=1e-9)
    # The mean square error is the trace of the filter's covariance.
    with np.errstate(all="ignore"):
        cov = run_filter(task, task.data, covariances=1).cov
    assert cov is not None
    position: Array = cov[0, 0, :, 0] + cov[2, 2, :, 0]
    assert means["squared_position"] == pytest.approx(position, rel=1e-9, abs=1e-9)
    assert means["error_x"] == pytest.approx(0.0, abs=1e-9)


@dataclass(frozen=True, kw_only=True)
class Clipped(KF):
    """A filter that is linear by its word only."""

    def estimate(self, state: Tracked) -> Gaussian:
        """Return the posterior, with an absolute value for a mean."""
        return Gaussian(np.abs(state.posterior.mean), state.posterior.cov)


def test_a_filter_that_is_wrongly_declared_linear_is_refused() -> None:
    scenario = matched(STARTS["gaussian"]).scenario
    linear, clipped = (BlockTask(scenario, tracker, 0, 0, 1, 1) for tracker in (KF(), Clipped()))
    assert why_not_exact(linear) is None
    assert why_not_exact(clipped) == "estimates are not linear in the noise of motion and sensor"


NUMBERS = """\
paper,table,filter,metric,value,digits,runs,experiment,label,expression
p,Table 1,KF,Digits,{exact:.6f},6,,exact,KF,rms(rmse_position)
p,Table 1,KF,Off,{off:.6f},6,,exact,KF,rms(rmse_position)
p,Table 1,KF,Few,{off:.6f},6,5,exact,KF,rms(rmse_position)
p,Table 1,KF,Step,{exact:.6f},6,,exact,KF,rmse_position@9
p,Table 1,KF,Mean,{exact:.6f},6,,exact,KF,mean(rmse_position)
"""


def test_a_verdict_takes_the_exact_number(tmp_path: Path) -> None:
    given = config() | {"runs": 20, "block": 20, "published": [str(tmp_path / "n.csv")]}
    (tmp_path / "n.csv").write_text(NUMBERS.format(exact=1.0, off=1.0))
    found = stored(run(given, tmp_path / "a"))
    exact = found["KF, exact", "rms(rmse_position)", ""][0]
    (tmp_path / "n.csv").write_text(NUMBERS.format(exact=exact, off=1.002 * exact))
    folder = run(given, tmp_path / "b")
    with (folder / "comparison.csv").open() as file:
        rows = {row["metric"]: row for row in csv.DictReader(file)}
    assert {name: row["verdict"] for name, row in rows.items()} | {"Step": "", "Mean": ""} == {
        "Digits": "agrees",
        "Off": "differs",
        "Few": "compatible",  # five runs of the paper leave more room than 0.2 %
        "Step": "",
        "Mean": "",
    }
    per_step = stored(folder, "per_step.csv")
    assert float(rows["Digits"]["measured"]) == exact
    assert float(rows["Step"]["measured"]) == per_step["KF, exact", "rmse_position", "9"][0]
    assert [rows[name]["note"] for name in ("Digits", "Mean")] == ["exact, without runs", ""]
    assert float(rows["Mean"]["stderr"]) > 0.0


def test_tables_and_figures_show_it_where_it_exists(tmp_path: Path) -> None:
    errors = {"kind": "metrics", "columns": {"Position": "rms(rmse_position)", "ANEES": "anees"}}
    tables = {"errors": errors, "consistency": {"kind": "consistency"}}
    curve = {"kind": "rmse-vs-time", "metric": "rmse_position"}
    figures = {
        "curve": curve,
        "named": {**curve, "filters": ["KF, exact"]},
        "without": {**curve, "filters": ["KF", "CA"]},
        "anees": {"kind": "anees", "n_x": 4},
        "spread": {"kind": "mean-and-std"},
        "runs": {"kind": "rmse-per-run", "metric": "rmse_position"},
    }
    given = config() | {"exact": ["KF"], "tables": tables, "figures": figures}
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "out", formats=())
    results = api.run(given | {"runs": 20, "block": 20}, options).results
    rows = {name: [label for (label,) in table.keys] for name, table in results.tables.items()}
    assert rows["errors"] == ["KF", "KF, exact", *list(FILTERS)[1:]]
    assert rows["consistency"] == [*FILTERS]
    dashed = {}
    for name in figures:
        lines = [line for ax in results.figure(name).axes for line in ax.get_lines()]
        dashed[name] = {line.get_label(): line.get_color() for line in lines}.get("KF, exact")
    shown = {"curve", "named", "anees", "spread"}
    assert {name for name, color in dashed.items() if color == "black"} == shown
    assert {name for name, color in dashed.items() if color is None} == {*figures} - shown
    naming = set()
    for name, part in results.parts("figures").items():
        if "exact" in part.default_caption(results):
            naming.add(name)
    # A caption names the curves that the figure has; a share of steps is of filters alone.
    assert naming == shown - {"anees"}


@pytest.mark.usefixtures("no_report")
def test_exact_errors_of_a_filter_that_is_left_out(tmp_path: Path) -> None:
    near = {"kind": "kf", "assume": {"motion": {"kind": "cv", "q": 0.25}}}
    given = config() | {"filters": {"KF": {"kind": "kf"}, "Near": near}, "exact": ["KF", "Near"]}
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "out", formats=())
    results = api.run(given | {"runs": 5, "only": ["Near"]}, options).results
    assert results.labels == ["Near", "Near, exact"]


@pytest.mark.usefixtures("no_report")
def test_a_control_variate_of_a_near_filter(tmp_path: Path) -> None:
    near = {"kind": "kf", "assume": {"motion": {"kind": "cv", "q": 0.25}}}
    filters = {"KF": {"kind": "kf"}, "Near": near}
    columns = {"Plain": "rms(rmse_position)", "Controlled": "controlled(rms(rmse_position), KF)"}
    given = config() | {"filters": filters, "exact": ["KF", "Near"], "runs": 50}
    given |= {"metrics": ["rmse_position"], "per_step": []}
    given["tables"] = {"t": {"kind": "metrics", "columns": columns}}
    found = []
    for seed in range(24):
        results = api.run(
            given | {"seed": seed},
            api.Options(engine="serial", quiet=True, out=tmp_path / str(seed), formats=()),
        ).results
        evaluator = Evaluator(results, {})
        terms = {
            (label, name): evaluator.term(measure(text).of(label))
            for label in filters
            for name, text in columns.items()
        }
        exact = evaluator.exact(measure("rms(rmse_position)").of("Near"))
        assert exact is not None
        # With itself as control variate a filter has its exact error.
        itself = terms["KF", "Controlled"]
        assert itself.value == pytest.approx(
            evaluator.exact(measure("rms(rmse_position)").of("KF")), rel=1e-9
        )
        assert itself.stderr < 1e-9
        found.append(
            [(terms["Near", name].value - exact, terms["Near", name].stderr) for name in columns]
        )
    off, stderr = np.moveaxis(np.array(found), 2, 0)
    spread = off.std(axis=0, ddof=1)
    # The standard error is right, and much smaller: spreads of 24 are known to within 15 % each.
    assert spread == pytest.approx(stderr.mean(axis=0), rel=0.45)
    assert spread[1] < spread[0] / 3.0
    assert abs(off[:, 1].mean()) < 3.5 * spread[1] / sqrt(len(off))


@pytest.mark.usefixtures("no_report")
def test_one_run_has_no_spread_and_an_exact_one_has(tmp_path: Path) -> None:
    found = stored(run(config() | {"runs": 1}, tmp_path / "out"), "per_step.csv")
    assert np.isnan(found["KF", "std_x", "20"][0])
    # After two scans the position is the last measurement.
    assert found["KF, exact", "std_x", "1"][0] == pytest.approx(10.0, rel=1e-4)
