"""Several results folders together: results/index.html, and results/README.md as the ledger."""

import os
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import quote
from xml.etree import ElementTree as ET

from trackbench.atomic_files import write_text
from trackbench.errors import Problem, UserError
from trackbench.report.findings.ranking import Ranking, rankings
from trackbench.report.html.report_page import key_picture, write_page
from trackbench.report.html.svg import cleaned, outline
from trackbench.report.open import explain_content_errors, open_with_notes
from trackbench.report.results import Results
from trackbench.report.verdicts.cpu_times import time_tables, time_verdicts
from trackbench.report.verdicts.files import bars, summary_lines, verdict_tables
from trackbench.report.verdicts.numbers import Verdicts, compare

_SVG = "{http://www.w3.org/2000/svg}"
_APART = 2.0
"""Points of a line that are nearer to each other than this, in the SVG's, are one."""
_MOST = 60_000
"""Bytes of a raster image beyond which it is left out."""
_STYLE = re.compile(r"(fill|stroke|opacity|fill-opacity|stroke-dasharray)\s*:\s*([^;]+)")


def thumbnail(content: bytes) -> str:
    """Return the SVG as an element of some kilobytes, without ids, so that many may stand on a page."""
    root = cleaned(content, "a figure")
    small = ET.Element(f"{_SVG}svg", {"viewBox": root.get("viewBox", "0 0 504 252")})
    for element in _drawn(root):
        name = element.tag.removeprefix(_SVG)
        if name == "image":
            names = [name for name in element.attrib if name.rpartition("}")[2] in _OF_IMAGE]
            ET.SubElement(small, element.tag, {name: element.attrib[name] for name in names})
            continue
        d = _coarse(element.get("d", ""))
        look = dict(_STYLE.findall(element.get("style", "")))
        if d and look.get("stroke", look.get("fill", "none")) != "none":
            wide = {"stroke-width": "2.5"} if "stroke" in look else {}
            look.pop("stroke-dasharray", None)
            ET.SubElement(small, element.tag, {"d": d, "fill": "black"} | look | wide)
    return ET.tostring(small, encoding="unicode")


_OF_IMAGE = ("href", "transform", "width", "height", "x", "y", "preserveAspectRatio")


def _drawn(root: ET.Element) -> Iterator[ET.Element]:
    """Yield paths and images in the data area of axes, without grid lines."""
    for element in root:
        if re.search(r"[xy]tick_\d+$", element.get("id", "")) or element.tag == f"{_SVG}defs":
            continue
        name = element.tag.removeprefix(_SVG)
        shape = name == "path" and "clip-path" in element.attrib
        if shape or (name == "image" and len("".join(element.attrib.values())) < _MOST):
            yield element
        else:
            yield from _drawn(element)


def _coarse(d: str) -> str:
    """Round a path of straight lines to whole points, without those that are hardly apart."""
    parts = []
    for points, closed in outline(d):
        corners = [points[0]]
        for point in points[1:]:
            if max(abs(point[0] - corners[-1][0]), abs(point[1] - corners[-1][1])) >= _APART:
                corners.append(point)
        if len(corners) > 1:
            text = " ".join(f"{x:.0f},{y:.0f}" for x, y in corners)
            parts.append(f"M{text}{'z' if closed else ''}")
    return "".join(parts)


Overview: TypeAlias = list[tuple[Results, Verdicts]]

_HEAD = """# Published and measured

Every number, word and claim of the papers that an experiment here measures, with its verdict. Of a
number only `agrees` says that it reproduces; `compatible` is an error too wide to show it. Written by
`trackbench report results`; `make check-results` fails if a verdict is not reproduced.
"""


def write_overview(folder: Path) -> list[Path]:
    """Write index.html and README.md about the results folders in ``folder``; return what was written.

    If folders lack the runs that their verdicts need, as in a git clone, index.html leaves them out and
    README.md stays.
    """
    experiments, left_out = _opened(folder)
    everything = _together([comparison for _, comparison in experiments])
    index = _write_index(folder, experiments, everything)
    ledger = folder / "README.md"
    if left_out:
        missing = f"per_run.csv is missing in {left_out} of {left_out + len(experiments)} folders"
        print(f"note: {ledger} is not written again: {missing}", file=sys.stderr)
        return [index]
    write_text(ledger, _ledger(folder, experiments, everything))
    return [index, ledger]


def _write_index(folder: Path, experiments: Overview, everything: Verdicts) -> Path:
    # The verdicts on CPU times of all experiments are counted separately.
    times = chain.from_iterable(time_verdicts(results) for results, _ in experiments)
    cards = {}
    for topic, group in _by_topic(experiments).items():
        cards[topic] = [_card(folder, *item) for item in group]
    return write_page(
        folder / "index.html",
        "index.html",
        live=False,
        title="Experiments and what they say of the papers",
        topics=cards,
        counted=bars(everything),
        verdict_lines=summary_lines(everything),
        ledger=[*verdict_tables(everything), *time_tables(times)],
    )


