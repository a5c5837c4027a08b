"""The site: everything is on it, it is built without a warning, and it asks nothing of the net."""

import csv
import html
import io
import json
import re
import subprocess
import sys
from functools import cache
from itertools import takewhile
from math import isfinite
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import yaml

import trackbench
from docs.site import gallery, problems, reference, thumbnails
from docs.site.pages import pages, rewritten
from tests.browser import LETTER, PARTED, WIDE, paper, sized
from tests.conftest import EXPERIMENT_FILES, ROOT
from tests.test_shipped import NAMES
from trackbench.commands.compare_new_with_stored import NEGLIGIBLE
from trackbench.commands.run_options import OPTION_NAMES
from trackbench.config import shipped_problems
from trackbench.contract.checks import CHECKS
from trackbench.contract.findings import Finding
from trackbench.contract.run_contract import check_filter
from trackbench.help import descriptions, lists
from trackbench.metrics import METRICS
from trackbench.registry import GROUPS, kinds
from trackbench.report.plotting import file_formats, style
from trackbench.report.plotting.panels import make_panels
from trackbench.statistics.significance_rules import ALIKE, BETTER, EQUAL, UNTESTED, WORSE
from trackbench.yaml_source import parse

PAGES = cache(reference.pages)


def read(path: Path, only: str = "") -> str:
    """A file's text, or the lines at its top that begin so."""
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    return "\n".join(takewhile(lambda line: line.startswith(only), text.splitlines())) + "\n"


@pytest.mark.parametrize("group", GROUPS)
def test_every_kind_has_its_keys_defaults_and_source(group: str) -> None:
    page = PAGES()[f"reference/{group}.md"]
    own = [k for k, c in kinds(group).items() if c.__module__.startswith("trackbench.")]
    sections = dict(re.findall(r"^## (\S+) \{.*?\}\n(.*?)(?=^## |\Z)", page, re.M | re.S))
    assert sections.keys() >= {*own}  # and those of a plugin that another test has brought
    for kind in own:
        (entry,) = (e for e in descriptions.entries(kind) if e["group"] == group)
        rows = dict(re.findall(r"^\| `(\S+)` \| ([^|]*) \|", sections[kind], re.M))
        for key in entry["keys"]:
            if not key["key"].startswith("assume."):
                assert key["key"] in rows
        for name, keys in entry["presets"].items():
            (text,) = re.findall(rf"`preset: {name}` is `(.*)`", sections[kind])
            if keys:
                assert parse(f"{{{text}}}", "preset.yaml").data == keys
        first = entry["text"].split()[0].strip("`")
        assert first in sections[kind]


def test_every_metric_statistic_key_and_command() -> None:
    metrics = PAGES()["reference/metrics.md"]
    for name in METRICS:
        assert f"| `{name}" in metrics
    for row in lists.rows(("statistics",)):
        assert f"| `{row['kind']}` |" in metrics
    for key in descriptions.experiment_keys():
        assert f"| `{key['key']}` |" in PAGES()["reference/config.md"]
    for command in ("run", "sweep", "tune", "compare", "plot", "report", "verify", "describe"):
        assert f"\n## {command}\n" in PAGES()["reference/commands.md"]
    assert "`--quick`" in PAGES()["reference/commands.md"]
    for name in trackbench.__all__:
        assert f"\n## {name}" in PAGES()["reference/python.md"]
    for word in ("figure(name)", "frame", "per\\_run", "best"):
        assert word.replace("\\", "") in PAGES()["reference/python.md"].replace("\\", "")


def test_the_page_on_programs_has_the_keywords_of_python() -> None:
    """Copy the table from ``print(reference.options_table())`` when a field changes."""
    page = (ROOT / "docs" / "programs.md").read_text(encoding="utf-8")
    for name in OPTION_NAMES:
        assert f"\n| `{name}` |" in reference.options_table()
    assert reference.options_table() in page


def test_the_gallery_has_every_experiment() -> None:
    found = gallery.pages()
    files = gallery.files()
    shown = files.keys() | gallery.pictures()
    assert {name for name in NAMES if (ROOT / "results" / name).is_dir()} == {
        e.name for e in gallery.experiments()
    }
    for e in gallery.experiments():
        page = found[f"gallery/{e.name}.md"]
        assert f"trackbench run {e.name}" in page
        assert EXPERIMENT_FILES[e.name].read_text().strip() in page
        assert all(line in page for line in e.verdict)
        for picture in re.findall(r'src="([^"]+)"', page + found["gallery/index.md"]):
            assert f"gallery/{picture}" in shown
    assert all(path.is_file() for path in files.values())


