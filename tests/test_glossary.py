"""What can be measured is listed: registered, and of an experiment."""

import pytest
from typer.testing import CliRunner

from tests.conftest import EXPERIMENT_FILES, shipped
from tests.papers import merwe_text
from trackbench.cli.app import app
from trackbench.config.available_metrics import names_of
from trackbench.evaluation.metric_expression import measured
from trackbench.help import metrics
from trackbench.metrics import metric_of

SHIPPED = EXPERIMENT_FILES.values()


@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_of_every_metric_it_is_known_what_it_is(path):
    e = shipped(path.stem)
    names = names_of(e.settings, e.points[:1], e.left_out, with_diagnostics=True)
    assert not names.unprobed
    unknown = {m.metric for m in map(measured, names.per_run | names.per_step) if m.is_row}
    assert {name for name in unknown if not metric_of(name)[0].help} == set()


def test_an_experiments_metrics_are_listed():
    text = metrics.metrics_of_config(EXPERIMENT_FILES["adaptive-kf"])
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert (
        "rmse_position run, step m, lower is better root mean square length of the error" in lines
    )
    assert (
        "missed_maneuvers run lower is better share of legs that went by without the maneuvering mode"
        in lines
    )
    assert any(line.startswith("rmse_velocity not kept") for line in lines)
    assert any(line.startswith("windows of steps: before, leg 1") for line in lines)
    assert any(
        line.startswith("numbers beside them: ") and "cpu_s_per_run" in line for line in lines
    )


def told(*words):
    return CliRunner().invoke(app, words)


@pytest.mark.parametrize(
    "more",
    [
        "metrics: [rsme]\n",
        "tables: {t: {kind: metrics, columns: {E: mean(rsme)}}}\n",
        "figures: {f: {kind: rmse-vs-time, metric: rsme}}\n",
    ],
)
def test_whoever_has_a_metric_wrong_sees_the_list(tmp_path, more):
    path = tmp_path / "a.yaml"
    start = f"name: a\nruns: 2\nscenario: {merwe_text(T=5)}\nfilters: {{UKF: {{kind: ukf}}}}\n"
    path.write_text(start + more)
    found = told("list", "metrics", str(path))
    assert found.exit_code == 0
    assert "  rmse " in found.stdout
    assert "'rsme'" in found.stderr
    path.write_text(start + more + "seed: x\n")
    assert told("list", "metrics", str(path)).exit_code != 0


def test_the_command_line_tells():
    assert "rmse[_quantity]" in told("list", "metrics").output
    assert "time-mean" in told("list", "statistics").output
    assert "collapsed_steps" in told("list", "metrics", str(EXPERIMENT_FILES["merwe2000"])).output
    assert "m/s, lower is better" in told("describe", "rmse_velocity").output
    both = told("describe", "anees").output  # a figure, and a metric
    assert "anees (figure)" in both
    assert "anees (metric)\n\nmean NEES over the number of components\nnearer 1 is better" in both
    assert "windows of metrics: quiet" in told("describe", "legs").output
