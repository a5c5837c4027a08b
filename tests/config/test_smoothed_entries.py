"""The key ``smoothed``, which adds a row with a smoother beside a filter."""

from pathlib import Path

import pytest

from tests.conftest import PLANE
from trackbench.config.dump import as_yaml, resolved
from trackbench.config.load import load
from trackbench.errors import UserError

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


@pytest.mark.parametrize("keys", ["", ", smooth: true, alpha: 2"])
def test_another_filter_of_that_label_is_refused(tmp_path: Path, keys: str) -> None:
    filters = f"filters: {{A: {{kind: ukf}}, 'A, smoothed': {{kind: ukf{keys}}}}}\n"
    with pytest.raises(UserError, match=r"smoothed\.0: there is another filter 'A, smoothed'"):
        load(config(tmp_path, "smoothed: [A]", filters))


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        ("smoothed: [C]", "smoothed.0: 'C' is not a filter here"),
        ("smoothed: A", "smoothed: "),
    ],
)
def test_mistakes(keys: str, what: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=what):
        load(config(tmp_path, keys))


def test_a_filter_without_a_smoother_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="smooth"):
        load(config(tmp_path, "smoothed: [A]", "filters: {A: {kind: epf}}\n"))