def test_a_thumbnail_has_one_panel() -> None:
    """It is a part of the figure whose letters are larger on a card than in the whole figure."""
    figures = ROOT / "results" / "radar-turns" / "figures" / "position.svg"
    whole = figures.read_text(encoding="utf-8")
    part = thumbnails.panel(figures)
    widths = [float(re.search(r' viewBox="\S+ \S+ (\S+)', text)[1]) for text in (whole, part)]  # type: ignore[index]
    assert widths[1] < 0.4 * widths[0]  # one of three columns
    assert part.partition(">")[2].endswith(whole[-1000:])
    for path in sorted(ROOT.glob("results/*/figures/p*.svg"))[:12]:
        _, _, width, height = map(
            float,
            re.search(r'viewBox="([^"]+)"', thumbnails.panel(path))[1].split(),  # type: ignore[index]
        )
        assert width > 50.0 < height


def test_a_thumbnail_has_all_lines_of_its_title_and_all_digits(tmp_path: Path) -> None:
    picture = tmp_path / "two.svg"
    with style.rc_context():
        figure, axes = make_panels(2, 1, 3.0)
        for (ax,) in axes:
            ax.set_title("a title\nin two lines\nor three")
            ax.set_yticks([0.0, 1.0], ["0", "-100 000"])
        picture.write_bytes(file_formats.content(figure, "svg"))
    part = thumbnails.panel(picture)
    left, top, *_ = map(float, re.search(r'viewBox="([^"]+)"', part)[1].split())  # type: ignore[index]
    x = float(re.search(r'x="(\S+)"[^>]*>-100 000', part)[1])  # type: ignore[index]
    assert left < x - 8 * 5.0
    y = float(re.search(r"translate\(\S+ (\S+)\)\"[^>]*>a title", part)[1])  # type: ignore[index]
    assert top < y - 7.0


def test_every_problem_has_its_picture_verdicts_and_finding() -> None:
    pages_of = gallery.pages()
    for row in problems.rows():
        page = pages_of[f"gallery/{row.problem.name}.md"]
        e = next(e for e in gallery.experiments() if e.name == row.problem.name)
        assert f'Cite as "trackbench/{e.name} v{row.problem.version}, ' in page
        assert page.count("<figure") == len(e.figures) >= 1
        assert "](../findings/" in page
        comment = read(EXPERIMENT_FILES[e.name], "#")
        assert comment.removeprefix("# ").split(". ")[0].replace("\n# ", " ") in page
        for row_of in csv.DictReader(io.StringIO(read(e.folder / "comparison.csv"))):
            assert f"| {row_of['verdict']}" in page


def test_no_figure_has_its_file_name_as_its_caption() -> None:
    pages = gallery.pages()
    for e in gallery.experiments():
        page = pages[f"gallery/{e.name}.md"]
        captions = set(re.findall(r"<figcaption>(.*?)</figcaption>", page))
        assert len(captions) >= 1 or not e.figures
        assert not captions & {path.stem for path in e.figures}, e.name


def test_the_table_of_problems_has_the_numbers_of_the_results() -> None:
    lines = problems.table("gallery/").splitlines()[2:]
    assert len(lines) == len(problems.rows()) == len(shipped_problems.problems())
    entries = 0
    for line in lines:
        problem, reference, filters = (cell.strip() for cell in line.strip("|").split(" | "))
        name = problem.split("]")[0].strip("[")
        config = yaml.load(read(ROOT / "results" / name / "config.yaml"), yaml.CSafeLoader)
        expression = problem.split("`")[1]
        values: dict[str, float] = {}
        for row in csv.DictReader(io.StringIO(read(ROOT / "results" / name / "summary.csv"))):
            if row["metric"] == expression and isfinite(float(row["value"])):
                values.setdefault(row["filter"], float(row["value"]))
        shown = re.findall(r'class="entry">(.*?) (-?[\d.e+-]+)(?: \(([\d.e+-]+)\))?<', filters)
        labels = [html.unescape(label) for label, _, _ in shown]
        floor = reference.rpartition(" ")
        smoothers = {b for b, keys in config["filters"].items() if keys.get("smooth")}
        exact = {f"{label}, exact" for label in config["filters"]}
        assert {*labels, floor[0]} >= values.keys() - smoothers - exact - {config.get("bound")}
        assert not smoothers & {*labels}
        for label, (_, number, ratio) in zip(labels, shown, strict=True):
            assert float(number) == pytest.approx(values[label], rel=1e-3)
            assert (ratio != "") == (floor[2] != "" and "score" not in expression)
            if ratio:
                assert float(ratio) == pytest.approx(values[label] / float(floor[2]), rel=0.01)
        ranked = [values[label] for label in labels]
        assert ranked == sorted(ranked, reverse="score" in expression)
        entries += len(labels)
    assert entries > 100
    # The ranking counts the whole run: the steps before a fault say nothing about it.
    by_name = {row.problem.name: row for row in problems.rows()}
    assert not [row.expression for row in by_name.values() if "[" in row.expression]
    assert [*by_name["fault-freeze"].values][-1] == "EKF"


