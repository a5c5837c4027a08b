"""Figures for LaTeX: as wide as a column and as a page, in letters that journals take."""

import re

import pytest
import yaml
from typer.testing import CliRunner

from tests.conftest import ROOT
from trackbench import api
from trackbench.cli.app import app
from trackbench.report.plotting import style
from trackbench.report.plotting.page_formats import (
    COLUMN,
    PAGE,
    SCREEN,
    drawing_for,
    is_crowded,
    sheet,
)
from trackbench.report.plotting.panels import make_panels


def test_each_figure_is_drawn_as_wide_as_a_column_and_as_a_page(folder):
    before = (folder / "figures" / "time.svg").read_bytes()
    answer = CliRunner().invoke(app, ["plot", str(folder), "--only", "time", "--style", "paper"])
    names = [line.rpartition("/")[2] for line in answer.stdout.split()]
    assert names == ["time-column.pdf", "time-page.pdf"]
    for name, width_in in zip(names, (3.5, 7.2), strict=True):
        content = (folder / "figures" / name).read_bytes()
        (width,) = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ", content)
        assert float(width) == pytest.approx(72 * width_in)
        assert b"/Type3" not in content
        assert b"STIX" in content
    assert (folder / "figures" / "time.svg").read_bytes() == before
    api.plot(folder, ["svg"], ["time"])  # and nothing of it stays
    assert (folder / "figures" / "time.svg").read_bytes() == before


def test_letters_of_eight_points_and_no_title(made):
    results = api.load(made).results
    with drawing_for(COLUMN), style.rc_context():
        figure = results.parts("figures")["time"].draw(results)
        figure.draw_without_rendering()
        ax = figure.axes[0]
        texts = [
            ax.xaxis.label,
            ax.yaxis.label,
            *ax.get_xticklabels(),
            *figure.legends[0].get_texts(),
        ]
        assert {text.get_fontsize() for text in texts} == {8.0}
        assert figure.get_suptitle() == ""
    assert sheet() is SCREEN


def test_more_panels_than_a_column_has_room_for_are_for_the_page():
    for page, crowded in ((COLUMN, True), (PAGE, False)):
        with drawing_for(page):
            figure, _ = style.subplots(1, 3)
            assert is_crowded(figure) is crowded
    with drawing_for(COLUMN):
        assert not is_crowded(make_panels(6, 1, 2.0)[0])


def test_the_report_has_every_figure_however_many_panels_it_has():
    with drawing_for(SCREEN):
        figure, _ = make_panels(1, 1, 2.0)
        for place in figure.add_gridspec(1, 5):
            figure.add_subplot(place)
        assert not is_crowded(figure)
    for config in sorted((ROOT / "results").glob("*/config.yaml")):
        names = yaml.safe_load(config.read_text(encoding="utf-8"))["figures"]
        folders = (config.parent, ROOT / "results" / "times" / config.parent.name)
        drawn = {path.stem for folder in folders for path in folder.glob("figures/*.svg")}
        assert drawn >= set(names), config.parent.name


def test_the_style_is_one_of_two(folder):
    answer = CliRunner().invoke(app, ["plot", str(folder), "--style", "papre"])
    assert answer.exit_code != 0
    assert not list((folder / "figures").glob("*.pdf"))
