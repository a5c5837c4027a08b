"""Several results folders together: results/index.html, and results/README.md as the ledger."""

import os
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias
from urllib.parse import quote
from xml.etree import ElementTree as ET

from trackbench.atomic_files import write_text
from trackbench.errors import Problem, UserError
from trackbench.report.findings.ranking import Ranking, rankings
from trackbench.report.html.report_page import key_picture, write_page
from trackbench.report.html.svg import clean_svg, outline
from trackbench.report.open_results import explain_content_errors, open_with_notes
from trackbench.report.tables_and_figures import Results
from trackbench.report.verdicts.comparison_files import bars, summary_lines, verdict_tables
from trackbench.report.verdicts.cpu_times import TimeVerdict, time_tables, time_verdicts
from trackbench.report.verdicts.published_numbers import Verdicts, compare

_SVG = "{http://www.w3.org/2000/svg}"
_LEAST_DISTANCE = 2.0
"""Points of a line that are nearer to each other than this, in the SVG's, are one."""
_MOST_IMAGE_BYTES = 60_000
"""Bytes of a raster image beyond which it is left out."""
_STYLE = re.compile(r"(fill|stroke|opacity|fill-opacity|stroke-dasharray)\s*:\s*([^;]+)")


def thumbnail(content: bytes) -> str:
    """Return an SVG as an element of some kilobytes, without ids, so that many may stand on a page.

    It has the lines and areas within the axes, with broad strokes and no text.
    """
    root = clean_svg(content, "a figure")
    small = ET.Element(f"{_SVG}svg", {"viewBox": root.get("viewBox", "0 0 504 252")})
    for element in _drawn(root):
        if element.tag == f"{_SVG}image":
            attributes = {}
            for key, value in element.attrib.items():
                if key.rpartition("}")[2] in _IMAGE_ATTRIBUTES:
                    attributes[key] = value
            ET.SubElement(small, element.tag, attributes)
            continue
        path = _coarse(element.get("d", ""))
        # Properties such as fill and stroke, by name.
        look = dict(_STYLE.findall(element.get("style", "")))
        is_visible = look.get("stroke", look.get("fill", "none")) != "none"
        if path and is_visible:
            attributes = {"d": path, "fill": "black"} | look
            attributes.pop("stroke-dasharray", None)
            if "stroke" in look:
                attributes["stroke-width"] = "2.5"
            ET.SubElement(small, element.tag, attributes)
    return ET.tostring(small, encoding="unicode")


_IMAGE_ATTRIBUTES = ("href", "transform", "width", "height", "x", "y", "preserveAspectRatio")


def _drawn(root: ET.Element) -> Iterator[ET.Element]:
    """Yield the paths and small images that are drawn within axes; ticks and grid lines are left out."""
    for element in root:
        # matplotlib's groups of a tick with its grid line: xtick_3.
        is_tick = re.search(r"[xy]tick_\d+$", element.get("id", ""))
        if is_tick or element.tag == f"{_SVG}defs":
            continue
        # matplotlib clips what is drawn within axes, and nothing else.
        is_shape = element.tag == f"{_SVG}path" and "clip-path" in element.attrib
        is_image = element.tag == f"{_SVG}image"
        if is_shape or (is_image and len("".join(element.attrib.values())) < _MOST_IMAGE_BYTES):
            yield element
        else:
            yield from _drawn(element)


def _coarse(path: str) -> str:
    """Return a path of straight lines, rounded to whole points, without corners that are very near."""
    parts = []
    for points, closed in outline(path):
        corners = [points[0]]
        for x, y in points[1:]:
            last_x, last_y = corners[-1]
            if max(abs(x - last_x), abs(y - last_y)) >= _LEAST_DISTANCE:
                corners.append((x, y))
        if len(corners) > 1:
            text = " ".join(f"{x:.0f},{y:.0f}" for x, y in corners)
            parts.append(f"M{text}{'z' if closed else ''}")
    return "".join(parts)


Overview: TypeAlias = list[tuple[Results, Verdicts]]
"""Experiments of a folder, each with its verdicts."""

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
    experiments, left_out = _open_experiments(folder)
    everything = _join_verdicts([comparison for _, comparison in experiments])
    index = _write_index(folder, experiments, everything)
    ledger = folder / "README.md"
    if left_out:
        missing = f"per_run.csv is missing in {left_out} of {left_out + len(experiments)} folders"
        print(f"note: {ledger} is not written again: {missing}", file=sys.stderr)
        return [index]
    write_text(ledger, _ledger(folder, experiments, everything))
    return [index, ledger]


def _write_index(folder: Path, experiments: Overview, everything: Verdicts) -> Path:
    """Write index.html; ``everything`` has the verdicts of all experiments."""
    # The verdicts on CPU times of all experiments are counted separately.
    times: list[TimeVerdict] = []
    for results, _ in experiments:
        times += time_verdicts(results)
    cards = {}
    for topic, group in _group_by_topic(experiments).items():
        cards[topic] = [_card(folder, results, comparison) for results, comparison in group]
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

    config = results.config
    report = results.folder / "report.html"
    picture = key_picture(results)
    return {
        "name": config["name"],
        "title": results.fill_title(config["title"]),
        "filters": len(results.filters),
        "runs": config["runs"],
        "result": _result(results),
        "counted": bars(comparison),
        "thumbnail": Markup(thumbnail(picture)) if picture else "",
        "link": _link(report.relative_to(folder)) if report.is_file() else "",
    }


