"""Mistakes on the command line and in files of one's own: a line for each, and nothing is written."""

from pathlib import Path

import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.atomic_files import write_text
from trackbench.config.load import load
from trackbench.errors import UserError, WriteError
from trackbench.execution.engines import engine
from trackbench.verify import verify

CONFIG = """
name: a
runs: 4
scenario: MERWE
filters: {PF: {kind: pf, N: 5}, UKF: {kind: ukf}}
""".replace("MERWE", merwe_text(T=5))
RECORDED = """
name: a
scenario:
  kind: tracking
  T: 1
  target: {kind: measured, measurements: m.csv}
  sensor: {kind: position, sigma: 10}
  start: {kind: one-scan, sigma_velocity: 20}
  assume: {motion: {kind: cv, q: 4}}
filters: {KF: {kind: kf}}
"""
PLAIN = """
from trackbench.registry import register

@register("filters", "mistaken-plain")
class Mine:
    pass
"""
MINE = """
from dataclasses import dataclass
from trackbench.filters.ukf import UKF
from trackbench.registry import register

@register("filters", "mistaken-not")
@dataclass(frozen=True, kw_only=True)
class Mine(UKF):
    '''Mine.'''
"""


def mistakes(folder: Path, text: str = CONFIG, **changes: object) -> list[str]:
    (folder / "a.yaml").write_text(text)
    there = set(folder.rglob("*"))
    options = api.Options(engine="serial", quiet=True, out=folder / "o", formats=())
    with pytest.raises(UserError) as caught:
        api.run(folder / "a.yaml", options, **changes)
    assert set(folder.rglob("*")) == there
    return str(caught.value).splitlines()


@pytest.mark.parametrize(
    ("axis", "what"),
    [
        ("filters.QQ.N=1,2", "grid.filters.QQ.N: 'QQ' is not a filter here; known: PF, UKF"),
        ("runs=1,2", "grid.runs: a grid varies scenario.KEY or filters.LABEL.KEY"),
        ("scenario=1,2", "grid.scenario: a grid varies scenario.KEY or filters.LABEL.KEY"),
        ("filters.PF=1", "filters.PF: is not a mapping with a kind"),
        ("scenario.sensor.R=.inf", "scenario.sensor.R: Infinity is not a finite number"),
    ],
)
def test_a_grid_over_nothing(tmp_path: Path, axis: str, what: str) -> None:
    assert mistakes(tmp_path, grid=[axis]) == [f"--grid {axis}: {what}"]


@pytest.mark.parametrize(
    ("typed", "what"),
    [
        ("block=0", "block: 0 is less than 1 and not one of fit"),
        ("block=it is", "block: 'it is' is not a whole number and not one of fit"),
        ("scenario.sensor.detection=0", "0 is not greater than 0 and not one of 1"),
        ("scenario.target.measurements=[1, m.csv]", "measurements.0: 1 is not a word"),
        ("scenario.target.measurements=1", "measurements: 1 is not a word and not a list"),
        ("filters.KF=ekf", "filters.KF: 'ekf' is not a mapping"),
        ("filters={}", "filters: name at least one filter"),
    ],
)
def test_a_value_that_is_none_of_several_types_is_one_line(
    tmp_path: Path, typed: str, what: str
) -> None:
    (tmp_path / "m.csv").write_text("step,x,y\n0,1,1\n1,2,3\n")
    (found,) = mistakes(tmp_path, RECORDED, set=[typed])
    assert found.startswith(f"--set {typed}: ")
    assert found.endswith(what)


def test_without_a_filter_no_other_name_is_unknown(tmp_path: Path) -> None:
    more = "filters: {}\ntables: {t: {kind: metrics, filters: [A], columns: {E: mean(rmse)}}}\n"
    (tmp_path / "m.csv").write_text("step,x,y\n0,1,1\n1,2,3\n")
    (found,) = mistakes(tmp_path, RECORDED.replace("filters: {KF: {kind: kf}}\n", more))
    assert found.endswith("filters: name at least one filter")


def test_a_path_leads_through_an_item_that_is_no_mapping(tmp_path: Path) -> None:
    imm = "IMM: {kind: imm, motions: [null, cv], transition: [[0.9, 0.1], [0.1, 0.9]]}"
    text = CONFIG.replace("UKF: {kind: ukf}", imm)
    for item in (0, 1):
        found = mistakes(tmp_path, text, set=[f"filters.IMM.motions.{item}.q=1"])
        assert (
            f"--set filters.IMM.motions.{item}.q=1: filters.IMM.motions.{item}: needs a kind"
            in found
        )


def test_a_filter_within_an_imm_has_no_model_of_its_own(tmp_path: Path) -> None:
    imm = "IMM: {kind: imm, motions: [cv], transition: [[1]], filter: {kind: ekf, assume: {}}}"
    found = mistakes(tmp_path, CONFIG.replace("UKF: {kind: ukf}", imm))
    assert any("filters.IMM.filter.assume: unknown key" in line for line in found)


def test_a_value_of_a_grid_that_is_given_twice(tmp_path: Path) -> None:
    text = CONFIG + "grid: {filters.PF.N: [20, 5, 20]}\n"
    (found,) = mistakes(tmp_path, text)
    path = tmp_path / "a.yaml"
    assert found == f"{path}:6:30: grid.filters.PF.N.2: 20 is given twice"
    (found,) = mistakes(tmp_path, grid=["filters.PF.resampling=residual,residual"])
    assert found.endswith("grid.filters.PF.resampling.1: 'residual' is given twice")


