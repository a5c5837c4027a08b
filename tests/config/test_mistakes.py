"""Mistakes that no file alone shows: an address, a model, a folder that cannot be written."""

from pathlib import Path

import pytest

from tests.papers import merwe_text
from trackbench import api
from trackbench.atomic_files import write_text
from trackbench.config.load import load
from trackbench.contract.check_filters_of_file import check_file
from trackbench.errors import UserError, WriteError
from trackbench.execution.engines import engine
from trackbench.models.motions.merwe_sine_gamma import MerweMotion
from trackbench.verify.verify_folder import verify

CONFIG = """
name: a
runs: 4
scenario: MERWE
filters: {PF: {kind: pf, N: 5}, UKF: {kind: ukf}}
""".replace("MERWE", merwe_text(T=5))
MINE = """
from dataclasses import dataclass
from trackbench.filters.ukf import UKF
from trackbench.registry import register

@register("filters", "mistaken-not")
@dataclass(frozen=True, kw_only=True)
class Mine(UKF):
    '''Mine.'''
"""


def test_an_axis_that_is_typed_replaces_that_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(CONFIG + "grid: {scenario.sensor.R: [1, 2]}\n")
    (point,) = load(tmp_path / "a.yaml", grid=["scenario.sensor.R=3"]).points
    assert point.values == {"scenario.sensor.R": 3}


def test_a_filter_that_cannot_run_on_the_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(MerweMotion, "jacobian")
    (tmp_path / "a.yaml").write_text(CONFIG.replace("kind: ukf", "kind: ekf"))
    with pytest.raises(UserError) as caught:
        load(tmp_path / "a.yaml")
    what = "`ekf` works only with a motion with a Jacobian; take another filter or motion"
    assert str(caught.value) == f"{tmp_path}/a.yaml:5:45: filters.UKF: {what}"


@pytest.mark.parametrize("address", ["nonsense", "http://localhost:80", "tcp://:1", "tcp://host"])
def test_an_address_that_is_none(tmp_path: Path, address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(UserError, match="write tcp://host:port"), engine("dask", 1, address)():
        pass


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


def test_mistakes_that_hide_others_say_so(tmp_path: Path) -> None:
    """Names of metrics depend on the scenario, and are checked only if it has no mistake."""
    text = CONFIG.replace("kind: pf, N: 5", "kind: pf, N: -5") + "figures:\n"
    text += "  f: {kind: rmse-vs-time, metric: rmse_speeed}\n"
    (tmp_path / "a.yaml").write_text(text.replace("scenario: {", "scenario: {wrong: 1, "))
    with pytest.raises(UserError) as caught:
        load(tmp_path / "a.yaml")
    *mistakes, last = str(caught.value).splitlines()
    assert len(mistakes) == 2
    assert last == (
        f"{tmp_path}/a.yaml: more may follow: what depends on these keys, such as metrics, is checked "
        "when these 2 mistakes are mended"
    )
    # If the scenario has no mistake, all are shown, and no more follow.
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(UserError) as caught:
        load(tmp_path / "a.yaml")
    assert len(str(caught.value).splitlines()) == 2
    assert "more may follow" not in str(caught.value)


@pytest.mark.parametrize("name", ["my track.csv", "m.tsv", "m.NMEA"])
def test_a_table_in_place_of_a_config_names_the_command_that_reads_it(
    tmp_path: Path, name: str
) -> None:
    """It was "an experiment is a mapping of keys to values", or invalid YAML because of a tab."""
    (tmp_path / name).write_text("time\tx\ty\n0\t1\t2\n")
    with pytest.raises(
        UserError, match=r"is a file of data and no config; `trackbench new experiment"
    ):
        load(tmp_path / name)
    with pytest.raises(UserError, match="no such file"):
        load(tmp_path / f"no-{name}")


def test_a_key_of_a_filter_that_does_not_exist_names_those_that_exist(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(CONFIG)
    with pytest.raises(UserError) as caught:
        load(tmp_path / "a.yaml", ["filters.mine.q=4"])
    message = str(caught.value)
    assert "filters.mine.q: there is no filter 'mine'; known: PF, UKF; " in message
    assert "a filter is added by `--set 'filters.LABEL={kind: KIND}'` or `--filter FILE`" in message
    # Several options may add a filter.
    point = load(tmp_path / "a.yaml", ["filters.mine.N=40", "filters.mine.kind=pf"]).points[0]
    assert "mine" in point.filters


def test_an_item_beyond_a_tuned_list_has_the_number_of_items(tmp_path: Path) -> None:
    motions = "motions: [{kind: cwna, q: 1}, {kind: cwna, q: 9}], transition: [[1, 0], [0, 1]]"
    text = f"{CONFIG}tune: {{IMM: {{motions.2.q: 0.1..1}}}}\n"
    (tmp_path / "a.yaml").write_text(
        text.replace("UKF: {kind: ukf}", f"IMM: {{kind: imm, {motions}}}")
    )
    with pytest.raises(UserError, match="the list has no item 2: it has 2, numbered from 0"):
        load(tmp_path / "a.yaml")


def test_a_python_file_in_place_of_a_config_names_the_options_that_take_it(tmp_path: Path) -> None:
    (tmp_path / "aq.py").write_text("def f(x: int) -> None: ...\n")
    with pytest.raises(UserError, match=r"Python file and no config; `trackbench check --contract"):
        load(tmp_path / "aq.py")
    with pytest.raises(UserError, match=r"`--filter .*aq.py` runs them"):
        check_file(tmp_path / "aq.py", on=tmp_path / "aq.py")
