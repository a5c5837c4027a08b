"""Figures as files: the layout is found once, and is matplotlib's own."""

import io
from collections.abc import Iterator
from typing import Any

import pytest

from trackbench.report.plotting import file_formats, style
from trackbench.report.plotting.file_formats import FORMATS, matplotlib_file
from trackbench.report.plotting.legend import legend_outside
from trackbench.report.plotting.panels import set_title
from trackbench.report.plotting.raised_digits_formatter import raise_digits_of_ticks


def figure() -> Any:
    drawn, axes = style.subplots(2, 2)
    for i, ax in enumerate(axes.flat):
        ax.plot([1.0, 20.0, 300.0], [1e-3, 1.0, 1e3], label=f"line {i}")
        ax.set_yscale("log")
        ax.set_ylabel("RMSE (m)")
    axes[0, 0].set_title("costs $5, no formula: $x^$")
    axes[1, 1].set_aspect(0.2)
    legend_outside(drawn)
    set_title(drawn, "A title")
    return drawn


@pytest.fixture(scope="module", autouse=True)
def _house() -> Iterator[None]:
    with style.rc_context():
        yield


@pytest.fixture(scope="module")
def svg(_house: None) -> bytes:
    return matplotlib_file(figure(), "svg")


def test_the_svg_is_what_matplotlib_saves(svg: bytes) -> None:
    by_itself, out = figure(), io.BytesIO()
    for text in by_itself.findobj(lambda artist: "$5" in getattr(artist, "get_text", str)()):
        text.set_parse_math(False)
    raise_digits_of_ticks(by_itself)
    by_itself.savefig(out, format="svg", metadata=FORMATS["svg"], dpi=150)
    assert out.getvalue() == svg


@pytest.mark.parametrize("before", ["png", "pdf"])
def test_the_svg_does_not_hang_on_what_was_saved_before(before: str, svg: bytes) -> None:
    drawn = figure()
    matplotlib_file(drawn, before)
    assert matplotlib_file(drawn, "svg") == svg
    file_formats.close(drawn)


def test_equal_figures_are_equal_files() -> None:
    assert matplotlib_file(figure(), "png") == matplotlib_file(figure(), "png")
