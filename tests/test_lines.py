"""`--json`: an object a line, for programs; and nothing but text where nobody looks at a terminal."""

import csv
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from threading import Thread
from typing import Any, get_args, get_type_hints

import pytest
from scipy.stats import norm

from docs.site.blocks import blocks
from tests.commands import BARE, Command, spawned, trackbench
from tests.conftest import PLANE, ROOT
from trackbench import api
from trackbench.cli.json_objects import echo_line
from trackbench.commands.compare_new_with_stored import FAILED, NEGLIGIBLE
from trackbench.commands.gate import limit_of
from trackbench.config.shipped_suites import all_problems, suite_names
from trackbench.contract.findings import Finding
from trackbench.errors import WriteError
from trackbench.registry import GROUPS, kinds
from trackbench.report.findings.ranking_of_settings import Best
from trackbench.report.folder_comparison.numbers_of_one_folder import ADDED, REMOVED
from trackbench.report.folder_comparison.tests_and_verdicts import (
    COST,
    DIFFERS,
    EXACT,
    INDEPENDENT,
    PAIRED,
)
from trackbench.report.suite.scores import BEST, LOSES_MORE, Ratio, Score
from trackbench.statistics import significance_rules as rules
from trackbench.statistics import verdict_rules
from trackbench.statistics.verdict_meanings import CLAIM_WORDS, NUMBER_WORDS


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
    suites = {line["name"]: line for line in lines("list", "suites")}
    assert suites.keys() == set(suite_names())
    assert suites["standard"]["problems"] == len([*all_problems("standard")])


def test_describe() -> None:
    (found,) = lines("describe", "hdepf")
    assert found["group"] == "filters"
    keys = {key["key"]: key for key in found["keys"]}
    assert keys["CR"]["default"] == "0.6"
    assert lines("describe", "cwna")[0]["keys"][0]["default"] is None  # the config must have it
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
    units = {
        name: named[name]["unit"] for name in ("anees", "lost", "log_score", "mode", "mse", "rmse")
    }
    assert units == {
        **{"anees": "1", "lost": "1", "log_score": "nats"},
        **{"mode": "1", "mse": None, "rmse": "quantity"},
    }
    assert named["nees"].keys() == {"group", "kind", "text", "unit", "better"}
    assert [line["kind"] for line in lines("list", "statistics")][:2] == ["mean", "variance"]


def test_the_metrics_of_a_config() -> None:
    found = lines("list", "metrics", "adaptive-kf")
    metrics = {line["kind"]: line for line in found if line["group"] == "metrics"}
    assert metrics["rmse_position"]["per_step"] is metrics["rmse_position"]["kept"] is True
    assert metrics["rmse_velocity"]["kept"] is metrics["missed_maneuvers"]["per_step"] is False
    assert {"leg 1", "cpu_s_per_run"} <= {line["kind"] for line in found}


def test_metrics_on_request_are_kept_only_if_the_config_names_them() -> None:
    found = lines("list", "metrics", "nile")  # has no key `metrics`
    metrics = {line["kind"]: line for line in found if line["group"] == "metrics"}
    assert metrics["rmse_predicted_flow"]["kept"] is True
    assert metrics["mse_predicted_flow"]["kept"] is metrics["mae_predicted_flow"]["kept"] is False


def test_check_and_mistakes() -> None:
    (found,) = lines("check", "radar-turns")
    assert found["good"] is True
    assert "IMM, EKF" in found["filters"]
    (found,) = lines("check", "radar-turns", "--set", "runs=a", "--set", "seed=-1", code=2)
    assert found["good"] is False
    by_path = {mistake["path"]: mistake for mistake in found["mistakes"]}
    assert by_path["runs"]["what"] == "'a' is not a whole number"
    assert by_path["seed"]["file"] == "--set seed=-1"
    (found,) = lines("check", "nile", "--bogus", code=2)
    assert "--bogus" in found["mistakes"][0]["what"]
    (found,) = lines("check", code=2)
    assert "name a config" in found["mistakes"][0]["what"]
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


def types_of(section: str, table: int = 0) -> dict[str, str]:
    """The keys of a table of a section with their types; its heads are key, type and meaning."""
    parts = re.split(r"^##+ ", PAGE, flags=re.MULTILINE)
    (body,) = (part for part in parts if part.startswith(f"{section}\n"))
    rows = body.split("| key | type | meaning |\n|---|---|---|\n")[1 + table].partition("\n\n")[0]
    types = {}
    for row in rows.splitlines():
        keys, kind, _ = row.removeprefix("| ").split(" | ", 2)
        types |= dict.fromkeys(re.findall(r"`(\w+)`", keys), kind)
    return types