def test_links_are_those_of_the_site() -> None:
    known = pages() | {"results/hdepf/": "gallery/hdepf.md"}
    text = '[a](../results/hdepf/ "PF; mean(rmse)") [`b`](decisions/verdicts.md) [c](../LICENSE)'
    found = rewritten(text, "docs/running.md", "running.md", known)
    assert '[a](gallery/hdepf.md "PF; mean(rmse)") [`b`](decisions/verdicts.md) c' in found
    assert rewritten("[e](../docs/tuning.md)", "experiments/README.md", "findings.md", known) == (
        "[e](tuning.md)"
    )


def test_the_page_for_assistants_is_short_and_has_every_check() -> None:
    page = (ROOT / "docs" / "for-assistants.md").read_text(encoding="utf-8")
    assert len(page.splitlines()) <= 80
    repairs = page.partition("| bad finding |")[2].partition("##")[0]
    rows = re.findall(r"^\| ([^|]+?) \|", repairs, re.M)
    name = next(f.check for f in check_filter(kinds("filters")["imm"]) if "default" in f.check)
    assert rows == [name, *(check for check, _ in CHECKS.values())]
    for word in (
        EQUAL,
        ALIKE,
        NEGLIGIBLE,
        BETTER,
        WORSE,
        UNTESTED,
        *get_args(get_type_hints(Finding)["verdict"]),
    ):
        assert f"`{word}`" in page
    examples = [json.loads(line) for line in page.splitlines() if line.startswith("    {")]
    assert {*examples[0]["contract"][0]} == {*Finding._fields}
    assert len(examples) == 3


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("material", reason="builds the site; `make docs` installs what it needs")
    out = tmp_path_factory.mktemp("site")
    words = ("build", "--quiet", "--strict", "-f", "docs/mkdocs.yml", "-d", str(out))
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", *words], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_the_site_is_built_and_asks_nothing_of_the_net(site: Path) -> None:
    front = (site / "index.html").read_text(encoding="utf-8")
    words = re.sub("<[^>]*>", "", front)
    assert "trackbench run air-traffic" in words
    # The screen of the first run, the picture of all problems, and three findings.
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for row in re.findall(r"^(?:PCRLB|IMM, |KF ).*", readme, re.M):
        cells = [f"<td>{html.escape(cell)}</td>" for cell in re.split(r"\s{2,}", row)]
        assert "".join(cells) in front
    article = front.partition("<article")[2].partition("</article>")[0]
    pictures = re.findall(r'<img[^>]* src="([^"]+)"', article)
    assert pictures[0] == "pictures/known-matrix.svg"
    assert [picture.partition("/")[0] for picture in pictures[1:]] == ["gallery"] * 3
    assert not re.search(r"<pre[^>]*>[^\n]{60}", re.sub("</?(span|code|a)[^>]*>", "", article))
    found = (site / "found.html").read_text(encoding="utf-8")
    link = '<a href="gallery/adaptive-kf-tuned-paths.html" title="KF (tuned); mean(rmse_position)">'
    assert link in found
    boosts = {
        page["location"]: page.get("boost", 1)
        for page in json.loads((site / "search" / "search_index.json").read_text("utf-8"))["docs"]
    }
    for uri in ("ledger", "benchmarks", "changelog", "findings/hdepf", "gallery/hdepf"):
        assert boosts[f"{uri}.html"] < boosts["your-data.html"] < boosts["tutorial.html"]
    for uri in [*pages().values(), *PAGES(), *gallery.pages(), *problems.pages()]:
        page = (site / uri).with_suffix(".html").read_text(encoding="utf-8")
        assert not re.search(
            r'(<script|<img|<link(?! rel="canonical"))[^>]*(src|href)="https?:', page
        )
        for picture in re.findall(r'<img[^>]* src="([^"]+)"', page):
            assert ((site / uri).parent / picture).is_file(), f"{uri}: {picture}"
    text = (site / "llms.txt").read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#]+)", text)
    assert links
    assert all((site / link).is_file() for link in links)
    style = "".join(p.read_text(encoding="utf-8") for p in site.rglob("*.css"))
    assert not re.search(r"url\(['\"]?https?:", style)


