"""A target, sensor or start of one's own that is wrong: said in a line with its file and line."""

import sys
from pathlib import Path
from typing import Generic

import pytest

from tests.bad_input.test_bad_input import LISTS, good_files
from tests.commands import trackbench
from tests.conftest import make_filter
from trackbench.cli.app import main
from trackbench.config import metric_name_checks
from trackbench.plugins.plugin_errors import location_of

pytestmark = pytest.mark.usefixtures("no_report")

FILES = good_files(LISTS["plugin_parts"])


def write(folder: Path, old: str = "", new: str = "") -> None:
    """Write a config with parts of a plugin, edited."""
    for name, text in FILES.items():
        (folder / name).write_text(text.replace(old, new) if old else text)


def test_a_mistake_is_a_line_of_list_metrics(tmp_path: Path) -> None:
    write(tmp_path, '"Start."', '"Start."\n    def check(self, components, sensor):\n        1 / 0')
    done = trackbench("list", "metrics", "c.yaml", "--allow-plugins", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == "c.yaml:5:3: scenario: mine.py:28: ZeroDivisionError: division by zero\n"


WHOLE = {
    "windows": ('"": self.steps > 0', '"": self.steps[1:] > 0', "the window '' is an array (40,)"),
    "times": ("self.steps * self.interval", "[1, 2]", "times is a list, not an array (41,)"),
    "errors": ("error[[0, 2]]", "error[[0, 2]][:, :1]", "the error 'position' is an array (2, 1, 2)"),
    "simulate": ("Simulation(truth, ", "Simulation(truth.T, ", "the truth is an array (2, 41, 4)"),
}  # fmt: skip


@pytest.mark.parametrize("method", WHOLE)
def test_a_scenario_of_ones_own(method: str, tmp_path: Path) -> None:
    sys.modules.pop("own_radar", None)  # of the test before
    made = trackbench("new", "scenario", "own-radar", cwd=tmp_path)
    good, bad, said = WHOLE[method]
    assert made.returncode == 0, made.stderr
    text = (tmp_path / "own_radar.py").read_text()
    (tmp_path / "own_radar.py").write_text(text.replace(good, bad))
    done = trackbench("check", "own_radar.yaml", "--allow-plugins", cwd=tmp_path)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2
    assert said in line
    place = int(line.partition("own_radar.py:")[2].partition(":")[0])
    rows = text.splitlines()[place - 1 : place + 1]  # of a property the decorator
    assert any(f"def {method}(" in row for row in rows)


def test_an_error_is_not_named_as_that_of_a_prediction(tmp_path: Path) -> None:
    sys.modules.pop("own_radar", None)  # of another test
    trackbench("new", "scenario", "own-radar", cwd=tmp_path)
    text = (tmp_path / "own_radar.py").read_text()
    text = text.replace('"velocity": error', '"predicted_x": error')
    (tmp_path / "own_radar.py").write_text(text)
    done = trackbench("check", "own_radar.yaml", "--allow-plugins", cwd=tmp_path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "own_radar.py:" in line
    assert "an error cannot be named 'predicted_x', as rmse_predicted_x" in line


def test_pythons_own_files_are_nobodys() -> None:
    """Every filter is a `Generic`, whose file is none of a plugin's."""
    assert location_of(_raised_in_typing(), make_filter("pf", N=5)) == ""


def _raised_in_typing() -> TypeError:
    with pytest.raises(TypeError) as caught:
        Generic[int]
    return caught.value


def test_a_good_one_runs(tmp_path: Path) -> None:
    write(tmp_path)
    assert trackbench("run", "c.yaml", "--allow-plugins", cwd=tmp_path).returncode == 0


def test_what_is_found_only_in_the_run_is_a_line(tmp_path: Path) -> None:
    """In the sixth run; `check` simulates two."""
    body = "        assert max(rng.runs) < 5\n"
    rest = "        return super().fly(start, timeline, sensor, rng, scans)"
    fly = "    def fly(self, start, timeline, sensor, rng, scans):\n"
    write(tmp_path, '"Target."', f'"Target."\n{fly}{body}{rest}')
    done = trackbench("run", "c.yaml", "--allow-plugins", cwd=tmp_path)
    assert done.returncode == 1
    assert "error: KF failed: mine.py:16: AssertionError" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_bug_of_our_own_stays_a_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path)
    monkeypatch.setattr(metric_name_checks, "requests_of", lambda parts: 1 / 0)
    monkeypatch.setattr("sys.argv", ["trackbench", "check", "c.yaml", "--allow-plugins"])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ZeroDivisionError):
        main()
