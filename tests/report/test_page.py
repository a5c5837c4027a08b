"""report.html: nothing from outside, nothing injected, and it works in a browser."""

import json
import shutil
import time
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.figure import Figure

from tests.browser import A5, LETTER, PARTED, WIDE, paper, sized
from trackbench import api
from trackbench.errors import UserError
from trackbench.report.html.page_templates import _breakable
from trackbench.report.html.svg import inline
from trackbench.report.plotting.file_formats import matplotlib_file
from trackbench.report.tables_and_figures import Results

RESULTS = Path(__file__).parents[2] / "results"
SVG = "{http://www.w3.org/2000/svg}"


class Page(HTMLParser):
    """Tags with their attributes, and the text outside of them."""

    def __init__(self, text):
        super().__init__()
        self.tags = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data

    def all(self, tag):
        return [attrs for name, attrs in self.tags if name == tag]


@pytest.fixture(scope="module")
def page(made):
    return Page((made / "report.html").read_text())


def test_a_hostile_label_is_text_and_nothing_else(page, hostile):
    assert hostile in page.text
    assert len(page.all("script")) == 1
    assert not page.all("img")
    assert not page.all("b")
    assert not page.all("i")
    assert not [a for _, attrs in page.tags for a in attrs if a.startswith("on")]


def test_nothing_comes_from_outside(page):
    for tag, attrs in page.tags:
        assert tag not in ("iframe", "object", "embed", "base")
        assert "src" not in attrs
        for key in ("href", "xlink:href"):
            assert attrs.get(key, "#").startswith(("#", "data:"))
    (policy,) = [m["content"] for m in page.all("meta") if "http-equiv" in m]
    assert policy.startswith("default-src 'none'")


def test_screen_readers_find_their_way(page):
    assert page.all("html") == [{"lang": "en"}]
    assert len(page.all("h1")) == 1
    assert all(attrs.get("scope") in ("col", "row") for attrs in page.all("th"))
    drawings = [attrs for attrs in page.all("svg") if attrs.get("role") == "img"]
    ids = [attrs["id"] for _, attrs in page.tags if "id" in attrs]
    assert len(drawings) == 6
    assert len(ids) == len(set(ids))
    assert all(attrs["aria-labelledby"] in ids for attrs in drawings)


def test_an_svg_that_was_tampered_with_loses_its_scripts():
    bad = b"""<svg xmlns="http://www.w3.org/2000/svg" onload="x()"><script>x()</script>
    <a href="javascript:x()"><g id="a" onclick="x()"/></a><style>body {display: none}</style>
    <use href="#a" fill="url(#b)"/><foreignObject><p>x</p></foreignObject></svg>"""
    text = inline(bad, "one", "<b>t</b>")
    for word in ("onload", "onclick", "script", "style>", "foreignObject", "<b>"):
        assert word not in text
    assert 'id="one-a"' in text
    assert 'href="#one-a"' in text
    assert 'fill="url(#one-b)"' in text


STRANGE = """<svg xmlns="http://www.w3.org/2000/svg" xmlns:h="http://www.w3.org/1999/xhtml"
 xmlns:xlink="http://www.w3.org/1999/xlink">%s</svg>"""


@pytest.mark.parametrize(
    "part",
    [
        '<h:meta http-equiv="refresh" content="0;url=http://x.example"/>',
        '<meta http-equiv="refresh" content="0;url=//x.example"/>',
        '<title><h:form action="//x.example"><h:input/></h:form></title>',
        '<h:img src="//x.example/a.png"/>',
        '<g><h:iframe src="//x.example"/></g>',
        '<image href="//x.example/a.png"/>',
        '<image xlink:href="data:image/svg+xml,//x.example"/>',
        '<use href="//x.example/a.svg#b"/>',
        '<a xlink:href="//x.example"><g/></a>',
        '<animate attributeName="href" to="//x.example"/>',
        '<g style="background: url(//x.example)"/>',
        '<g style="fill: red; position: fixed; fill: u\\72l(//x.example)"/>',
        '<rect fill="URL( //x.example#a )"/>',
        '<g class="x.example"/>',
        '<g formaction="//x.example" onbegin="x.example"/>',
        '<style>@import "//x.example";</style>',
    ],
)
def test_nothing_of_an_svg_reaches_outside(part):
    text = inline((STRANGE % part).encode(), "one", "t")
    for word in ("x.example", "meta", "form", "position", "animate"):
        assert word not in text
    assert text.count("<title") == 1 + ("<title" in part)


