"""Whatever is wrong with a config: exit 2, a place in the file, no traceback, nothing written, soon."""

import io
import os
import re
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from tests.conftest import EXPERIMENTS
from tests.papers import banana_text, maneuver_text
from trackbench import cli

PLACE = re.compile(r"^\S.*:\d+:\d+: .", re.MULTILINE)
SHIPPED = {path.stem: path.read_text() for path in sorted(EXPERIMENTS.glob("*.yaml"))}
SCENARIO = (
    "{kind: tracking, T: 1, last: 50, start: known, sensor: {kind: square-then-line, R: 1}, "
    "target: {kind: driven, motion: sine-gamma, launch: {x: 1}}}"
)
MINIMAL = f"name: x\nscenario: {SCENARIO}\nfilters:\n  PF: {{kind: pf, N: 10}}\n"


def check(path: Path, *words: str) -> tuple[int, str, str]:
    """The command line in this process: exit code, stdout, stderr."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["trackbench", "check", str(path), *words])
        try:
            cli.main()
        except SystemExit as end:
            return int(end.code or 0), out.getvalue(), err.getvalue()
    return 0, out.getvalue(), err.getvalue()


def assert_refused(code: int, out: str, err: str) -> None:
    assert code == 2, (code, out, err)
    assert PLACE.search(err), err
    assert "Traceback" not in out + err
    assert "pydantic" not in err


# Ways to break a config. Each takes the lines and a number, and returns what to write.


def _lines_with(lines: list[str], pattern: str) -> list[int]:
    return [i for i, line in enumerate(lines) if re.search(pattern, line)]


def unknown_key(lines: list[str], n: int) -> str:
    at = _lines_with(lines, r"^\s*[\w-]+: ?\S|^\w+:$")
    i = at[n % len(at)]
    indent = re.match(r"\s*", lines[i]).group()
    return "\n".join([*lines[:i], f"{indent}bogus_{n}: 1", *lines[i:]])


def unknown_key_in_braces(lines: list[str], n: int) -> str:
    at = _lines_with(lines, r"\{kind: [\w-]+")
    assume(at)
    i = at[n % len(at)]
    lines[i] = lines[i].replace("{", "{bogus: 1, ", 1)
    return "\n".join(lines)


WRONG = ["[1, [2]]", "{a: {b: 1}}", "null", ".nan", ".inf", "-.inf", '"1"', "-1e308", "true", "~x"]


def wrong_value(lines: list[str], n: int) -> str:
    numbers = [
        (i, match)
        for i, line in enumerate(lines)
        for match in re.finditer(r"(\w+: )(-?[\d.]+(?:e-?\d+)?)(?=[,}\s]|$)", line)
        if not line.lstrip().startswith("#")
    ]
    i, match = numbers[n % len(numbers)]
    value = WRONG[n % len(WRONG)]
    lines[i] = lines[i][: match.start(2)] + value + lines[i][match.end(2) :]
    return "\n".join(lines)


def duplicate_key(lines: list[str], n: int) -> str:
    at = _lines_with(lines, r"^\s*[\w-]+: \S")
    i = at[n % len(at)]
    return "\n".join([*lines[: i + 1], lines[i], *lines[i + 1 :]])


def tab(lines: list[str], n: int) -> str:
    at = _lines_with(lines, r"^  +\S")
    i = at[n % len(at)]
    lines[i] = "\t" + lines[i].lstrip()
    return "\n".join(lines)


def cut(lines: list[str], n: int) -> str:
    text = "\n".join(lines)
    return text[: 1 + n % (len(text) - 1)]


def misspelt_kind(lines: list[str], n: int) -> str:
    at = _lines_with(lines, r"kind: \w")
    i = at[n % len(at)]
    lines[i] = re.sub(r"kind: ([\w-]+)", r"kind: \1x", lines[i], count=1)
    return "\n".join(lines)


def missing_file(lines: list[str], n: int) -> str:
    at = _lines_with(lines, r"^[^#]*\.yaml")
    assume(at)
    i = at[n % len(at)]
    lines[i] = lines[i].replace(".yaml", ".yml")
    return "\n".join(lines)


def without_a_key(lines: list[str], n: int) -> str:
    at = _lines_with(lines, r"^(name|scenario):")
    i = at[n % len(at)]
    return "\n".join(line for j, line in enumerate(lines) if j != i)


def odd_character(lines: list[str], n: int) -> str:
    text = "\n".join(lines)
    i = n % len(text)
    return text[:i] + "\0\x07}]{[:&*!|>%@`"[n % 15] + text[i + 1 :]


def list_for_mapping(lines: list[str], n: int) -> str:
    at = _lines_with(lines, r"^(filters|tables|figures):$")
    i = at[n % len(at)]
    body = next((j for j in range(i + 1, len(lines)) if re.match(r"\w", lines[j])), len(lines))
    return "\n".join([*lines[:i], lines[i] + " [1, 2]", *lines[body:]])


BREAKS = [
    unknown_key,
    unknown_key_in_braces,
    wrong_value,
    duplicate_key,
    tab,
    cut,
    misspelt_kind,
    missing_file,
    without_a_key,
    odd_character,
    list_for_mapping,
]
ALWAYS_WRONG = {unknown_key_in_braces, duplicate_key, misspelt_kind, missing_file, without_a_key}
refused: set[str] = set()


@settings(
    max_examples=120,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much],
)
@given(
    name=st.sampled_from(sorted(SHIPPED)),
    how=st.sampled_from(BREAKS),
    n=st.integers(0, 10_000),
)
def test_a_broken_shipped_config(tmp_path_factory: pytest.TempPathFactory, name, how, n) -> None:
    text = how(SHIPPED[name].splitlines(), n)
    folder = tmp_path_factory.mktemp("broken")
    for part in ("scenarios", "filters", "published"):
        if (EXPERIMENTS / part).exists():
            (folder / part).symlink_to(EXPERIMENTS / part)
    path = folder / f"{name}.yaml"
    path.write_text(text)
    code, out, err = check(path)
    if code == 0:
        assert how not in ALWAYS_WRONG, (how.__name__, n)
        return  # this break did no harm: a cut at the end, a true for a true
    assert_refused(code, out, err)
    refused.add(text)


def test_enough_configs_were_broken() -> None:
    if not refused:
        pytest.skip("counts what the test above has broken")
    assert len(refused) >= 60


BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{c}: &{c} [{', '.join([f'*{p}'] * 9)}]\n" for p, c in zip("abcdefgh", "bcdefghi", strict=True)
)
HANDMADE = {
    "alias bomb": BOMB + MINIMAL,
    "alias bomb of mappings": "a: &a {x: 1}\n"
    + "".join(
        f"{c}: &{c} {{p: *{p}, q: *{p}, r: *{p}}}\n"
        for p, c in zip("abcdefghijklm", "bcdefghijklmn", strict=True)
    ),
    "an alias of itself": "a: &a [*a]\n" + MINIMAL,
    "a billion particles": MINIMAL.replace("N: 10", "N: 1000000000"),
    "1e9 particles": MINIMAL.replace("N: 10", "N: 1e9"),
    "a number of 400 digits": MINIMAL.replace("N: 10", "N: " + "9" * 400),
    "a number of 300 digits": MINIMAL.replace("N: 10", "N: " + "9" * 300),
    "runs of 320 digits": MINIMAL + "runs: " + "9" * 320 + "\n",
    "runs of 90 digits": MINIMAL + "runs: " + "9" * 90 + "\nblock: fit\n",
    "a trillion runs": MINIMAL + "runs: 1000000000000\n",
    "a block of a trillion runs": MINIMAL + "block: 1000000000000\n",
    "a trillion steps": MINIMAL.replace("last: 50", "last: 1000000000000"),
    "a trillion scans": MINIMAL.replace(SCENARIO, banana_text(scans=1_000_000_000_000)),
    "a million years": MINIMAL.replace(SCENARIO, maneuver_text(duration=3e13)),
    "a sample a picosecond": MINIMAL.replace(SCENARIO, maneuver_text(T=1e-12)),
    "a seed below zero": MINIMAL + "seed: -1\n",
    "a huge grid": MINIMAL
    + "grid:\n"
    + "".join(
        f"  scenario.{k}: [{', '.join(['1.0'] * 99)}]\n"
        for k in ("sensor.R", "sensor.phi2", "sensor.phi3", "T")
    ),
    "an empty axis": MINIMAL + "grid: {scenario.sensor.R: []}\n",
    "an axis that is no list": MINIMAL + "grid: {scenario.sensor.R: 3}\n",
    "a name with dots": MINIMAL.replace("name: x", "name: ../../x"),
    "a name that is dots": MINIMAL.replace("name: x", "name: .."),
    "an absolute name": MINIMAL.replace("name: x", "name: /tmp/x"),
    "a name with a slash": MINIMAL.replace("name: x", "name: a/b"),
    "a name with a null": MINIMAL.replace("name: x", 'name: "a\\0b"'),
    "an empty name": MINIMAL.replace("name: x", 'name: ""'),
    "a very long name": MINIMAL.replace("name: x", "name: " + "x" * 300),
    "a name that is a number": MINIMAL.replace("name: x", "name: 7"),
    "a table that leaves its folder": MINIMAL
    + "tables: {../t: {kind: metrics, columns: {a: rms(rmse)}}}\n",
    "an absolute figure": MINIMAL + "figures: {/tmp/f: {kind: estimates}}\n",
    "a table of a billion digits": MINIMAL
    + "tables: {t: {kind: metrics, digits: 1000000000, columns: {a: rms(rmse)}}}\n",
    "a figure of a run that is not there": MINIMAL + "figures: {f: {kind: estimates, run: 101}}\n",
    "a figure of another component": MINIMAL + "figures: {f: {kind: estimates, component: 2}}\n",
    "not a number": MINIMAL.replace("R: 1", "R: .nan"),
    "infinity": MINIMAL.replace("R: 1", "R: .inf"),
    "minus infinity": MINIMAL.replace("x: 1", "x: -.inf"),
    "overflow": MINIMAL.replace("R: 1", "R: 1e999"),
    "empty": "",
    "only a comment": "# nothing\n",
    "only dashes": "---\n",
    "a word": "hello\n",
    "a number": "3\n",
    "a list": "- 1\n- 2\n",
    "binary": bytes(range(256)),
    "nulls": b"\0" * 1000,
    "utf-16": MINIMAL.encode("utf-16"),
    "latin-1": MINIMAL.replace("name: x", "name: x\ntitle: é").encode("latin-1"),
    "more than a megabyte": "# " + "x" * 1_100_000 + "\n" + MINIMAL,
    "tabs": MINIMAL.replace("  PF", "\tPF"),
    "duplicate filters": MINIMAL + "  PF: {kind: ukf}\n",
    "duplicate top level": MINIMAL + "name: y\n",
    "filters as a list": MINIMAL.replace("  PF: {kind: pf, N: 10}", "  - {kind: pf}"),
    "no filters": MINIMAL.replace("filters:\n  PF: {kind: pf, N: 10}", "filters: {}"),
    "a filter that is a list": MINIMAL.replace("{kind: pf, N: 10}", "[pf, 10]"),
    "a filter that is nothing": MINIMAL.replace("{kind: pf, N: 10}", ""),
    "a kind that is a list": MINIMAL.replace("kind: pf", "kind: [pf]"),
    "a kind that is a mapping": MINIMAL.replace("kind: pf", "kind: {pf: pf}"),
    "a kind that is a number": MINIMAL.replace("kind: pf", "kind: 3"),
    "a kind that is an import": MINIMAL.replace("kind: pf", "kind: os.system"),
    "a preset that is a list": MINIMAL.replace("kind: pf", "kind: hdepf, preset: [literal]"),
    "a label with a newline": MINIMAL.replace("PF:", '"P\\nF":'),
    "a label that is a list": MINIMAL.replace("  PF:", "  ? [a, b]\n  :"),
    "a python object": MINIMAL + "title: !!python/object/apply:os.system [touch ran]\n",
    "a python name": MINIMAL + "title: !!python/name:os.system\n",
    "a tag": MINIMAL + "title: !mine x\n",
    "two documents": MINIMAL + "---\n" + MINIMAL,
    "deep lists": "a: " + "[" * 5000 + "]" * 5000 + "\n",
    "deep mappings": "".join(" " * i + "a:\n" for i in range(500)),
    "a use of itself": MINIMAL.replace("{kind: pf, N: 10}", "{use: self.yaml}"),
    "a use of a folder": MINIMAL.replace("{kind: pf, N: 10}", "{use: .}"),
    "a use of a name too long": MINIMAL.replace("{kind: pf, N: 10}", "{use: %s}" % ("a" * 300)),
    "data of a name too long": MINIMAL.replace(
        SCENARIO,
        f"{{kind: tracking, target: {{kind: measured, measurements: {'a' * 300}}}, "
        "sensor: {kind: position, sigma: 1}, start: {kind: one-scan, sigma_velocity: 1}, "
        "assume: {motion: {kind: cv, q: 1}}}",
    ),
    "a null in the name of a published file": MINIMAL + 'published: ["a\\0b.csv"]\n',
    "a use of a device": MINIMAL.replace("{kind: pf, N: 10}", "{use: /dev/zero}"),
    "a use of no yaml": MINIMAL.replace("{kind: pf, N: 10}", "{use: /etc/passwd}"),
    "a use that is a list": MINIMAL.replace("{kind: pf, N: 10}", "{use: [a]}"),
    "plugins without leave": MINIMAL + "plugins: [mine.py]\n",
    "plugins that are a word": MINIMAL + "plugins: mine.py\n",
    "plugins that are numbers": MINIMAL + "plugins: [1]\n",
    "a reference to nothing": MINIMAL + "reference: Exact\n",
    "medians that are numbers": MINIMAL + "medians: [1]\n",
    "a merge key": "base: &b {N: 10}\n" + MINIMAL.replace("N: 10", "<<: *b"),
    "an unknown alias": MINIMAL.replace("N: 10", "N: *n"),
    "a half quote": MINIMAL.replace("name: x", 'name: "x'),
    "a hexadecimal": MINIMAL.replace("N: 10", "N: 0x10"),
    "a date": MINIMAL.replace("N: 10", "N: 2026-01-01"),
    "a sexagesimal": MINIMAL.replace("N: 10", "N: 1:30"),
    "an underscore": MINIMAL.replace("N: 10", "N: 1_000"),
}


@pytest.mark.parametrize("what", HANDMADE)
def test_a_handmade_horror(tmp_path: Path, what: str) -> None:
    content = HANDMADE[what]
    path = tmp_path / "self.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    started = time.process_time()
    assert_refused(*check(path))
    assert time.process_time() - started < 2.0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["self.yaml"]


SPAWNED = (
    "alias bomb",
    "a billion particles",
    "a trillion runs",
    "a trillion steps",
    "a name with dots",
    "binary",
    "a python object",
    "a use of itself",
    "deep lists",
    "more than a megabyte",
)


# The program as it is, once for each folder: exit code, processor time, and the largest memory so far.
MEASURED = """
import os, sys, time
from trackbench.cli import main

