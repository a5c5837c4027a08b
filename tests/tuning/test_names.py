"""Names that tuning gives to filters, tables and figures: none takes the place of the user's own."""

from pathlib import Path

import pytest

from trackbench import api
from trackbench.api import Options
from trackbench.config.added_tables_and_figures import free_name
from trackbench.config.load import load
from trackbench.config.resolved_config import as_yaml, resolved
from trackbench.errors import UserError
from trackbench.report.mean_or_rms_of_metric import compared_statistic
from trackbench.report.sweep_tables_and_figures import as_sweep
from trackbench.report.tables_and_figures import Results

CONFIG = """
name: names
runs: 20
scenario:
  kind: tracking
  last: 12
  target: {kind: driven, motion: {kind: cwna, q: 0.5}}
  sensor: {kind: position, sigma: 2}
  start: {kind: gaussian, sigma: [2, 1, 2, 1]}
filters:
  A-B: &kf {kind: kf, assume: {motion: {kind: cwna, q: 0.01}}}
  A B: *kf
  a+b: *kf
tune: {A-B: &q {assume.motion.q: log:1e-3..10}, A B: *q, a+b: *q}
figures: {tuning-A-B: {kind: rmse-vs-time, metric: rmse_position}}
tables: {Tuning: {kind: metrics, columns: {RMSE: rms(rmse_position)}}}
"""


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "names.yaml"
    path.write_text(CONFIG)
    return path


def test_no_figure_or_table_takes_the_place_of_another(config: Path) -> None:
    experiment = load(config)
    kinds = {name: figure.kind for name, figure in experiment.figures.items()}
    assert kinds == {
        "tuning-A-B": "rmse-vs-time",
        **dict.fromkeys(("tuning-A-B-2", "tuning-A-B-3", "tuning-a-b-4"), "tuning"),
    }
    shown = [getattr(figure, "filter", None) for figure in experiment.figures.values()]
    assert shown == [None, "A-B", "A B", "a+b"]
    kinds = {name: table.kind for name, table in experiment.tables.items()}
    assert kinds == {"Tuning": "metrics", "tuning-2": "tuning"}
    written = config.with_name("config.yaml")
    written.write_text(as_yaml(resolved(experiment, config.parent)))
    again = load(written)
    assert (again.figures, again.tables) == (experiment.figures, experiment.tables)


TUNE = ("tune={A-B: {assume.motion.q: log:1e-3..10}}", "tuning={runs: 8, evaluations: 4}")


def test_tuning_takes_no_default_table_or_figure_and_ranks_by_the_same_number(
    tmp_path: Path,
) -> None:
    head = CONFIG.partition("tune:")[0]
    (tmp_path / "names.yaml").write_text(head)
    statistics = {}
    for name, words in (("plain", ()), ("tuned", TUNE)):
        options = Options(engine="serial", quiet=True, formats=("svg",), set=words)
        folder = api.run(tmp_path / "names.yaml", options, out=tmp_path / name).folder
        results = Results(folder)
        statistics[name] = compared_statistic(results.config, "rmse_position")
        assert "results" in results.tables
        assert {"results", "track"} <= {path.stem for path in (folder / "figures").iterdir()}
    assert statistics == {"plain": "rms", "tuned": "rms"}
    # A table of the config's own ranks by the mean, as without tuning.
    table = "tables={innovations: {kind: innovations}}"
    experiment = load(tmp_path / "names.yaml", overrides=[table, *TUNE])
    assert [*experiment.settings.tables] == ["innovations", "tuning"]
    assert compared_statistic({"tables": experiment.settings.tables}, "rmse_position") == "mean"