def _card(folder: Path, results: Results, comparison: Verdicts) -> dict[str, Any]:
    """Describe an experiment for the index; its link is empty if it has no report."""
    from markupsafe import Markup

    config, report = results.config, results.folder / "report.html"
    picture = key_picture(results)
    return {
        **{"name": config["name"], "title": results.fill_title(config["title"])},
        **{"filters": len(results.filters), "runs": config["runs"], "result": _result(results)},
        "counted": bars(comparison),
        "thumbnail": Markup(thumbnail(picture)) if picture else "",
        "link": _link(report.relative_to(folder)) if report.is_file() else "",
    }


def _link(path: Path) -> str:
    """Write a relative path as a link: a folder may be called ``javascript:x`` or ``a#b``."""
    name = path.as_posix()
    quoted = quote(name)
    return name if quoted == name else f"./{quoted}"


_RECORDINGS, _ANGLES = "Recordings", "Targets seen by radar, lidar or bearings"
_POSITIONS, _OTHERS = "Targets with measured positions", "Other dynamic systems"


def _by_topic(experiments: Overview) -> dict[str, Overview]:
    """Group the experiments by what is estimated and measured; topics without any are left out."""
    groups: dict[str, Overview] = {t: [] for t in (_RECORDINGS, _ANGLES, _POSITIONS, _OTHERS)}
    for item in experiments:
        groups[_topic(item[0])].append(item)
    return {topic: group for topic, group in groups.items() if group}


def _topic(results: Results) -> str:
    scenario = results.config["scenario"]
    sensors = scenario.get("sensor")
    sensors = sensors if isinstance(sensors, list) else [sensors or {}]
    if (scenario.get("target") or {}).get("kind") in ("measured", "recorded"):
        return _RECORDINGS
    if results.facts(results.grid_points[0]).components[:2] != ["px", "vx"]:
        return _OTHERS
    measured = {sensor.get("kind") for sensor in sensors}
    return _POSITIONS if measured <= {"position", "velocity"} else _ANGLES


def _result(results: Results) -> str:
    """Write the result in a few words; nothing if the runs are missing."""
    return short_answer(rankings(results)) if _has_runs(results) else ""


def _has_runs(results: Results) -> bool:
    return (results.folder / "per_run.csv").is_file()


def short_answer(standings: Sequence[Ranking]) -> str:
    """Return the result in about five words: ``IMM best of 16 filters``; empty without a ranking."""
    best = chain.from_iterable(ranking.among_the_best for ranking in standings)
    leaders = Counter(candidate.label for candidate in best)
    if not leaders:
        return "which is best is inconclusive" if any(s.order[1:] for s in standings) else ""
    (label, most), *others = leaders.most_common()
    if len(standings) > 1:
        return f"{label} best at {most} of {len(standings)}"
    filters = len(standings[0].order) + len(standings[0].losing)
    if filters == 1:
        return ""
    if len(others) + 1 == filters:
        return f"no significant difference between {filters}"
    first = standings[0].among_the_best[0].label
    rest = f"and {len(others)} others best" if others else f"best of {filters} filters"
    return f"{first} {rest}"


def _together(comparisons: list[Verdicts]) -> Verdicts:
    """Join the verdicts of several experiments, to count them together."""
    whole = Verdicts([], [], [])
    for c in comparisons:
        for name, rows in vars(whole).items():
            rows += getattr(c, name)
    return whole


def _opened(folder: Path) -> tuple[Overview, int]:
    """Open the experiments; count those that are left out because their runs are missing."""
    if not os.path.isdir(folder):
        raise UserError(f"{folder}: there is no such folder")
    candidates = sorted(p.parent for p in folder.glob("*/config.yaml"))
    if not candidates:
        raise UserError(f"{folder}: has neither a config.yaml nor results folders in it")
    opened: Overview = []
    problems: list[Problem | str] = []
    without_runs: list[Problem | str] = []
    for candidate in candidates:
        results = None
        try:
            with explain_content_errors(candidate):
                results = open_with_notes(candidate)
                opened.append((results, compare(results)))
        except UserError as error:
            lines = without_runs if results and not _has_runs(results) else problems
            lines += error.problems
    if problems or not opened:
        raise UserError(*problems, *without_runs)
    return opened, len(without_runs)


def _ledger(folder: Path, experiments: Overview, everything: Verdicts) -> str:
    lines = [f"- {line}" for line in summary_lines(everything)]
    parts = [_HEAD.rstrip(), "\n".join(lines) or "Nothing is published about these experiments."]
    for topic, group in _by_topic(experiments).items():
        parts.append(f"## {topic}")
        for results, comparison in group:
            link = _link(results.folder.relative_to(folder))
            parts.append(f"### [{results.config['name']}]({link}/): {results.title}")
            result = _result(results)
            lines = [*([f"Result: {result}"] if result else []), *summary_lines(comparison)]
            parts += [f"- {line}" for line in lines]
            parts += [table.markdown().rstrip() for table in verdict_tables(comparison)]
    return "\n\n".join(parts) + "\n"
