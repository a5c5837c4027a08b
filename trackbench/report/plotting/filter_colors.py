"""Color and dash of each filter in the figures of an experiment; black and gray of references."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from trackbench.report.plotting.style import LineStyle

# Okabe & Ito 2008. Brown and indigo stand for its yellow, which disappears on paper, and its black.
# Olive and wine are from Tol's muted scheme (2021).
COLORS = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#E69F00",
    "#6F4E37",
    "#332288",
    "#999933",
    "#882255",
)
"""Colors of filters. References and bounds are black or gray, filters never are."""
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (9, 1.5)),
    (0, (2.5, 2.5)),
    (0, (6, 1.2, 1.2, 1.2, 1.2, 1.2)),
    (0, (9, 1.5, 3, 1.5)),
)
FLOOR: LineStyle = {"color": "black", "linestyle": (0, (6, 2)), "linewidth": 1.0}
BASELINE: LineStyle = {"color": "#777777", "linestyle": (0, (1, 1.6)), "linewidth": 1.4}
_REFERENCE_DASHES: tuple[Any, ...] = (
    (0, (6, 2)),
    (0, (1.5, 1.5)),
    (0, (8, 1.5, 1.5, 1.5)),
    (0, (3, 3)),
    (0, (8, 1.5, 1.5, 1.5, 1.5, 1.5)),
)
"""Dashes of black lines, of which `FLOOR` has the first."""


def usual_looks(
    config: Mapping[str, Any], figure_configs: Mapping[str, Any], exact: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Return color and dash of each label of the config, also of filters that this run leaves out.

    The reference, the bound, exact errors and the floor of any figure are black, a baseline is gray.
    Other labels have colors, which differ as far as possible where a figure draws them together.

    Parameters
    ----------
    config
        resolved config
    figure_configs
        its figures by name
    exact
        labels of exact errors, such as ``KF, exact``

    Returns
    -------
    dict
        keyword arguments of matplotlib's ``plot``, by label
    """
    black: list[str] = []
    gray: list[str] = []
    for figure in figure_configs.values():
        for key, labels in (("floor", black), ("baseline", gray)):
            if isinstance(figure.get(key), str):
                labels.append(figure[key])
    black += [label for label in (config.get("reference"), config.get("bound")) if label]
    black += exact
    looks = dict.fromkeys(gray, BASELINE)
    for number, label in enumerate(dict.fromkeys(black)):
        looks[label] = reference_line(number)
    others = [label for label in config["filters"] if label not in looks]
    drawn_together: list[list[str]] = []  # a list for each figure
    for figure in figure_configs.values():
        wanted = figure.get("filters") or others
        drawn_together.append([label for label in others if label in wanted])
    for label, number in number_lines(others, drawn_together).items():
        looks[label] = line(number)
    return looks


def line(index: int) -> LineStyle:
    """Return the color and dash of a number.

    The first 10 numbers have different colors. The first 80 differ in color or dash.

    Parameters
    ----------
    index
        number, from 0

    Returns
    -------
    LineStyle
        ``color`` and ``linestyle``
    """
    color = COLORS[index % len(COLORS)]
    # The 8 dashes take turns, with one more turn in each round of the 10 colors. Without it the looks
    # would repeat after 40 numbers.
    dash = DASHES[(index + index // len(COLORS)) % len(DASHES)]
    return {"color": color, "linestyle": dash}


def reference_line(index: int) -> LineStyle:
    """Return the look of the reference or bound at ``index`` among those of an experiment."""
    return FLOOR | {"linestyle": _REFERENCE_DASHES[index % len(_REFERENCE_DASHES)]}


def number_lines(labels: Sequence[str], figures: Iterable[Collection[str]]) -> dict[str, int]:
    """Return a number of each label, so that a label has one color in every figure.

    The function `line` maps a number to a color and dash.

    Parameters
    ----------
    labels
        all labels that need a color, in their order
    figures
        labels of each figure

    Returns
    -------
    dict
        number of each label. Two labels of one figure have different colors if this is possible. It is
        not if the figure has more labels than there are colors. Nor is it if, when a label gets its
        number, every color is already that of some label beside it in a figure
    """
    # Figures with enough colors for their labels.
    small_figures = [figure for figure in figures if len(figure) <= len(COLORS)]
    numbers: dict[str, int] = {}
    for index, label in enumerate(labels):
        # Colors of labels so far that some figure draws beside this one.
        taken_colors = set()
        for figure in small_figures:
            if label in figure:
                taken_colors |= {
                    numbers[other] % len(COLORS) for other in figure if other in numbers
                }
        # One number of each color, from the label's own index on; the first with a free color.
        candidates = range(index, index + len(COLORS))
        free = [number for number in candidates if number % len(COLORS) not in taken_colors]
        numbers[label] = next(iter(free), index)
    return numbers


def looks_in_figure(
    usual_looks: Mapping[str, LineStyle], floor: str | None, baseline: str | None
) -> dict[str, LineStyle]:
    """Return the looks of the labels of one figure, whose floor is black and whose baseline is gray.

    Parameters
    ----------
    usual_looks
        looks that the labels have in other figures, by label
    floor, baseline
        labels, None if there are none

    Returns
    -------
    dict
        looks by label. No two filters have the same color, as `distinct_looks` has it
    """
    looks = {**usual_looks}
    for label, reference_look in ((baseline, BASELINE), (floor, FLOOR)):
        # One that is black or gray in all figures keeps its own dash.
        if label in looks and looks[label]["color"] != reference_look["color"]:
            looks[label] = reference_look
    return distinct_looks(looks)


def distinct_looks(usual_looks: Mapping[str, LineStyle]) -> dict[str, LineStyle]:
    """Return the looks of one figure's labels, in which no two filters have the same color.

    A label keeps its usual look unless a label before it has this color. If there are more filters than
    colors, two filters of one color have different dashes. Black and gray looks stay as they are.

    Parameters
    ----------
    usual_looks
        looks that the labels have in other figures, by label

    Returns
    -------
    dict
        looks by label, in the given order
    """
    looks: dict[str, LineStyle] = {}
    colors: set[str] = set()
    waiting: list[str] = []
    # Step 1: usual looks; the first label of a color keeps it.
    for label, look in usual_looks.items():
        color = look["color"]
        if color in COLORS and color in colors:
            waiting.append(label)
        else:
            looks[label] = look
            colors.add(color)
    # Step 2: the other labels have a new color, else a color with another dash.
    all_looks = [line(number) for number in range(len(COLORS) * len(DASHES))]
    for label in waiting:
        new_colors = [look for look in all_looks if look["color"] not in colors]
        new_looks = [look for look in all_looks if look not in looks.values()]
        look = [*new_colors, *new_looks, usual_looks[label]][0]
        looks[label] = look
        colors.add(look["color"])
    return {label: looks[label] for label in usual_looks}
