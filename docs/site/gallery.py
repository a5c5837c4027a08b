"""The gallery: each shipped experiment with its picture, its verdicts and its config."""

import csv
import html
import re
from collections.abc import Iterator
from functools import cache
from itertools import groupby, takewhile
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from docs.site import findings, thumbnails
from docs.site.pages import ROOT
from trackbench.config import shipped_experiments, shipped_problems
from trackbench.errors import counted

TOPICS = {
    "Maneuvers": (
        "radar-turns",
        "air-traffic",
        "turning",
        "coordinated",
        "cv-ca",
        "maneuver",
        "adaptive-kf",
        "lidar",
    ),
    "Radar, range and bearings": (
        "bearings",
        "moving-observer",
        "falling-body",
        "reentry",
        "banana",
    ),
    "Recordings": ("ais", "uav-radar", "car-track", "pendulum", "nile"),
    "Nonlinear states and particle filters": (
        "merwe",
        "hdepf",
        "ungm",
        "random-sine",
        "stochastic",
    ),
    "Data assimilation": ("lorenz", "double-pendulum"),
    "Bad and late measurements": ("fault", "late"),
    "Calibration and wrong models": ("calibration", "kalmannet"),
}
"""Headings of the gallery, each with the beginnings of its experiments' names."""
OTHER = "More"


class Experiment(NamedTuple):
    """A shipped experiment, and what its results folder holds."""

    name: str
    title: str
    paper: str
    cpu_s: float | None
    folder: Path
    config: dict[str, Any]

    @property
    def folders(self) -> tuple[Path, Path]:
        """The recorded CPU times, and the results."""
        return ROOT / "results" / "times" / self.name, self.folder

    @property
    def figures(self) -> list[Path]:
        """Its figures, in the config's order, the key figure first."""
        asked = [*(self.config.get("figures") or {}), "default"]
        key = self.config.get("key_figure")
        names = sorted(asked, key=lambda name: name != key) if key else asked
        found = {p.stem: p for folder in self.folders for p in folder.glob("figures/*.svg")}
        return [found.pop(name) for name in names if name in found] + sorted(found.values())

    @property
    def about(self) -> str:
        """Return what it is: the comment at the top of its config."""
        lines = _text(self.name).splitlines()
        return " ".join(x.lstrip("# ") for x in takewhile(lambda x: x.startswith("#"), lines))

    @property
    def grid_rows(self) -> Iterator[tuple[str, ...]]:
        """Yield the values of the grid in summary.csv, row by row."""
        with (self.folder / "summary.csv").open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                yield tuple(row[path] for path in self.config["grid"])

    @property
    def comparison(self) -> str:
        """Return the tables of published and measured numbers and claims, as Markdown."""
        path = self.folder / "comparison.md"
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        return text[text.find("**") :].strip()

    @property
    def verdict(self) -> list[str]:
        """How many published numbers and claims reproduce, in lines; none if nothing is published."""
        path = self.folder / "comparison.md"
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        return [line.removeprefix("- ") for line in lines if line.startswith("- ")]

    @property
    def table(self) -> str:
        """Its first table, as Markdown."""
        for name in self.config.get("tables") or ["default"]:
            for folder in self.folders:
                path = folder / "tables" / f"{name}.md"
                if path.is_file():
                    return path.read_text(encoding="utf-8")
        return ""


@cache
def experiments() -> list[Experiment]:
    """Every shipped experiment that has results, by topic, in the order of the topics' names."""
    found = []
    for one in shipped_experiments.listed():
        folder = ROOT / "results" / one.name
        if (folder / "config.yaml").is_file():
            text = (folder / "config.yaml").read_text(encoding="utf-8")
            config = yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
            found.append(Experiment(*one, folder, config))
    return sorted(found, key=lambda e: (*_place(e.name), e.name))


def _place(name: str) -> tuple[int, int]:
    """Return the numbers of an experiment's topic and of its beginning there."""
    for i, starts in enumerate(TOPICS.values()):
        for k, start in enumerate(starts):
            if name.startswith(start):
                return i, k
    return len(TOPICS), 0


def pages() -> dict[str, str]:
    """Every page by its place on the site."""
    found = experiments()
    return {"gallery/index.md": _index(found)} | {f"gallery/{e.name}.md": _page(e) for e in found}