def _link(path: Path) -> str:
    """Write a relative path as a link: a folder may be called ``javascript:x`` or ``a#b``."""
    name = path.as_posix()
    quoted = quote(name)
    if quoted == name:
        return name
    return f"./{quoted}"


_RECORDINGS = "Recordings"
_ANGLES = "Targets seen by radar, lidar or bearings"
_POSITIONS = "Targets with measured positions"
_OTHERS = "Other dynamic systems"


def _group_by_topic(experiments: Overview) -> dict[str, Overview]:
    """Group the experiments by what is estimated and measured; topics without any are left out."""
    groups: dict[str, Overview] = {}
    for topic in (_RECORDINGS, _ANGLES, _POSITIONS, _OTHERS):
        groups[topic] = []
    for results, comparison in experiments:
        groups[_topic(results)].append((results, comparison))
    return {topic: group for topic, group in groups.items() if group}


def _topic(results: Results) -> str:
    """Return the topic of an experiment: what is estimated, and by which sensors."""
    scenario = results.config["scenario"]
    if (scenario.get("target") or {}).get("kind") in ("measured", "recorded"):
        return _RECORDINGS
    # The state of a target in space begins with px and vx.
    if results.facts(results.grid_points[0]).components[:2] != ["px", "vx"]:
        return _OTHERS
    sensors = scenario.get("sensor")
    if not isinstance(sensors, list):
        sensors = [sensors or {}]
    kinds = {sensor.get("kind") for sensor in sensors}
    if kinds <= {"position", "velocity"}:
        return _POSITIONS
    return _ANGLES


def _result(results: Results) -> str:
    """Write the result in a few words; empty if the runs are missing."""
    if not results.has_runs:
        return ""
    return short_answer(rankings(results))


def short_answer(scene_rankings: Sequence[Ranking]) -> str:
    """Return the result in about five words: ``IMM best of 16 filters``; empty without a ranking."""
    # In how many scenarios each filter is among the best.
    times_best = Counter[str]()
    for ranking in scene_rankings:
        times_best.update(candidate.label for candidate in ranking.among_the_best)
    if not times_best:
        has_rivals = any(len(ranking.order) > 1 for ranking in scene_rankings)
        return "which is best is inconclusive" if has_rivals else ""
    # Of several scenarios the filter that is best most often.
    if len(scene_rankings) > 1:
        label, most = times_best.most_common()[0]
        return f"{label} best at {most} of {len(scene_rankings)}"
    ranking = scene_rankings[0]
    filters = len(ranking.order) + len(ranking.losing)
    ties = len(times_best) - 1
    if filters == 1:
        return ""
    if ties + 1 == filters:
        return f"no significant difference between {filters}"
    best = ranking.among_the_best[0].label
    if ties:
        return f"{best} and {ties} others best"
    return f"{best} best of {filters} filters"


def _join_verdicts(comparisons: list[Verdicts]) -> Verdicts:
    """Join the verdicts of several experiments, to count them together."""
    joined = Verdicts([], [], [])
    for comparison in comparisons:
        joined.rows.extend(comparison.rows)
        joined.claims.extend(comparison.claims)
        joined.ranks.extend(comparison.ranks)
        joined.left_out.extend(comparison.left_out)
    return joined


def _open_experiments(folder: Path) -> tuple[Overview, int]:
    """Open the experiments of a folder with their verdicts.

    Return also how many are left out because their runs are missing. Raises UserError for any other
    mistake, and if no experiment is left.
    """
    if not os.path.isdir(folder):
        raise UserError(f"{folder}: there is no such folder")
    candidates = sorted(path.parent for path in folder.glob("*/config.yaml"))
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
            if results and not results.has_runs:
                without_runs += error.problems
            else:
                problems += error.problems
    if problems or not opened:
        raise UserError(*problems, *without_runs)
    return opened, len(without_runs)


def _ledger(folder: Path, experiments: Overview, everything: Verdicts) -> str:
    """Write README.md: the counts, then each experiment with its verdicts, by topic."""
    counts = "\n".join(f"- {line}" for line in summary_lines(everything))
    paragraphs = [_HEAD.rstrip(), counts or "Nothing is published about these experiments."]
    for topic, group in _group_by_topic(experiments).items():
        paragraphs.append(f"## {topic}")
        for results, comparison in group:
            link = _link(results.folder.relative_to(folder))
            paragraphs.append(f"### [{results.config['name']}]({link}/): {results.title}")
            result = _result(results)
            if result:
                paragraphs.append(f"- Result: {result}")
            paragraphs += [f"- {line}" for line in summary_lines(comparison)]
            paragraphs += [table.markdown().rstrip() for table in verdict_tables(comparison)]
    return "\n\n".join(paragraphs) + "\n"
