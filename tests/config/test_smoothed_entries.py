"""The key ``smoothed``, which adds a row with a smoother beside a filter."""

from pathlib import Path

from tests.conftest import PLANE
from trackbench.config.load import load
from trackbench.config.resolved_config import as_yaml, resolved

FILTERS = "filters: {A: {kind: ekf}, B: {kind: ukf}}\n"


def config(folder: Path, keys: str, filters: str = FILTERS) -> Path:
    path = folder / "c.yaml"
    path.write_text(f"name: c\n{PLANE}{filters}{keys}\n")
    return path


def test_a_row_with_a_smoother_follows_its_filter(tmp_path: Path) -> None:
    experiment = load(config(tmp_path, "smoothed: [A]"))
    filters = experiment.points[0].filters
    assert list(filters) == ["A", "A, smoothed", "B"]
    assert [f.smooths for f in filters.values()] == [False, True, False]


def test_the_config_of_a_results_folder_is_the_same_experiment(tmp_path: Path) -> None:
    text = as_yaml(resolved(load(config(tmp_path, "smoothed: [A]")), tmp_path))
    (tmp_path / "again.yaml").write_text(text)
    again = load(tmp_path / "again.yaml")
    assert list(again.points[0].filters) == ["A", "A, smoothed", "B"]
    assert as_yaml(resolved(again, tmp_path)) == text


def test_an_entry_of_that_label_stays(tmp_path: Path) -> None:
    filters = "filters: {A: {kind: ekf}, 'A, smoothed': {kind: ekf, smooth: {lag: 3}}}\n"
    experiment = load(config(tmp_path, "smoothed: [A]", filters))
    smoothed = experiment.points[0].filters["A, smoothed"]
    assert getattr(smoothed, "lag", None) == 3