CUT = """
const cut = [];
for (const text of document.querySelectorAll("svg text")) {
  const box = text.getBoundingClientRect();
  const view = text.closest("svg").getBoundingClientRect();
  const isOutside = box.right < view.left || box.left > view.right
    || box.bottom < view.top || box.top > view.bottom;
  const isInside = box.left >= view.left - 1 && box.right <= view.right + 1
    && box.top >= view.top - 1 && box.bottom <= view.bottom + 1;
  if (!isOutside && !isInside) cut.push(text.closest("svg").parentElement.id + ": " + text.textContent);
}
return cut
"""
"""Script: the texts of pictures that an edge cuts."""


def test_no_thumbnail_cuts_a_text(tmp_path: Path, browser: Any) -> None:
    pictures = []
    for uri, picture in gallery.pictures().items():
        head = re.search("<svg [^>]*>", picture)
        assert head
        texts = "".join(re.findall("<text .*?</text>", picture, re.S))
        pictures.append(f'<div id="{uri}">{head[0]}{texts}</svg></div>')
    page = tmp_path / "thumbnails.html"
    page.write_text(f'<meta charset="utf-8">{"".join(pictures)}', encoding="utf-8")
    browser.get(page.as_uri())
    assert len(pictures) > 60
    assert browser.execute_script(CUT) == []


def shown_text(page: str) -> str:
    """Return the words of a page's article."""
    article = page.partition("<article")[2].partition("</article>")[0]
    words = re.sub("</?(code|a|em|strong|span)\\b[^>]*>", "", article)
    return " ".join(html.unescape(re.sub("<[^>]*>", " ", words)).split())


def test_no_word_of_a_docstring_vanishes(site: Path) -> None:
    texts = {}
    for group in GROUPS:
        own = [k for k, c in kinds(group).items() if c.__module__.startswith("trackbench.")]
        entries = [entry for kind in own for entry in descriptions.entries(kind)]
        keys = [key for entry in entries if entry["group"] == group for key in entry["keys"]]
        texts[group] = [key["text"] for key in keys if not key["key"].startswith("assume.")]
    texts["config"] = [key["text"] for key in descriptions.experiment_keys()]
    assert any("{" in text for text in texts["filters"])
    assert any("<component>" in text for text in texts["tables"])
    for name, sentences in texts.items():
        shown = shown_text((site / "reference" / f"{name}.html").read_text(encoding="utf-8"))
        for sentence in sentences:
            plain = " ".join(sentence.replace("`", "").split())
            assert re.sub(r"\(see trackbench list (\w+)\)", r"(\1)", plain) in shown
    for path in site.rglob("*.html"):
        if path.name != "report.html":
            cells = re.findall(r"<(?:td|th|p|li) ([^>]*)>", path.read_text(encoding="utf-8"))
            names = {name for cell in cells for name in re.findall(r"([^\s=]+)=", cell)}
            assert names <= {"class", "id", "style", "align"}, path.name


def test_options_and_paths_of_pages_are_whole_and_linked(site: Path) -> None:
    running = (site / "running.html").read_text(encoding="utf-8")
    assert '<code><span class="whole">--quick</span></code>' in running
    commands = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    filters = (site / "reference" / "filters.html").read_text(encoding="utf-8")
    assert '<a href="../json-lines.html">' in commands
    assert '<a href="../pictures/line-of-sight.svg">' in filters
    assert "docs/" not in shown_text(commands) + shown_text(filters)
    for e in gallery.experiments():
        page = (site / "gallery" / f"{e.name}.html").read_text(encoding="utf-8")
        assert re.search(r'<a href="\.\./findings/[^"]+">Findings</a>', page), e.name
    # The decisions stand in the menu of the design.
    menu = yaml.load(
        (ROOT / "docs" / "mkdocs.yml").read_text("utf-8").partition("\nnav:")[2], yaml.CSafeLoader
    )
    design = next(section["Design"] for section in menu if "Design" in section)
    assert {"Decisions": ["decisions/index.md"]} in design
    decision = (site / "decisions" / "verdicts.html").read_text(encoding="utf-8")
    tab = re.search(r'md-tabs__item--active">\s*<a[^>]*>\s*([^<]*?)\s*<', decision)
    assert tab
    assert tab[1] == "Design"


