"""What Python shows of results, in a notebook and at a prompt, and what it takes for a config."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

import trackbench
from tests.papers import merwe_text
from trackbench import progress_bar as bars
from trackbench.config.python_config import from_mapping
from trackbench.progress_bar import progress_bar
from trackbench.report.markdown_table import Text, TextTable
from trackbench.report.notebook_html import table_html
from trackbench.yaml_source import parse

CONFIG: dict[str, Any] = {
    "name": "noted",
    "title": "Noted & <shown>, {runs} runs",
    "runs": 4,
    "block": 2,
    "scenario": parse(merwe_text(T=5), "").data,
    "filters": {"PF": {"kind": "pf", "N": 5}, "UKF": {"kind": "ukf"}},
    "tables": {"t": {"kind": "metrics", "title": "Of <all>", "columns": {"E": "rms(rmse)"}}},
    "figures": {
        "first": {"kind": "rmse-vs-time", "title": "Over $time"},
        "second": {"kind": "bars"},
    },
}
QUIET = trackbench.Options(workers=1, quiet=True, formats=())


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> trackbench.Report:
    return trackbench.run(CONFIG, QUIET, out=tmp_path_factory.mktemp("noted") / "out")


def test_a_mapping_is_a_config(report: trackbench.Report, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(CONFIG))
    read = trackbench.run(tmp_path / "c.yaml", QUIET, out=tmp_path / "read")
    for name in ("per_run.csv", "summary.csv", "config.yaml"):
        assert (report.folder / name).read_bytes() == (read.folder / name).read_bytes()


def test_a_mapping_is_left_as_it_was(tmp_path: Path) -> None:
    config = {**CONFIG, "filters": {"UKF": {"kind": "ukf"}}}
    swept = trackbench.sweep(
        *(config, QUIET), set=["runs=2"], grid=["filters.UKF.Q=1,2"], out=tmp_path / "s"
    )
    assert "grid" not in config
    assert config["filters"] == {"UKF": {"kind": "ukf"}}
    (best,) = swept.best
    assert best.filter == "UKF"
    points = [best.point, *best.ties, best.next]
    assert {value for point in points for value in point.values()} == {1, 2}


def test_numbers_of_numpy_paths_and_tuples_are_plain() -> None:
    given = {"a": np.float64(1e-5), "b": np.arange(3), "c": (Path("x.csv"), True, None), "d": "1e5"}
    assert from_mapping(given).data == {
        "a": 1e-5,
        "b": [0, 1, 2],
        "c": ["x.csv", True, None],
        "d": "1e5",
    }


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"runz": 3}, "config: runz: unknown key; did you mean runs?"),
        ({"filters": {"E": {"kind": "eckf"}}}, "config: filters.E.kind: 'eckf' is not a kind"),
        ({"runs": {1, 2}}, "config: runs: is of the type set; a config holds words, numbers,"),
        ({"title": "a\0b"}, "config: title: 'a\\x00b' holds the character U+0000"),
        ({"filters": {1: {"kind": "ekf"}}}, "config: filters: a key must be a word"),
        ({"seed": object}, "config: seed: is of the type type"),
    ],
)
def test_mistakes_in_a_mapping(change: dict[str, Any], expected: str) -> None:
    with pytest.raises(trackbench.UserError) as caught:
        trackbench.run({**CONFIG, **change}, QUIET)
    assert expected in str(caught.value)
    assert "\n".join(caught.value._render_traceback_()) == str(caught.value)


def test_one_that_holds_itself() -> None:
    config = dict(CONFIG)
    config["scenario"] = config
    with pytest.raises(trackbench.UserError, match="nested more than 50 levels deep"):
        trackbench.run(config, QUIET)


def test_a_report_is_a_line_at_a_prompt(report: trackbench.Report) -> None:
    what = "Noted & <shown>, 4 runs; 2 filters, 4 runs"
    assert repr(report) == f"<Report in {report.folder}: {what}>"
    assert repr(trackbench.load(report.folder)) == repr(report)
    assert repr(report.tables["t"]) == "<Table 'Of <all>': 2 rows>"
    assert repr(report.comparison) == "<Verdicts on 0 numbers and 0 claims>"


def test_a_report_is_a_page_in_a_notebook(report: trackbench.Report) -> None:
    loaded = trackbench.load(report.folder)
    for shown in (report, loaded):
        html = shown._repr_html_()
        assert "Noted &amp; &lt;shown&gt;, 4 runs" in html
        assert "Of &lt;all&gt;" in html
        assert 'src="data:image/png;base64,iVBOR' in html
        assert "<script" not in html
        assert shown._repr_png_().startswith(b"\x89PNG")
    cell = report.tables["t"].texts().rows[0][1].text
    assert cell in report._repr_html_()
    assert cell in report.tables["t"]._repr_html_()


def test_run_and_load_return_one_class_with_public_completions(report: trackbench.Report) -> None:
    loaded = trackbench.load(report.folder)
    assert type(loaded) is type(report) is trackbench.Report
    assert dir(loaded) == dir(report)
    assert not [name for name in dir(report) if name.startswith("_") or name == "results"]
    for name in dir(report):
        assert getattr(loaded, name) is not None
    for name in ("answer", "notes", "failed", "best", "config"):
        assert getattr(loaded, name) == getattr(report, name)
    assert loaded.tables["t"].csv_rows() == report.tables["t"].csv_rows()


def test_a_long_table_is_cut() -> None:
    table = TextTable("", ["n"], [[Text(str(n), n)] for n in range(100)], ["a note"])
    html = table_html(table)
    assert html.count("<tr>") == 61
    assert "and 40 more rows" in html
    assert "a note" in html


def test_a_table_is_a_data_frame(report: trackbench.Report) -> None:
    frame = report.tables["t"].frame
    assert list(frame) == ["Filter", "E", "E stderr", "lost"]
    stored = pd.read_csv(report.folder / "tables" / "t.csv")
    pd.testing.assert_frame_equal(frame, stored, check_exact=False, rtol=1e-12)


def test_a_figure_to_go_on_with(report: trackbench.Report) -> None:
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    figure = report.figure("second")
    assert dict(mpl.rcParams) == before
    assert report.figure().axes[0].get_yscale() == report.figure("first").axes[0].get_yscale()
    figure.axes[0].set_title("mine")
    picture, size = figure._repr_png_()
    assert picture.startswith(b"\x89PNG")
    assert size == {"width": round(100 * figure.get_figwidth())}
    assert "matplotlib.pyplot" not in sys.modules or not _open_figures()
    with pytest.raises(trackbench.UserError, match="did you mean second"):
        report.figure("secon")


def _open_figures() -> list[int]:
    from matplotlib import pyplot as plt

    return plt.get_fignums()


def test_completion_finds_what_there_is() -> None:
    names = ("run", "load", "sweep", "tune", "compare", "plot", "UserError", "Options", "Report")
    script = (
        "import sys, trackbench; print(*dir(trackbench)); print(*sys.modules);"
        "assert all(hasattr(trackbench, n) for n in dir(trackbench))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    offered, imported = (line.split() for line in done.stdout.splitlines())
    assert {*names} <= {*offered}
    assert not {"numpy", "pandas", "matplotlib", "yaml"} & {*imported}


def test_off_a_terminal_progress_is_a_line_each_tenth(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for seconds, lines in ((0.0, 10), (60.0, 0)):
        monkeypatch.setattr(bars, "_LONG_S", seconds)
        with progress_bar(40, "block", True, desc="x") as bar:
            for _ in range(40):
                bar.update(1)
        said = capsys.readouterr().err.splitlines()
        assert [line.partition(",")[0] for line in said] == [
            f"x: {4 * i} of 40 blocks" for i in range(1, lines + 1)
        ]


def test_a_notebook_has_a_bar_where_there_is_no_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class IPython:
        get_ipython = staticmethod(object)

    progress_bar(3, "block", True).update(3)
    assert capsys.readouterr().err == ""
    monkeypatch.setitem(sys.modules, "ipykernel", IPython)
    monkeypatch.setitem(sys.modules, "IPython", IPython)
    with progress_bar(3, "block", True) as bar:
        bar.update(3)
    assert "3/3" in capsys.readouterr().err
    progress_bar(3, "block", False).update(3)
    assert capsys.readouterr().err == ""