@pytest.mark.parametrize(
    ("table", "figures"),
    [
        ("", ["nis", "whiteness", "track"]),
        ("tables: {n: {kind: metrics, columns: {N: mean(nis)}}}", []),
    ],
)
def test_a_tuned_recording_without_truth_keeps_its_default_exhibits(
    tmp_path: Path, table: str, figures: list[str]
) -> None:
    rows = [f"{t},{5 * t + (-1) ** t},{3 * t - t % 3}" for t in range(40)]
    (tmp_path / "r.csv").write_text("time,x,y\n" + "\n".join(rows) + "\n")
    (tmp_path / "r.yaml").write_text(
        "name: r\nseed: 1\nscenario:\n  kind: tracking\n"
        "  target: {kind: measured, measurements: r.csv}\n"
        "  sensor: {kind: position, sigma: 2}\n  start: two-scan\n  score: {train: 0.5}\n"
        "  assume: {motion: {kind: cwna, q: 1}}\nfilters: {KF: {kind: kf}}\n"
        f"tune: {{KF: {{assume.motion.q: log:0.1..10}}}}\n{table}\n"
        + ("figures: {}\n" if table else "")
    )
    experiment = load(tmp_path / "r.yaml")
    expected = ["n", "tuning"] if table else ["innovations", "tuning"]
    assert [*experiment.tables] == expected
    assert [*experiment.figures] == [*figures, "tuning-KF"]


@pytest.mark.parametrize(
    "entry",
    ["{kind: ukf, assume: {motion: {kind: cwna, q: 0.3}}}", "{kind: kf, gate: 0.9}"],
)
def test_a_filter_of_the_tuned_ones_label_is_refused(config: Path, entry: str) -> None:
    text = CONFIG.replace("tune:", f"  A B (tuned): {entry}\ntune:")
    config.write_text(text)
    line = text[: text.index("A B (tuned)")].count("\n") + 1
    with pytest.raises(UserError) as error:
        load(config)
    assert str(error.value) == (
        f"{config}:{line}:3: filters.A B (tuned): tuning gives this label to the tuned A B: "
        "give this filter another label"
    )


def test_the_tuned_filter_of_an_earlier_run_is_not(config: Path) -> None:
    found = {"A B": {"assume.motion.q": 0.3}}
    written = config.with_name("config.yaml")
    written.write_text(as_yaml(resolved(load(config, tuned_values=found), config.parent)))
    motion = load(written).points[0].assumed["A B (tuned)"].motion
    assert motion.q == 0.3  # type: ignore[union-attr]


def test_a_sweep_keeps_a_table_of_the_users(config: Path) -> None:
    rows = [row for row in CONFIG.splitlines() if not row.startswith(("tune", "figures"))]
    config.write_text("\n".join(rows).replace("Tuning:", "best-settings:"))
    grid = [f"filters.{label}.assume.motion.q=0.1,1" for label in ("A-B", "A B")]
    experiment = as_sweep(load(config, grid=grid))
    kinds = {name: table.kind for name, table in experiment.tables.items()}
    assert kinds == {"best-settings": "metrics", "best-settings-2": "best-settings"}
    assert len(experiment.figures) == 2  # of labels that a file's name does not tell apart


def test_a_free_name() -> None:
    assert free_name("a", []) == "a"
    assert free_name("a", ["A", "b"]) == "a-2"
    assert free_name("a", ["a", "a-2"]) == "a-3"
    assert len(free_name("x" * 80, ["x" * 80])) <= 80


def test_a_model_of_the_scenario_is_tuned_for_one_filter(tmp_path: Path) -> None:
    """A filter without an `assume` of its own starts from that of the scenario."""
    path = tmp_path / "shared.yaml"
    shared = (
        "  start: {kind: gaussian, sigma: [2, 1, 2, 1]}\n  assume: {motion: {kind: cwna, q: 0.3}}\n"
    )
    text = CONFIG.replace("  start: {kind: gaussian, sigma: [2, 1, 2, 1]}\n", shared)
    text = text.replace("&kf {kind: kf, assume: {motion: {kind: cwna, q: 0.01}}}", "{kind: kf}")
    text = text.replace("  A B: *kf\n  a+b: *kf\n", "").replace(", A B: *q, a+b: *q", "")
    path.write_text(text)
    experiment = load(path)
    (point,) = experiment.points
    tuned = point.assumed_scenario("A-B (tuned)").model.motion
    assert tuned == point.assumed_scenario("A-B").model.motion
    chosen = load(path, tuned_values={"A-B": {"assume.motion.q": 7.0}})
    (point,) = chosen.points
    assert point.filters["A-B"] == point.filters["A-B (tuned)"]
    assert point.assumed_scenario("A-B (tuned)").model.motion != tuned
    path.write_text(as_yaml(resolved(chosen, path.parent)))
    assert load(path).points[0].assumed == point.assumed