def test_a_list_of_the_changelog_is_a_list(site: Path) -> None:
    page = (site / "changelog.html").read_text(encoding="utf-8")
    items = re.findall("^- ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    article = page.partition("<article")[2].partition("</article>")[0]
    assert article.count("<li>") == len(items)


WRAPPED = """
return [...document.querySelectorAll("pre > code")].filter(code => {
  const lines = code.textContent.replace(/\\n$/, "").split("\\n").length;
  const style = getComputedStyle(code);
  const height = code.clientHeight - parseFloat(style.paddingTop) - parseFloat(style.paddingBottom);
  return height > (lines + 0.5) * parseFloat(style.lineHeight);
}).map(code => code.textContent)
"""
"""Script: the blocks of code with a line that goes on in the next one."""
COVERED = """
return [...document.querySelectorAll("pre:has(.md-code__nav)")].filter(pre => {
  const button = pre.querySelector(".md-code__nav").getBoundingClientRect();
  return pre.querySelector("code").getBoundingClientRect().right > button.left + 1;
}).map(pre => pre.textContent)
"""
"""Script: the blocks of code that reach below their button to copy them."""
OPTIONS = """
return [...document.querySelectorAll("code .whole")]
  .filter(option => option.getClientRects().length > 1)
  .map(option => option.textContent)
"""
"""Script: the options that a line's end parts."""
OVER_PICTURE = """
return [...document.querySelectorAll(".card")].filter(card =>
  card.querySelector("strong").getBoundingClientRect().top
    < card.querySelector(".frame").getBoundingClientRect().bottom - 1
).map(card => card.textContent)
"""
"""Script: the cards of the gallery whose title stands on its picture."""


def test_pages_fit_a_phone_and_paper(site: Path, browser: Any) -> None:
    """Small letters of a picture grow on a phone; on paper tables have all columns, and whole words."""
    sized(browser, 388, 900)
    browser.get((site / "which-filter.html").as_uri())
    script = (
        "return [...document.querySelectorAll('.sideways img')].map(image => image.clientWidth)"
    )
    widths = browser.execute_script(script)
    assert len(widths) == 4
    assert min(widths) > 500
    assert browser.execute_script(WIDE) <= 0
    # Lines of code scroll, and do not go on in the next line.
    browser.get((site / "precision.html").as_uri())
    assert browser.execute_script(WRAPPED) == []
    # A key of the reference has its text below it, on the screen.
    browser.get((site / "reference" / "scenarios.html").as_uri())
    cells = "[...document.querySelectorAll('.keys td')].map(td => td.getBoundingClientRect())"
    assert browser.execute_script(f"return Math.max(...{cells}.map(box => box.right))") <= 388
    sized(browser, 1400, 900)
    for page in ("running.html", "your-filter-in-ci.html", "json-lines.html"):
        browser.get((site / page).as_uri())
        assert browser.execute_script(WRAPPED) == []
        assert browser.execute_script(COVERED) == []
        assert browser.execute_script(OPTIONS) == []
    browser.get((site / "problems.html").as_uri())
    with paper(browser, LETTER):
        assert browser.execute_script(OVER_PICTURE) == []
    for page in ("gallery/hdepf.html", "findings/hdepf.html"):
        browser.get((site / page).as_uri())
        with paper(browser, LETTER):
            assert browser.execute_script(PARTED) == []
            assert browser.execute_script(WIDE) <= 0


def test_the_sections_of_a_docstring_are_lists() -> None:
    """They were running text: `Parameters ---------- config path of a config`."""
    page = PAGES()["reference/python.md"]
    assert "**Parameters**\n\n- `config`: path of a config, name of a shipped experiment" in page
    assert "----------" not in page
    assert not re.search(r"^- .*: ?$", page, re.MULTILINE)