for folder in sys.argv[1:]:
    os.chdir(folder)
    sys.argv = ["trackbench", "run", "self.yaml"]
    started = time.process_time()
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code
    status = open("/proc/self/status").read()
    print(code, time.process_time() - started, status.partition("VmHWM:")[2].split()[0], flush=True)
    print("end of", folder, file=sys.stderr, flush=True)
"""


@pytest.mark.skipif(not Path("/proc").exists(), reason="reads its memory from /proc")
def test_a_run_of_it_ends_soon_small_and_empty_handed(tmp_path: Path) -> None:
    folders = [tmp_path / what.replace(" ", "-") for what in SPAWNED]
    for folder, what in zip(folders, SPAWNED, strict=True):
        folder.mkdir()
        content = HANDMADE[what]
        content = content if isinstance(content, bytes) else content.encode()
        (folder / "self.yaml").write_bytes(content)
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, *folders],
        capture_output=True,
        text=True,
        env={**os.environ, "TRACKBENCH_CACHE": str(tmp_path / "cache")},
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    said = re.split(r"^end of .*\n", done.stderr, flags=re.MULTILINE)[:-1]
    for folder, line, err in zip(folders, done.stdout.splitlines(), said, strict=True):
        code, cpu_s, kilobytes = line.split()
        assert_refused(int(code), "", err)
        assert float(cpu_s) < 2.0, folder  # processor time, because the machine may be busy
        assert int(kilobytes) < 500_000, folder
        assert [p.name for p in folder.iterdir()] == ["self.yaml"]
    assert not (tmp_path / "cache").exists()