@pytest.mark.parametrize(
    ("axes", "column", "where", "what"),
    [
        (
            '{scenario.sensor.R: [1, 2], "scenario.sensor.R & scenario.target.launch.x": [3, 4]}',
            35,
            "scenario.sensor.R & scenario.target.launch.x",
            "scenario.sensor.R is varied by 'scenario.sensor.R', too",
        ),
        (
            '{"scenario.target.launch.x & scenario.sensor.R": [3, 4], scenario.sensor.R: [1, 2]}',
            64,
            "scenario.sensor.R",
            "scenario.sensor.R is varied by 'scenario.target.launch.x & scenario.sensor.R', too",
        ),
        (
            "{filters.PF: [{kind: pf}, {kind: apf}], filters.PF.N: [5, 9]}",
            47,
            "filters.PF.N",
            "filters.PF.N is varied by 'filters.PF', too",
        ),
        (
            "{filters.PF.N: [5, 9], filters.PF: [{kind: pf}, {kind: apf}]}",
            30,
            "filters.PF",
            "filters.PF.N is varied by 'filters.PF.N', too",
        ),
        (
            '{"scenario.sensor.R & scenario.sensor.R": [3, 4]}',
            8,
            "scenario.sensor.R & scenario.sensor.R",
            "scenario.sensor.R is varied by 'scenario.sensor.R & scenario.sensor.R', too",
        ),
    ],
)
def test_axes_of_a_grid_that_overlap(
    tmp_path: Path, axes: str, column: int, where: str, what: str
) -> None:
    found = mistakes(tmp_path, f"{CONFIG}grid: {axes}\n")
    assert found == [f"{tmp_path / 'a.yaml'}:6:{column}: grid.{where}: {what}"]


def test_axes_of_the_command_line_that_overlap(tmp_path: Path) -> None:
    axis = "scenario.target.launch.x & scenario.sensor.R=1,2"
    found = mistakes(tmp_path, CONFIG + "grid: {scenario.sensor.R: [3, 4]}\n", grid=[axis])
    what = "scenario.sensor.R is varied by 'scenario.sensor.R', too"
    path = "grid.scenario.target.launch.x & scenario.sensor.R"
    assert found == [f"--grid {axis}: {path}: {what}"]


def test_an_axis_that_is_typed_twice(tmp_path: Path) -> None:
    found = mistakes(tmp_path, grid=["scenario.sensor.R=1,2", "scenario.sensor.R=3,4"])
    assert found == ["--grid scenario.sensor.R=3,4: grid.scenario.sensor.R: is given twice"]
    (tmp_path / "a.yaml").write_text(CONFIG + "grid: {scenario.sensor.R: [1, 2]}\n")
    (point,) = load(
        tmp_path / "a.yaml", grid=["scenario.sensor.R=3"]
    ).points  # the file's is replaced
    assert point.values == {"scenario.sensor.R": 3}


def test_a_preset_that_is_overruled_by_all_keys(tmp_path: Path) -> None:
    """As in the config that a run has written: every point would be the first preset."""
    given = "{kind: ukf, Q: 1.0, R: 1.0, P0: null, noise_mean: true}"
    text = CONFIG.replace("{kind: ukf}", given)
    (found,) = mistakes(tmp_path, text, grid=["filters.UKF.preset=merwe-demo"])
    what = "no preset of ukf changes anything: all that they set is given"
    assert found.endswith(f": filters.UKF.preset: {what}")


def test_a_label_that_cannot_be_seen(tmp_path: Path) -> None:
    found = mistakes(tmp_path, only=[""])
    assert found == ["--only : only.0: '' is not one line of visible characters"]


@pytest.mark.parametrize("out", ["a.yaml", "a.yaml/below"])
def test_the_folder_is_a_file(tmp_path: Path, out: str) -> None:
    (found,) = mistakes(tmp_path, out=tmp_path / out)
    assert found.endswith(f"{tmp_path / 'a.yaml'} is a file, not a folder")


@pytest.mark.parametrize("address", ["nonsense", "http://localhost:80", "tcp://:1", "tcp://host"])
def test_an_address_that_is_none(tmp_path: Path, address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(UserError, match="write tcp://host:port"), engine("dask", 1, address)():
        pass


@pytest.mark.parametrize(
    ("code", "what"),
    [
        ("import sys\nsys.exit(3)", "own.py:2: SystemExit: 3"),
        (PLAIN, "Mine is not a dataclass"),
    ],
    ids=["leaves", "no dataclass"],
)
def test_a_plugin_that_is_none(tmp_path: Path, code: str, what: str) -> None:
    (tmp_path / "own.py").write_text(code)
    (found,) = mistakes(tmp_path, CONFIG + "plugins: [own.py]\n", allow_plugins=True)
    assert found.startswith(f"{tmp_path / 'a.yaml'}:6:11: plugins.0: ")
    assert what in found


def test_results_of_a_plugin_are_verified_if_it_may_run(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(MINE)
    text = CONFIG.replace("kind: ukf", "kind: mistaken-not") + "plugins: [own.py]\n"
    (tmp_path / "a.yaml").write_text(text)
    options = api.Options(engine="serial", quiet=True, out=tmp_path / "o", formats=())
    api.run(tmp_path / "a.yaml", options, allow_plugins=True)
    assert verify(tmp_path / "o", 2, allow_plugins=True) == []
    with pytest.raises(UserError, match="is run only with --allow-plugins"):
        verify(tmp_path / "o", 2)


def test_a_folder_that_cannot_be_written_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "open", refused)
    monkeypatch.setattr(Path, "unlink", refused)
    with pytest.raises(WriteError, match=r"cannot write .*a\.txt: read-only file system"):
        write_text(tmp_path / "a.txt", "text")
