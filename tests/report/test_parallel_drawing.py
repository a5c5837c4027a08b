"""Figures drawn by other processes: the same files, whoever draws them."""

import os
import signal
from dataclasses import dataclass
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

import pytest

from trackbench import api
from trackbench.report.drawing_pool import drawing_pool
from trackbench.report.figure_drawing import draw_figure
from trackbench.report.kinds import FigureKind
from trackbench.report.output_errors import OutputError
from trackbench.report.plotting import style
from trackbench.report.tables_and_figures import Results


@dataclass(frozen=True, kw_only=True)
class Deadly(FigureKind):
    """Kills whoever draws it elsewhere than here."""

    def draw(self, results: Results) -> Any:
        if parent_process() is not None:
            os.kill(os.getpid(), signal.SIGKILL)
        return style.subplots()[0]


@dataclass(frozen=True, kw_only=True)
class Failing(FigureKind):
    def draw(self, results: Results) -> Any:
        raise ValueError(f"drawn by {parent_process() and 'a child'}")


@pytest.fixture(scope="module")
def results(made: Path) -> Results:
    return api.load(made).results


def test_files_are_the_same_whoever_draws(results: Results) -> None:
    figures = dict(reversed(results.parts("figures").items()))
    with drawing_pool(results, ["svg"], processes=2) as draw:
        elsewhere = {name: draw(name, spec) for name, spec in figures.items()}
    assert elsewhere == {
        name: draw_figure(spec, results, ["svg"]) for name, spec in figures.items()
    }
    for name, [(form, content)] in elsewhere.items():
        assert content == (results.folder / "figures" / f"{name}.{form}").read_bytes()


def test_what_another_process_dies_of_is_drawn_here(results: Results) -> None:
    with (
        pytest.MonkeyPatch.context() as patch,
        drawing_pool(_with(patch, results, deadly=Deadly()), ["svg"], processes=2) as draw,
    ):
        assert [form for form, _ in draw("deadly", Deadly())] == ["svg"]


def test_a_mistake_of_another_process_is_said(results: Results) -> None:
    with (
        pytest.MonkeyPatch.context() as patch,
        drawing_pool(_with(patch, results, bad=Failing()), ["svg"], processes=2) as draw,
        pytest.raises(
            OutputError, match=r"^test_parallel_drawing\.py:\d+: ValueError: drawn by a child"
        ),
    ):
        draw("bad", Failing())


def _with(patch: pytest.MonkeyPatch, results: Results, **figures: FigureKind) -> Results:
    patch.setattr(Results, "parts", lambda self, group: figures)
    return results