def test_a_style_keeps_what_draws():
    svg = (
        STRANGE % '<g style="fill: red; position: fixed; clip-path: url(#a)" clip-path="url(#a)"/>'
    )
    text = inline(svg.encode(), "one", "t")
    assert 'style="fill: red; clip-path: url(#one-a)"' in text
    assert 'clip-path="url(#one-a)"' in text


def test_the_time_of_cleaning_grows_with_the_length():
    """Of a quadratic search the larger file took two minutes."""
    svg = STRANGE % f'<g style="fill: {"url(#" * 50_000}" d="M1 1"/>'
    started = time.process_time()
    text = inline(svg.encode(), "one", "t")
    assert time.process_time() - started < 5.0
    assert "url(#" not in text


@pytest.mark.parametrize("depth", [101, 200_000])
def test_groups_that_are_nested_without_end_are_refused(depth):
    svg = STRANGE % ("<g>" * depth + "</g>" * depth)
    with pytest.raises(UserError, match=r"figures/one\.svg: has groups within groups, more than"):
        inline(svg.encode(), "one", "t")


def test_a_page_is_no_figure():
    with pytest.raises(
        UserError, match=r"figures/one\.svg: is not an SVG file: it begins with html"
    ):
        inline(b"<html/>", "one", "t")


def test_all_that_matplotlib_draws_stays():
    figure = Figure()
    axes = figure.subplots()
    axes.bar([1], [1], hatch="/", alpha=0.5)
    axes.imshow(np.eye(2), extent=(0, 1, 0, 1))
    axes.tripcolor([0, 1, 0], [0, 0, 1], [1.0, 2.0, 3.0], shading="gouraud")
    axes.annotate("$x^2$ a", (0, 0), arrowprops={"arrowstyle": "->"}, bbox={"boxstyle": "round"})
    content = matplotlib_file(figure, "svg")
    before, after = ET.fromstring(content), ET.fromstring(inline(content, "one", "t"))
    gone = {f"{SVG}style", f"{SVG}metadata"}
    parts = [e for e in before.iter() if e.tag in gone]
    gone |= {e.tag for part in parts for e in part.iter()}
    drawn = [e for e in before.iter() if e.tag not in gone][1:]
    stays = [e for e in after.iter() if e.get("id") != "one-title"][1:]
    assert [(e.tag, sorted(e.attrib)) for e in drawn] == [(e.tag, sorted(e.attrib)) for e in stays]
    assert {f"{SVG}pattern", f"{SVG}filter", f"{SVG}image"} <= {e.tag for e in stays}


def test_the_line_to_run_it_again_may_be_typed(made, tmp_path, monkeypatch):
    shutil.copytree(made, tmp_path / "my results" / "a")
    monkeypatch.chdir(tmp_path)
    (path,) = api.report("my results/a")
    assert "trackbench run 'my results/a/config.yaml'" in Page(path.read_text()).text


def test_it_says_how_to_run_it_again(page):
    assert "trackbench run out/config.yaml" in page.text  # of an absolute folder only the end
    assert "numpy" in page.text


def test_pages_of_the_shipped_results_are_small():
    """Add up what a page is mostly made of: its figures and pairs. Git has no pages."""
    sizes = [
        sum(path.stat().st_size for path in (*folder.glob("figures/*.svg"), folder / "paired.csv"))
        for folder in (config.parent for config in RESULTS.glob("*/config.yaml"))
    ]
    assert sizes
    assert max(sizes) < 1_500_000


def column(browser, selector, index):
    rows = "[...document.querySelectorAll(arguments[0])]"
    script = f"return {rows}.map(row => row.cells[arguments[1]].innerText)"
    return browser.execute_script(script, f"{selector} tbody tr", index)


@pytest.fixture
def shown(browser, made):
    """The report in the browser, as wide as a laptop; nothing in it complains."""
    sized(browser, 1400, 900)
    browser.get((made / "report.html").as_uri())
    yield browser
    assert browser.get_log("browser") == []


def part(browser, selector):
    return browser.find_element("css selector", selector)


def press(browser, selector, text):
    """Click the button or link with this text."""
    found = browser.find_elements("css selector", f"{selector} :is(button, a)")
    (it,) = [e for e in found if e.get_attribute("textContent") == text]
    browser.execute_script("arguments[0].click()", it)


