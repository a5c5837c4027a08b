"""report.html: nothing from outside, nothing injected, and it works in a browser."""

import shutil
from html.parser import HTMLParser

import pytest

from trackbench import api
from trackbench.report.svg import inline


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


def test_the_line_to_run_it_again_may_be_typed(made, tmp_path, monkeypatch):
    shutil.copytree(made, tmp_path / "my results" / "a")
    monkeypatch.chdir(tmp_path)
    (path,) = api.report("my results/a")
    assert "trackbench run 'my results/a/config.yaml'" in Page(path.read_text()).text


def test_it_says_how_to_run_it_again(page):
    assert "trackbench run out/config.yaml" in page.text  # of an absolute folder only the end
    assert "numpy" in page.text


BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if not BROWSER or not DRIVER:
        pytest.skip("no chromium with chromedriver on this machine")
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (
        *("headless", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run", "disable-sync"),
        *("disable-background-networking", "disable-component-update", "disable-dev-shm-usage"),
        f"user-data-dir={tmp_path_factory.mktemp('browser')}",
    ):
        options.add_argument(f"--{flag}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    yield driver
    driver.quit()


def column(browser, selector, index):
    rows = "[...document.querySelectorAll(arguments[0])]"
    script = f"return {rows}.map(row => row.cells[arguments[1]].innerText)"
    return browser.execute_script(script, f"{selector} tbody tr", index)


def test_in_a_browser(browser, folder):
    api.report(folder)
    browser.get((folder / "report.html").as_uri())
    assert browser.title == "A small & <b>quick</b> experiment"
    head = browser.find_elements("css selector", "#tables thead button")[1]
    before = column(browser, "#tables", 1)
    head.click()
    ascending = column(browser, "#tables", 1)
    assert ascending == sorted(before, key=lambda text: float(text.split()[0]))
    assert head.find_element("xpath", "..").get_attribute("aria-sort") == "ascending"
    head.send_keys("\n")  # from the keyboard
    assert column(browser, "#tables", 1) == ascending[::-1]

    button = browser.find_element("css selector", "figure .enlarge")
    drawing = browser.find_element("css selector", "figure svg")
    before = drawing.size
    browser.execute_script("arguments[0].click()", button)
    assert browser.find_elements("css selector", "figure.large")
    assert drawing.size["width"] > before["width"]
    assert drawing.size["height"] > before["height"]
    button.send_keys("\ue00c")  # Escape
    assert not browser.find_elements("css selector", "figure.large")

    browser.set_window_size(500, 900)
    wide = "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert browser.execute_script(wide) <= 0  # tables scroll inside themselves on a phone
    assert browser.get_log("browser") == []


def test_the_index_in_a_browser(browser, folder):
    index, _ = api.report(folder.parent)
    browser.get(index.as_uri())
    browser.find_element("link text", "small").click()
    assert browser.current_url.endswith("small/report.html")
    assert browser.get_log("browser") == []
