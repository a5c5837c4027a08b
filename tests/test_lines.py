"""`--json`: an object a line, for programs; and nothing but text where nobody looks at a terminal."""

import csv
import json
import os
import re
import sys
from dataclasses import fields
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from docs.site.blocks import blocks
from tests.commands import BARE, Command, spawned, trackbench
from tests.conftest import ROOT
from trackbench.cli.output import echo_line
from trackbench.commands.gate import NEGLIGIBLE
from trackbench.contract import Finding
from trackbench.registry import GROUPS, kinds
from trackbench.report.compare_folders import DIFFERS
from trackbench.report.suite.scores import BEST, LOSES_MORE, Score
from trackbench.statistics import rules


def lines(
    *words: str, cwd: Path = ROOT, code: int = 0, by: Command = trackbench
) -> list[dict[str, Any]]:
    """What a command prints; no number in it is one that JSON does not know."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    done = by(*words, "--json", cwd=cwd)
    assert done.returncode == code, done.stderr
    return [json.loads(line, parse_constant=refuse) for line in done.stdout.splitlines()]


def test_list() -> None:
    found = lines("list", by=spawned)  # which knows no kind of another test
    for group in GROUPS:
        named = {line["kind"] for line in found if line["group"] == group}
        shipped = {k for k, c in kinds(group).items() if c.__module__.startswith("trackbench.")}
        assert named == shipped
    experiments = [line for line in found if line["group"] == "experiments"]
    assert experiments == lines("list", "experiments")
    assert {"name", "title", "paper", "cpu_s"} <= experiments[0].keys()
    keys = {"name", "version", "title", "numbers", "reference", "paper", "cpu_s"}
    assert keys <= lines("list", "problems")[0].keys()


def test_describe() -> None:
    (found,) = lines("describe", "hdepf")
    assert found["group"] == "filters"
    keys = {key["key"]: key for key in found["keys"]}
    assert keys["CR"]["default"] == "0.6"
    assert "crossover" in keys["CR"]["text"]
    assert "literal" in found["presets"]
    assert "assume.motion" in keys
    named = [group for group in GROUPS if "recorded" in kinds(group)]
    assert [line["group"] for line in lines("describe", "recorded")] == named


def test_what_is_measured_has_fields() -> None:
    (found,) = lines("describe", "rmse_position")
    assert (found["group"], found["kind"], found["unit"]) == ("metrics", "rmse_position", "m")
    assert (found["better"], found["text"]) == ("lower", "root mean square length of the error")
    (found,) = lines("describe", "median")
    assert (found["group"], found["text"]) == ("statistics", "median over the runs")
    named = {line["kind"]: line for line in lines("list", "metrics")}
    assert named["nees"].keys() == {"group", "kind", "text", "unit", "better"}
    assert [line["kind"] for line in lines("list", "statistics")][:2] == ["mean", "variance"]


def test_the_metrics_of_a_config() -> None:
    found = lines("list", "metrics", "adaptive-kf")
    metrics = {line["kind"]: line for line in found if line["group"] == "metrics"}
    assert metrics["rmse_position"]["per_step"] is metrics["rmse_position"]["kept"] is True
    assert metrics["rmse_velocity"]["kept"] is metrics["missed_maneuvers"]["per_step"] is False
    assert {"leg 1", "cpu_s_per_run"} <= {line["kind"] for line in found}


def test_check_and_mistakes() -> None:
    (found,) = lines("check", "radar-turns")
    assert found["good"] is True
    assert "IMM, EKF" in found["filters"]
    (found,) = lines("check", "radar-turns", "--set", "runs=a", "--set", "seed=-1", code=2)
    assert found["good"] is False
    by_path = {mistake["path"]: mistake for mistake in found["mistakes"]}
    assert by_path["runs"]["what"] == "'a' is not a whole number"
    assert by_path["seed"]["file"] == "--set seed=-1"
    (found,) = lines("describe", "hdpf", code=2)
    assert "did you mean hdepf" in found["mistakes"][0]["what"]


def test_run_and_compare(tmp_path: Path) -> None:
    words = ("--runs", "4", "--set", "block=fit", "--only", "PF", "--out", "out", *BARE)
    assert "2 filters x 4 runs" in lines("run", "hdepf", *words, "--dry-run")[0]["would"]
    (found,) = lines("run", "hdepf", *words, cwd=tmp_path)
    assert (found["experiment"], found["folder"], found["failed"]) == ("hdepf", "out", [])
    first = found["tables"]["table1"]["rows"][0]
    assert first["Filter"] == "PF"
    assert first["Mean (RMSE)"] > 0
    compared = lines("compare", "out", cwd=tmp_path)
    assert compared == found["numbers"] + found["claims"]
    assert {"verdict", "published", "measured"} <= compared[0].keys()
    assert "claim" in compared[-1]


PAGE = (ROOT / "docs" / "json-lines.md").read_text(encoding="utf-8")
EXAMPLES = [json.loads(b.text) for b in blocks(PAGE) if b.language == "json"]


def keys_of_list(command: str) -> list[str]:
    """The keys that the page names for the lines of a form of `list`."""
    (keys,) = re.findall(rf"^\| `{command}` \|[^|]*\| `([^`]+)`", PAGE, re.MULTILINE)
    return keys.split()


def keys_of(section: str, table: int = 0) -> list[str]:
    """The keys in the first column of a table of a section that has the heads key and content."""
    text = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    (body,) = (part for part in text if part.startswith(f"{section}\n"))
    rows = body.split("| key | content |\n|---|---|\n")[1 + table].partition("\n\n")[0]
    cells = [row.split(" | ")[0] for row in rows.splitlines()]
    return re.findall(r"`(\w+)`", " ".join(cells))


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("list filters", "list filters"),
        ("list experiments", "list experiments"),
        ("list problems", "list problems"),
        ("list metrics", "list metrics"),
        ("list statistics", "list statistics"),
        ("list metrics CONFIG", "list metrics nile"),
    ],
)
def test_the_page_has_the_keys_of_lists(command: str, words: str) -> None:
    keys = keys_of_list(command)
    assert keys == [*lines(*words.split())[0]]
    assert {*keys} <= {*keys_of("`list`")}


@pytest.mark.parametrize(
    ("section", "table", "words", "code", "nested"),
    [
        ("Mistakes", 0, "check nile --set runs=a", 2, "mistakes"),
        ("`describe`", 0, "describe cwna", 0, ""),
        ("`describe`", 1, "describe motions", 0, ""),
        ("`check`", 0, "check nile", 0, ""),
    ],
)
def test_the_page_has_the_keys_and_a_line(
    section: str, table: int, words: str, code: int, nested: str
) -> None:
    found = lines(*words.split(), code=code)
    inner = [*found[0][nested][0]] if nested else []
    assert keys_of(section, table) == [*found[0], *inner]
    assert f"`trackbench {words} --json`" in PAGE
    assert found[0] in EXAMPLES


def test_the_page_has_a_line_of_list() -> None:
    (example,) = (line for line in EXAMPLES if line.get("group") == "filters")
    assert example in lines("list", "filters")


def test_the_page_on_programs_has_the_line_of_check() -> None:
    page = (ROOT / "docs" / "programs.md").read_text(encoding="utf-8")
    (block,) = (block for block in blocks(page) if block.language == "json")
    assert lines("check", "nile") == [json.loads(block.text)]


def test_the_page_has_the_keys_of_runs_and_comparisons(tmp_path: Path) -> None:
    words = ("--runs", "4", "--set", "block=fit", *BARE)
    (found,) = lines("run", "hdepf", "--only", "PF", "--out", "out", *words, cwd=tmp_path)
    assert keys_of("`run`, `sweep`, `tune`, `fit`") == [*found]
    (ranking,) = found["ranking"]
    assert {"title", "rows", "notes"} == {*found["tables"]["table1"]} == {*ranking}
    assert keys_of("`suite`") == [field.name for field in fields(Score)]
    compared = lines("compare", "out", cwd=tmp_path)
    assert keys_of("`compare DIR`") == [*compared[0]]
    assert keys_of("`compare DIR`", 1) == [*compared[-1]]
    equal = lines("compare", "out", "out", cwd=tmp_path)
    assert keys_of("`compare DIR DIR2`, `gate`") == [*equal[0]]
    assert keys_of("`check`", 1) == ["file", "kind", "contract", *Finding._fields]


def test_a_line_for_each_long_table_of_keys_is_on_the_page() -> None:
    examples = [[*line] for line in EXAMPLES]
    assert keys_of("`suite`") in examples
    assert keys_of("`compare DIR`") in examples
    assert keys_of("`compare DIR`", 1) in examples
    assert keys_of("`compare DIR DIR2`, `gate`") in examples
    assert ["file", "kind", "contract"] in examples


_ON_PAPERS = (rules.TOO_FEW_RUNS, rules.NOT_MEASURED)
_ON_TESTS = {rules.EQUAL, rules.ALIKE, rules.BETTER, rules.WORSE, rules.UNTESTED}


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("`word`", {BEST, rules.ALIKE, rules.WORSE, LOSES_MORE, rules.UNTESTED}),
        ("`verdict` on a number, the best first", {*rules.NUMBER_WORDS, *_ON_PAPERS}),
        ("`verdict` on a claim", {*rules.CLAIM_WORDS, *_ON_PAPERS}),
        ("`verdict` of `compare`", {*_ON_TESTS, DIFFERS}),
        ("`verdict` of `gate`", {*_ON_TESTS, NEGLIGIBLE}),
        ("`verdict` on a cost", {rules.EQUAL, rules.WORSE, rules.ALIKE}),
    ],
)
def test_the_page_has_every_verdict(head: str, words: set[str]) -> None:
    assert set(words_of(head)) == words


def words_of(head: str) -> list[str]:
    """The words in the first column of the table that has the heads ``head`` and meaning."""
    rows = PAGE.split(f"| {head} | meaning |\n|---|---|\n")[1].partition("\n\n")[0]
    return [
        word for row in rows.splitlines() for word in re.findall(r"`(.+?)`", row.split(" | ")[0])
    ]


def test_the_verdicts_on_numbers_are_in_their_order() -> None:
    words = words_of("`verdict` on a number, the best first")
    assert words == [*rules.NUMBER_WORDS, *_ON_PAPERS]


def test_the_page_has_the_limit_of_compare() -> None:
    assert rules.LEVEL == 0.01
    assert "`p_holm` is at least 0.01" in PAGE


@pytest.mark.parametrize(
    ("key", "stored_file", "names"),
    [
        ("published", "bearings-two/comparison.csv", ("filter", "metric")),
        ("claim", "merwe2000/claims.csv", ("claim",)),
    ],
)
def test_the_lines_of_compare_are_those_of_stored_results(
    key: str, stored_file: str, names: tuple[str, ...]
) -> None:
    (example,) = (line for line in EXAMPLES if key in line)
    row = stored_row(stored_file, {name: example[name] for name in names})
    for word, value in example.items():
        if isinstance(value, float):
            assert float(row[word]) == pytest.approx(value, rel=0.01)
        else:
            assert row[word] == str(value)


def test_the_line_of_suite_is_that_of_stored_results() -> None:
    (example,) = (line for line in EXAMPLES if "problem" in line)
    cells = {"problem": example["problem"], "filter": example["label"], "role": example["role"]}
    row = stored_row("standard/scores.csv", cells)
    ratio = example["ratio_to_best"]
    reference = example["ratio_to_reference"]
    numbers = {
        "error": example["error"],
        "ratio_to_best": ratio["value"],
        "low": ratio["low"],
        "high": ratio["high"],
        "ratio_to_reference": reference["value"],
        "reference_low": reference["low"],
        "reference_high": reference["high"],
    }
    for column, number in numbers.items():
        assert float(row[column]) == pytest.approx(number, rel=0.01)
    for word in ("group", "metric", "word", "runs", "lost", "collapsed", "consistency", "reason"):
        assert row[word] == str(example[word])


def stored_row(path: str, cells: dict[str, str]) -> dict[str, str]:
    """Return the only row of a stored table that has these cells."""
    text = (ROOT / "results" / path).read_text(encoding="utf-8")
    rows = csv.DictReader(text.splitlines())
    (row,) = (row for row in rows if cells.items() <= row.items())
    return row


def test_a_filter_that_fails_is_said(tmp_path: Path) -> None:
    (tmp_path / "fails.py").write_text(
        "from dataclasses import dataclass\nfrom trackbench.registry import register\n\n\n"
        "@register('filters', 'fails')\n@dataclass(frozen=True, kw_only=True)\nclass Fails:\n"
        "    def init(self, model, prior, rng):\n        raise ValueError('on purpose')\n\n"
        "    step = estimate = None\n"
    )
    (tmp_path / "c.yaml").write_text(
        "name: c\nruns: 2\nplugins: [fails.py]\nfilters: {A: {kind: fails}}\n"
        "scenario: {kind: tracking, last: 3, sensor: {kind: position, sigma: 1}, start: two-scan,\n"
        "  target: {kind: legs, launch: {x: 0, y: 0, vx: 1, vy: 1}},\n"
        "  assume: {motion: {kind: cv, q: 1}}}\n"
    )
    (found,) = lines("run", "c.yaml", "--allow-plugins", cwd=tmp_path, code=1)
    assert "on purpose" in found["failed"][0]


def test_numbers_that_json_has_not(capsys: pytest.CaptureFixture[str]) -> None:
    echo_line({"a": [float("nan"), float("inf"), float("-inf"), 1e-300]})
    assert capsys.readouterr().out == '{"a": [null, "inf", "-inf", 1e-300]}\n'


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals here")
def test_colors_are_those_of_tables_on_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Help and mistakes have none; a terminal without colors, and one that wants none, get none."""
    run = ["run", "merwe2000", "--runs", "6", "--only", "UKF", "--only", "EKF"]
    run += ["--set", "figures={}"]
    for words, settings, colors in (
        (["--help"], {}, False),
        (["run", "--bogus"], {}, False),
        (run, {}, True),
        (run, {"NO_COLOR": "1"}, False),
        (run, {"TERM": "dumb"}, False),
        ([*run, "--format", "markdown"], {}, False),
    ):
        monkeypatch.delenv("NO_COLOR", raising=False)
        for name, value in ({"TERM": "xterm-256color"} | settings).items():
            monkeypatch.setenv(name, value)
        shown = on_a_terminal(*words, cwd=tmp_path)
        assert (re.search(r"\x1b\[[0-9;]*3\dm", shown) is not None) == colors, shown[-300:]
        table = "| Filter" if "markdown" in words else "─"
        assert (table in shown) == ("run" in words and "--bogus" not in words)


def on_a_terminal(*words: str, cwd: Path) -> str:
    """What a command shows on a terminal."""
    import pty

    screen, terminal = pty.openpty()
    shown = b""

    def read() -> None:
        nonlocal shown
        while not shown.endswith(b"\0"):  # a process that was started may keep the other side open
            shown += os.read(screen, 65536)

    reader = Thread(target=read)
    reader.start()
    with os.fdopen(terminal, "w") as file:
        try:
            trackbench(*words, cwd=cwd, terminal=file)
        finally:
            file.write("\0")
            file.flush()
            reader.join()
    os.close(screen)
    return shown.decode()