def keys_of(section: str, table: int = 0) -> list[str]:
    return [*types_of(section, table)]


def is_number(value: Any) -> bool:
    return type(value) in (int, float) or value in ("inf", "-inf")


IS_OF_TYPE: dict[str, Callable[[Any], bool]] = {
    "text": lambda value: isinstance(value, str),
    "number": is_number,
    "whole number": lambda value: type(value) is int,
    "yes/no": lambda value: isinstance(value, bool),
    "null": lambda value: value is None,
    "object": lambda value: isinstance(value, dict),
    "list of texts": lambda value: all(isinstance(entry, str) for entry in value),
    "list of numbers": lambda value: all(map(is_number, value)),
    "list of objects": lambda value: all(isinstance(entry, dict) for entry in value),
}
RUN = "`run`, `sweep`, `tune`, `fit`"
BEST_POINTS = "The best points of a sweep"
GONE = "What is removed or fails in a gate"
OF_ONE_FOLDER = "What only one folder has"
INNER = {
    ("Mistakes", "mistakes"): ("Mistakes", 1),
    ("`describe`", "keys"): ("`describe`", 1),
    ("`check`", "contract"): ("`check`", 2),
    (RUN, "ranking"): (RUN, 1),
    (RUN, "numbers"): ("`compare DIR`", 0),
    (RUN, "claims"): ("Claims", 0),
    (RUN, "best"): (BEST_POINTS, 0),
    ("`suite`", "ratio_to_best"): ("`suite`", 1),
    ("`suite`", "ratio_to_reference"): ("`suite`", 1),
}
"""Tables of the objects in a line, by the section of the line and its key."""
TABLES = [
    *[("Mistakes", 0), ("An error", 0), ("`describe`", 0), ("`describe`", 2), ("`check`", 0)],
    *[("`check`", 1), (RUN, 0), (RUN, 2), (BEST_POINTS, 0), ("`suite`", 0), ("`compare DIR`", 0)],
    *[("Claims", 0), ("`compare DIR DIR2`", 0), (OF_ONE_FOLDER, 0), (GONE, 0)],
]
"""Tables of whole lines."""


def hold_to_page(line: dict[str, Any], section: str, table: int = 0) -> None:
    """A line has the keys of a table of the page, in order, with values of the types named there."""
    types = types_of(section, table)
    if (section, table) == ("`describe`", 0) and line["group"] != "metrics":
        del types["unit"], types["better"]
    assert set(line) == set(types)
    for key, value in line.items():
        kinds_of_value = types[key].split(" or ")
        assert any(IS_OF_TYPE[kind](value) for kind in kinds_of_value), (key, value)
        if (section, key) in INNER:
            for entry in value if isinstance(value, list) else [value]:
                hold_to_page(entry, *INNER[section, key])
    for entry in line["tables"].values() if (section, table) == (RUN, 0) else ():
        hold_to_page(entry, RUN, 1)


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
    types = types_of("`list`")
    for line in lines(*words.split()):
        assert {*line} <= {*types}
        for key, value in line.items():
            assert any(IS_OF_TYPE[kind](value) for kind in types[key].split(" or "))


@pytest.mark.parametrize("group", ["windows", "statistics", "numbers"])
def test_the_page_has_the_keys_of_other_lines_of_a_config(group: str) -> None:
    keys = keys_of_list(f"list metrics CONFIG`, group `{group}")
    found = [line for line in lines("list", "metrics", "adaptive-kf") if line["group"] == group]
    assert found
    assert all([*line] == keys for line in found)


@pytest.mark.parametrize(
    ("section", "table", "words", "code"),
    [
        ("Mistakes", 0, "check nile --set runs=a", 2),
        ("`describe`", 0, "describe cwna", 0),
        ("`describe`", 2, "describe motions", 0),
        ("`check`", 0, "check nile", 0),
    ],
)
def test_the_page_has_the_keys_and_a_line(section: str, table: int, words: str, code: int) -> None:
    found = lines(*words.split(), code=code)
    for line in found:
        hold_to_page(line, section, table)
    assert f"`trackbench {words} --json`" in PAGE
    assert found[0] in EXAMPLES


@pytest.mark.parametrize("words", ["hdepf", "rmse_position", "recorded", "median"])
def test_the_page_has_the_keys_of_descriptions(words: str) -> None:
    for line in lines("describe", words):
        if line["group"] != "statistics":
            hold_to_page(line, "`describe`")


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: ",".join(example)[:40])
def test_examples_have_the_keys_and_types_of_their_tables(example: dict[str, Any]) -> None:
    if example.get("group") == "filters":
        assert [*example] == keys_of_list("list filters")
        return
    keys = set(example)
    fitting = []
    for section, table in TABLES:
        types = set(types_of(section, table))
        if keys == types or (section == "`describe`" and keys == types - {"unit", "better"}):
            fitting.append((section, table))
    # What is gone has one table for a gate and one for two folders, with equal keys.
    assert len(fitting) == 1 or fitting == [(OF_ONE_FOLDER, 0), (GONE, 0)]
    for place in fitting:
        hold_to_page(example, *place)


