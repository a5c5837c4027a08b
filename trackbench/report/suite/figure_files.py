"""Figures of a suite: matrix, performance profiles, error over cost."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from trackbench.atomic_files import ensure_folder, write_bytes
from trackbench.report.plotting import file_formats, style
from trackbench.report.suite.matrix_figure import draw_matrix, matrix_caption
from trackbench.report.suite.profile_and_cost_figures import (
    cost_caption,
    draw_cost,
    draw_profile,
    profile_caption,
)
from trackbench.report.suite.scores import (
    FILTER,
    SuiteScores,
)


@dataclass(frozen=True, kw_only=True)
class SuiteFigure:
    """A drawn figure of a suite."""

    name: str
    caption: str
    svg: bytes


def draw_figures(
    folder: Path, groups: Sequence[SuiteScores], formats: Sequence[str]
) -> list[SuiteFigure]:
    """Draw the figures of each group into ``folder/figures``; return them as SVG with captions.

    ``formats`` are those of the files, of `file_formats.forms`. A group without any filter has no
    figures.
    """
    drawn = []
    for group in groups:
        if not group.of_role(FILTER):
            continue
        parts = (
            ("matrix", draw_matrix, matrix_caption(group)),
            ("profile", draw_profile, profile_caption(group)),
            ("cost", draw_cost, cost_caption(group)),
        )
        for kind, draw, caption in parts:
            name = f"{group.group}-{kind}"
            with style.rc_context():
                figure = draw(group)
                # The page takes the SVG in any case.
                contents = {"svg": file_formats.content(figure, "svg")}
                for form in formats:
                    if form not in contents:
                        contents[form] = file_formats.content(figure, form)
                file_formats.close(figure)
            for form in formats:
                target = ensure_folder(folder / "figures") / f"{name}.{form}"
                write_bytes(target, contents[form])
            drawn.append(SuiteFigure(name=name, caption=caption, svg=contents["svg"]))
    return drawn