def test_the_page_opens_on_the_answer(shown):
    """The sentence, the ranking with a line a filter, the figure as wide as the page, the verdicts."""
    assert shown.title == "A small & <b>quick</b> experiment"
    order = [".opening .answer", ".opening table", ".opening figure", ".opening .bar", ".facts"]
    tops = [part(shown, selector).rect["y"] for selector in order]
    assert tops == sorted(tops)
    assert " has the lowest mean RMSE per run of 4 filters." in part(shown, order[0]).text
    ranking = part(shown, ".opening .scroll").rect
    assert ranking["y"] + ranking["height"] < 900
    rows = shown.find_elements("css selector", ".opening tbody tr")
    assert max(row.size["height"] for row in rows) < 40
    drawing = part(shown, ".opening figure svg").rect
    assert drawing["width"] == part(shown, "main").size["width"] - 48  # the padding
    script = "return [...document.querySelectorAll('figure svg text')].map("
    heights = "text => text.getBoundingClientRect().height).filter(height => height > 0)"
    assert min(shown.execute_script(script + heights)) > 10.0
    for width in (1400, 390):  # tables and figures scroll inside themselves on a phone
        sized(shown, width, 900)
        assert shown.execute_script(WIDE) <= 0


@pytest.mark.parametrize(("width", "excess"), [(LETTER, 0), (A5, 60)])
def test_printed_tables_fit_the_paper_and_their_words_stay_whole(shown, width, excess):
    """Paper does not scroll. Browsers print a page that is slightly wider so much smaller."""
    with paper(shown, width):
        assert shown.execute_script(PARTED) == []
        assert shown.execute_script(WIDE) <= excess


def test_paper_has_no_buttons_and_nothing_closed(shown):
    with paper(shown, LETTER):
        text = part(shown, "main").text
    assert "A click on a heading sorts" not in text
    assert "The resolved config is the file config.yaml" in text
    assert "numpy" in text  # the versions, which a screen has folded
    assert "filters:" not in text  # the config itself


def test_a_phone_has_no_row_that_is_mostly_empty(shown):
    """A long note at the end of a row, off the screen, has up to three lines."""
    sized(shown, 420, 900)
    shown.execute_script(
        "for (const part of document.querySelectorAll('details')) part.open = true"
    )
    rows = shown.find_elements("css selector", "#verdicts tbody tr")
    heights = [row.size["height"] for row in rows if row.text.startswith("PF")]
    assert heights
    assert max(heights) < 75
    # The column that stays in place covers no rule: each cell has its own.
    first = part(shown, "#tables tbody tr:nth-child(2) th")
    assert first.value_of_css_property("border-top-width") == "1px"
    assert (
        first.find_element("xpath", "ancestor::table").value_of_css_property("border-collapse")
        == "separate"
    )


def test_filters_are_counted_as_the_answer_counts_them(page):
    assert "of 4 filters." in page.text
    assert "5, 4 ranked" in page.text  # the reference is not


def test_long_words_of_a_table_may_break_and_numbers_not():
    text = "assume.sensor.0.sigma 6.28e-07 ± 1.8e-07 <b> ANEES " + "x" * 30
    html = str(_breakable(text))
    assert html.replace("<wbr>", "") == (
        'assume.sensor.0.sigma <span class="whole">6.28e-07</span> ± <span class="whole">1.8e-07</span>'
        f" &lt;b&gt; ANEES {'x' * 30}"
    )
    assert "assume.<wbr>sensor.0.<wbr>sigma" in html
    assert f"{'x' * 24}<wbr>{'x' * 6}" in html


def test_tables_unfold_and_sort(shown):
    assert part(shown, "#tables table").is_displayed()  # the first is open
    part(shown, "#tables summary").click()
    assert not part(shown, "#tables table").is_displayed()
    part(shown, "#tables summary").click()
    head = shown.find_elements("css selector", "#tables thead button")[1]
    before = column(shown, "#tables", 1)
    head.click()
    ascending = column(shown, "#tables", 1)
    assert ascending == sorted(before, key=lambda text: float(text.split()[0]))
    assert head.find_element("xpath", "..").get_attribute("aria-sort") == "ascending"
    head.send_keys("\n")  # from the keyboard
    assert column(shown, "#tables", 1) == ascending[::-1]


def test_verdicts_are_filtered_by_word_and_by_text(shown):
    def words():
        rows = shown.find_elements("css selector", "#verdicts tbody tr:not([hidden]) .verdict")
        return {row.get_attribute("data-word") for row in rows}

    every = words()
    part(shown, ".opening .bar a[data-word=fails]").click()
    assert words() == {"fails"} < every
    press(shown, "#verdicts .chooser", "fails")
    assert words() == every
    part(shown, ".chooser input").send_keys("Fewer particles")
    assert words() == {"fails"}