def test_every_table_of_lines_has_an_example() -> None:
    keys = [set(example) for example in EXAMPLES]
    for section, table in TABLES:
        assert set(types_of(section, table)) - {"unit", "better"} in [
            example - {"unit", "better"} for example in keys
        ]


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
    assert keys_of(RUN) == [*found]
    hold_to_page(found, RUN)
    compared = lines("compare", "out", cwd=tmp_path)
    for line in compared:
        hold_to_page(line, "Claims" if "claim" in line else "`compare DIR`")
    assert keys_of("`compare DIR`") == [*compared[0]]
    assert keys_of("Claims") == [*compared[-1]]
    equal = lines("compare", "out", "out", cwd=tmp_path)
    assert keys_of("`compare DIR DIR2`") == [*equal[0]]
    for line in equal:
        hold_to_page(line, "`compare DIR DIR2`")
    (dry,) = lines("run", "hdepf", "--only", "PF", *words, "--dry-run", cwd=tmp_path)
    hold_to_page(dry, RUN, 2)


def test_the_page_has_the_fields_of_records() -> None:
    assert keys_of("`suite`") == [field.name for field in fields(Score)]
    assert keys_of("`suite`", 1) == [field.name for field in fields(Ratio)]
    assert keys_of("`check`", 2) == [*Finding._fields]
    assert keys_of(BEST_POINTS) == [*Best._fields]
    for word in get_args(get_type_hints(Finding)["verdict"]):
        assert f"`{word}`" in PAGE.split("| `check` | text | subject")[1].partition("\n\n")[0]


def test_the_page_has_the_lines_of_a_gate(tmp_path: Path) -> None:
    """One filter is gone, and another one fails."""
    config = f"name: c\nseed: 1\nruns: 6\n{PLANE}filters:\n  EKF: {{kind: ekf}}\n"
    (tmp_path / "c.yaml").write_text(config + "  KF: {kind: kf}\n  Mine: {kind: kf}\n")
    quiet = ("--workers", "1", *BARE)
    assert trackbench("run", "c.yaml", *quiet, "--out", "old", cwd=tmp_path).returncode == 0
    # It is ready, and ends at the first run.
    broken = "  Mine: {kind: external, command: [sh, -c, 'read line; echo ready']}\n"
    (tmp_path / "c.yaml").write_text(config + broken)
    words = ("gate", "c.yaml", "--against", "old", "--allow-plugins", "--workers", "1")
    found = lines(*words, cwd=tmp_path, code=1)
    for line in found[:-2]:
        hold_to_page(line, "`compare DIR DIR2`")
    for line in found[-2:]:
        hold_to_page(line, GONE)
    assert [(line["filter"], line["verdict"]) for line in found[-2:]] == [
        ("KF", REMOVED),
        ("Mine", FAILED),
    ]
    # A comparison of two folders names both filters, too, in either order of the folders.
    run = trackbench("run", "c.yaml", *quiet, "--allow-plugins", "--out", "new", cwd=tmp_path)
    assert run.returncode == 1
    for folders, word in ((("old", "new"), REMOVED), (("new", "old"), ADDED)):
        of_one = [line for line in lines("compare", *folders, cwd=tmp_path) if "how" not in line]
        for line in of_one:
            hold_to_page(line, OF_ONE_FOLDER)
        assert [(line["filter"], line["verdict"]) for line in of_one] == [
            ("KF", word),
            ("Mine", word),
        ]
        assert [line["reason"] for line in of_one] == ["", found[-1]["reason"]]


_ON_PAPERS = (verdict_rules.TOO_FEW_RUNS, verdict_rules.NOT_MEASURED)
_ON_TESTS = {rules.EQUAL, rules.ALIKE, rules.BETTER, rules.WORSE, rules.UNTESTED}


