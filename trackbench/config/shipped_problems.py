"""List of the standard problems, as `trackbench list problems` prints it: with numbers of papers."""

import csv
import re
from pathlib import Path
from typing import NamedTuple

from trackbench.config.shipped_experiments import files, listed, value_of_key

_PROBLEM = re.compile(r"^problem: \{version: (\d+)(?:, reference: (.+))?\}$", re.MULTILINE)
_PRINTED_AT = ("paper", "table", "row", "filter", "metric", "point")


class ShippedProblem(NamedTuple):
    """A shipped standard problem: what `trackbench list problems` prints."""

    name: str
    version: int
    title: str
    numbers: int
    """published numbers that it measures"""
    reference: str
    """label of the filter or bound that errors are compared with; may be empty"""
    paper: str
    cpu_s: float | None


def problems() -> list[ShippedProblem]:
    """List every standard problem, sorted by name.

    Its reference is that of the key `problem`, else the experiment's reference filter, else its bound.
    """
    shipped_problems = []
    file_by_name = files()
    for shipped in listed():
        file = file_by_name[shipped.name]
        text = file.read_text(encoding="utf-8")
        mark = _PROBLEM.search(text)
        if mark is None:
            continue
        version, reference = mark.groups()
        shipped_problems.append(
            ShippedProblem(
                name=shipped.name,
                version=int(version),
                title=shipped.title,
                numbers=_count_published_numbers(file, value_of_key("published", text)),
                reference=(
                    reference or value_of_key("reference", text) or value_of_key("bound", text)
                ),
                paper=shipped.paper,
                cpu_s=shipped.cpu_s,
            )
        )
    return shipped_problems


def _count_published_numbers(experiment: Path, published: str) -> int:
    """Count the published numbers that an experiment's file measures, each once.

    ``published`` is the YAML list of the files with the numbers.
    """
    printed_places = set()
    for path in re.findall(r"[^\[\], ]+", published):
        with (experiment.parent / path).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                experiments = (row["experiment"] or experiment.stem).split("; ")
                # A number without the label of a filter here is printed and not measured.
                is_measured = row.get("label") and experiment.stem in experiments
                # The values "biased" and "unbiased" are words, not numbers.
                if is_measured and not row["value"].endswith("biased"):
                    # Several readings of a number are rows with one place in the paper.
                    printed_places.add(tuple(row.get(key) for key in _PRINTED_AT))
    return len(printed_places)