def files() -> dict[str, Path]:
    """Pictures and reports, by their places on the site."""
    found: dict[str, Path] = {}
    for e in experiments():
        found |= {f"gallery/{e.name}/{path.name}": path for path in e.figures}
        if (e.folder / "report.html").is_file():
            found[f"gallery/{e.name}/report.html"] = e.folder / "report.html"
    return found


def pictures() -> dict[str, str]:
    """Return the pictures of the cards, by their places on the site."""
    return {
        f"gallery/{e.name}/thumbnail.svg": thumbnails.panel(e.figures[0])
        for e in experiments()
        if e.figures
    }


def _index(found: list[Experiment]) -> str:
    parts = [
        "# Gallery",
        "Every experiment that comes with the package, with its results as `make reproduce` "
        "wrote them. Each runs by its name, from any folder.",
    ]
    for place, several in groupby(found, key=lambda e: _place(e.name)[0]):
        parts.append(f"## {[*TOPICS, OTHER][place]}")
        cards = "\n".join(map(card, several))
        parts.append(f'<div class="gallery" markdown="0">\n{cards}\n</div>')
    return "\n\n".join(parts) + "\n"


def card(e: Experiment, folder: str = "") -> str:
    """Return an experiment's picture, title and verdicts as a link to its page."""
    picture = "tables only"
    if e.figures:
        picture = f'<img loading="lazy" alt="" src="{folder}{e.name}/thumbnail.svg">'
    verdict = "<br>".join(map(html.escape, e.verdict))
    return (
        f'<a class="card" href="{folder}{e.name}.html"><span class="frame">{picture}</span>'
        f"<strong>{e.name}</strong><span>{html.escape(e.title)}</span><small>{verdict}</small></a>"
    )


def _page(e: Experiment) -> str:
    return "\n\n".join(_parts(e)) + "\n"


def _parts(e: Experiment) -> Iterator[str]:
    yield f"# {e.name}"
    yield f"{e.title}."
    if e.name in _versions():
        runs = counted(e.config["runs"], "run")
        yield f'Cite as "trackbench/{e.name} v{_versions()[e.name]}, {runs}".'
    yield re.sub(r"docs/(findings/[\w-]+\.md)", r"[the findings](../\1)", e.about)
    yield " ".join([*([f"{e.paper}."] if e.paper else []), findings.link(e.name)])
    yield "\n".join(f"- {line}" for line in e.verdict)
    for path in e.figures[:1]:
        yield _picture(e, path)
    yield e.table
    takes = f" takes {_time(e.cpu_s)} of one processor" if e.cpu_s else " runs it"
    yield f"```sh\ntrackbench run {e.name}\n```"
    report = f"`results/{e.name}/report.html`"
    if (e.folder / "report.html").is_file():
        report = f"[the report]({e.name}/report.html)"
    yield f"That{takes}; `--quick` a fraction. It writes all tables, figures and verdicts to {report}."
    for path in e.figures[1:]:
        yield _picture(e, path)
    if e.comparison:
        yield "## Published and measured"
        yield e.comparison
    yield "## Config"
    yield f"`trackbench copy {e.name}` puts it and its parts into the working folder."
    yield f"```yaml\n{_text(e.name).rstrip()}\n```"


@cache
def _versions() -> dict[str, int]:
    """Return the standard problems' versions."""
    return {problem.name: problem.version for problem in shipped_problems.problems()}


def _text(name: str) -> str:
    return shipped_experiments.find_shipped(name).read_text(encoding="utf-8")


def _picture(e: Experiment, path: Path) -> str:
    figure = (e.config.get("figures") or {}).get(path.stem, {})
    title = str(figure.get("title") or path.stem)
    if figure.get("kind") == "tuning" and not figure.get("title"):
        title = f"Tuning of {figure['filter']}"  # as the figure has it
    words = html.escape(title.replace("{runs}", str(e.config["runs"])))
    return (
        f'<figure markdown="0"><img loading="lazy" alt="{words}" src="{e.name}/{path.name}">'
        f"<figcaption>{words}</figcaption></figure>"
    )


def _time(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