@pytest.mark.parametrize(
    ("head", "words"),
    [
        ("`word`", {BEST, rules.ALIKE, rules.WORSE, LOSES_MORE, rules.UNTESTED}),
        ("`verdict` on a number, the best first", {*NUMBER_WORDS, *_ON_PAPERS}),
        ("`verdict` on a claim", {*CLAIM_WORDS, *_ON_PAPERS}),
        ("`verdict` of `compare`", {*_ON_TESTS, DIFFERS}),
        ("`verdict` of `gate`", {*_ON_TESTS, NEGLIGIBLE, REMOVED, FAILED}),
        ("`how`", {rules.EQUAL, PAIRED, INDEPENDENT, EXACT, COST}),
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
    assert words == [*NUMBER_WORDS, *_ON_PAPERS]


def test_the_page_has_the_limit_of_compare() -> None:
    assert rules.LEVEL == 0.01
    assert "`p_holm` is at least 0.01" in PAGE


def test_the_page_has_the_limit_of_gate() -> None:
    limit = limit_of("3sigma")
    assert f"at most {norm.sf(limit.sigmas):.3g}" in " ".join(PAGE.split())
    assert f"`3sigma,{100 * limit.share:g}%`" in PAGE


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
    for name, value in example.items():
        word = "best" if name == "counts" else name
        if isinstance(value, bool):
            assert row[word] == ("yes" if value else "no")
        elif isinstance(value, list):
            stored = [float(z) for z in row[word].split("; ")]
            assert stored == pytest.approx(value, abs=0.06)
        elif isinstance(value, float):
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


PROGRAM = """\
import sys
word, *_ = [*sys.argv[1:], ""]
for line in sys.stdin:
    words = line.split()
    if words[0] == "trackbench":
        print("error has no such sensor" if word == "refuse" else "ready", flush=True)
    elif words[0] == "init":
        print(*words[3:7] if word == "mean" else words[3:], flush=True)
    elif words[0] == "step":
        if word == "fail":
            sys.exit("gave up")
        print(*words[2:4], 0, 0, flush=True)
"""


@pytest.fixture
def own_program(tmp_path: Path) -> Path:
    """A folder with a program that is a filter, and a config for each of its words."""
    (tmp_path / "mine.py").write_text(PROGRAM)
    for word in ("refuse", "mean", "fail"):
        command = f"[{sys.executable}, mine.py, {word}]"
        (tmp_path / f"{word}.yaml").write_text(
            f"name: {word}\nseed: 1\nruns: 2\n{PLANE}"
            f"filters: {{Mine: {{kind: external, command: {command}}}}}\n"
            "tables: {t: {kind: metrics, columns: {ANEES: anees}}}\n"
        )
    return tmp_path


ALLOWED = ("--allow-plugins", "--workers", "1", *BARE)


def test_a_program_that_is_not_allowed_or_refuses_is_a_mistake(own_program: Path) -> None:
    for command in ("check", "run"):
        (found,) = lines(command, "mean.yaml", cwd=own_program, code=2)
        assert "--allow-plugins" in found["mistakes"][0]["what"]
    for words in (
        ("check", "refuse.yaml", "--allow-plugins"),
        ("check", "--contract", "mine.py", "--on", "refuse.yaml", "--allow-plugins"),
        ("run", "refuse.yaml", *ALLOWED),
    ):
        (found,) = lines(*words, cwd=own_program, code=2)
        hold_to_page(found, "Mistakes")
        assert "refuses this problem: has no such sensor" in found["mistakes"][0]["what"]


def test_a_program_that_fails_has_its_last_line_in_the_reason(own_program: Path) -> None:
    (found,) = lines("run", "fail.yaml", *ALLOWED, cwd=own_program, code=1)
    hold_to_page(found, RUN)
    assert "its last line on stderr: 'gave up'" in found["failed"][0]
    words = ("check", "--contract", "mine.py", "--on", "fail.yaml", "--allow-plugins")
    (found,) = lines(*words, cwd=own_program, code=1)
    hold_to_page(found, "`check`", 1)
    assert (found["file"], found["kind"]) == ("mine.py", "Mine")
    assert any(row["verdict"] == "bad" and "gave up" in row["why"] for row in found["contract"])


def test_a_program_without_covariance_has_null_in_place_of_the_anees(own_program: Path) -> None:
    (found,) = lines("run", "mean.yaml", *ALLOWED, cwd=own_program)
    (row,) = found["tables"]["t"]["rows"]
    assert row["ANEES"] is None


def test_an_error_is_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise WriteError("cannot write results/nile/summary.csv: no space left on device")

    monkeypatch.setattr(api, "run_all", fail)
    (found,) = lines("run", "nile", cwd=tmp_path, code=1)
    hold_to_page(found, "An error")
    assert found in EXAMPLES


def test_lines_are_utf_8_whatever_the_terminal_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")
    (tmp_path / "c.yaml").write_text(
        f"name: c\nruns: 2\n{PLANE}filters: {{Größe: {{kind: kf}}}}\n", encoding="utf-8"
    )
    command = [sys.executable, "-m", "trackbench", "check", "c.yaml", "--json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True)
    assert json.loads(done.stdout.decode("utf-8"))["filters"] == ["Größe"]


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
