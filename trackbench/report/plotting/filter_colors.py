"""Usual color and dash of each filter in the figures of an experiment."""

from collections.abc import Mapping, Sequence
from typing import Any

from trackbench.report.plotting import style


def usual_looks(
    config: Mapping[str, Any], figure_configs: Mapping[str, Any], exact: Sequence[str]
) -> dict[str, dict[str, Any]]:
    """Return color and dash of each label of the config, also of filters that this run leaves out.

    The reference, the bound, exact errors and the floor of any figure are black, a baseline is gray.
    Other labels have colors, which differ as far as possible where a figure draws them together.

    ``config`` is the resolved config, ``figure_configs`` its figures by name, and ``exact`` the labels
    of exact errors.
    """
    black: list[str] = []
    gray: list[str] = []
    for figure in figure_configs.values():
        for key, labels in (("floor", black), ("baseline", gray)):
            if isinstance(figure.get(key), str):
                labels.append(figure[key])
    black += [label for label in (config.get("reference"), config.get("bound")) if label]
    black += exact
    looks = dict.fromkeys(gray, style.BASELINE)
    for number, label in enumerate(dict.fromkeys(black)):
        looks[label] = style.reference_line(number)
    others = [label for label in config["filters"] if label not in looks]
    drawn_together: list[list[str]] = []  # a list for each figure
    for figure in figure_configs.values():
        wanted = figure.get("filters") or others
        drawn_together.append([label for label in others if label in wanted])
    for label, number in style.number_lines(others, drawn_together).items():
        looks[label] = style.line(number)
    return looks