@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 844), (844, 390)])
def test_a_figure_is_enlarged(shown, width, height):
    sized(shown, width, height)
    drawing = part(shown, "#figure-time svg")
    before = drawing.size
    press(shown, "#figure-time", "Enlarge")
    assert drawing.size["width"] > before["width"]
    assert drawing.size["height"] > before["height"]
    part(shown, "#figure-time .enlarge").send_keys("\ue00c")  # Escape
    assert not shown.find_elements("css selector", "figure.large")


def test_a_curve_is_hidden_and_read_off(shown, made):
    frame = Results(made).per_step.query("metric == 'rmse' and step == 7").set_index("filter")
    drawing = part(shown, "#figure-time svg")

    def read():
        box = drawing.rect
        (panel,) = json.loads(drawing.get_attribute("data-live"))["axes"]
        (left, top, right, _), (low, high) = panel["box"], panel["x"]["ends"]
        scale = box["width"] / float(drawing.get_dom_attribute("viewBox").split()[2])
        x = scale * (left + (7.2 - low) / (high - low) * (right - left)) - box["width"] / 2
        webdriver = pytest.importorskip("selenium.webdriver")
        move = webdriver.ActionChains(shown).move_to_element_with_offset
        move(drawing, round(x), round(scale * top + 20 - box["height"] / 2)).perform()
        head, *lines = shown.find_elements("css selector", "#figure-time .readout div")
        numbers = [line.find_element("css selector", "b").text for line in lines]
        labels = [x.text.removesuffix(n).strip() for x, n in zip(lines, numbers, strict=True)]
        return head.text, dict(zip(labels, numbers, strict=True))

    shown.execute_script("arguments[0].scrollIntoView()", drawing)
    at, found = read()
    assert at == "at 7"
    assert set(found) == set(frame.index)
    for label, text in found.items():
        for number, column in zip(text.split(" ± "), ("value", "stderr"), strict=True):
            places = len(number.partition(".")[2])  # right to the last of them
            assert number == f"{frame[column][label]:.{places}f}"
    (key,) = [
        key
        for key in drawing.find_elements("css selector", "[data-key][role=button]")
        if key.get_attribute("aria-label") == "Show No data"
    ]
    key.send_keys("\n")
    assert key.get_attribute("aria-pressed") == "false"
    shapes = shown.execute_script(
        "return [...document.querySelectorAll(`#figure-time [data-of='${arguments[0]}']`)]"
        ".map(shape => shape.style.display)", key.get_attribute("data-key"))  # fmt: skip
    assert len(shapes) > 1  # its band, or bars, too
    assert set(shapes) == {"none"}
    assert "No data" not in read()[1]
    assert read()[1]["PF"] == found["PF"]


def test_axes_zoom_and_turn_logarithmic(shown):
    drawing = part(shown, "#figure-time svg")
    shown.execute_script("arguments[0].scrollIntoView()", drawing)

    def path():
        return part(shown, "#figure-time [data-of] path").get_attribute("d")

    before = path()
    webdriver = pytest.importorskip("selenium.webdriver")
    webdriver.ActionChains(shown).move_to_element_with_offset(
        drawing, -60, -30
    ).click_and_hold().move_by_offset(120, 50).release().perform()
    zoomed = path()
    assert zoomed != before
    press(shown, "#figure-time", "Log axis")
    assert path() not in (before, zoomed)
    assert "NaN" not in path()
    press(shown, "#figure-time", "Whole figure")
    assert path() == before


def test_without_a_script_nothing_is_lost(browser, made):
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        browser.get((made / "report.html").as_uri())
        assert part(browser, "#figure-time svg").is_displayed()
        assert not browser.find_elements("css selector", ".tool")
        assert part(browser, "#tables table").is_displayed()
        part(browser, "#tables summary").click()
        assert not part(browser, "#tables table").is_displayed()
    finally:
        browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


def test_it_prints_what_is_folded(shown):
    part(shown, "#tables summary").click()
    shown.execute_script("window.dispatchEvent(new Event('beforeprint'))")
    assert part(shown, "#tables table").is_displayed()
    shown.execute_script("window.dispatchEvent(new Event('afterprint'))")
    assert not part(shown, "#tables table").is_displayed()


def test_the_index_in_a_browser(browser, folder):
    index, _ = api.report(folder.parent)
    browser.get(index.as_uri())
    browser.find_element("link text", "small").click()
    assert browser.current_url.endswith("small/report.html")
    assert browser.get_log("browser") == []
